//! The argument that names the configuration, the same in every subcommand: `vsm run [FILE]` or `vsm run --config FILE`.
//!
//! A subcommand flattens it (`#[command(flatten)] config: ConfigArg`) and reads [`ConfigArg::path`].

use std::path::{Path, PathBuf};

use clap::Args;

/// Which configuration is meant.
#[derive(Debug, Clone, Args)]
pub(crate) struct ConfigArg {
    /// Configuration of the bridge
    // A default does not count as given: only a FILE that somebody wrote conflicts with --config.
    #[arg(value_name = "FILE", default_value = "vsm.toml")]
    file: PathBuf,
    /// The same as FILE
    #[arg(long = "config", value_name = "FILE", conflicts_with = "file")]
    named: Option<PathBuf>,
}

impl ConfigArg {
    pub(crate) fn path(&self) -> &Path {
        self.named.as_deref().unwrap_or(&self.file)
    }
}

/// The same for the agent beside PX4, whose configuration is another file.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("file", |file| file.default_value("airside.toml").help("Configuration of the agent")))]
pub(crate) struct AgentConfigArg {
    #[command(flatten)]
    config: ConfigArg,
}

impl AgentConfigArg {
    pub(crate) fn path(&self) -> &Path {
        self.config.path()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser;

    use super::ConfigArg;
    use crate::program::command;

    #[derive(Parser)]
    struct Bridge {
        #[command(flatten)]
        config: ConfigArg,
    }

    #[test]
    fn the_configuration_is_named_either_way_and_once() {
        let of = |words: &str| {
            Bridge::try_parse_from(words.split(' ')).map(|found| found.config.path().to_owned())
        };
        assert_eq!(of("run").unwrap(), Path::new("vsm.toml"));
        assert_eq!(of("run a.toml").unwrap(), Path::new("a.toml"));
        assert_eq!(of("run --config a.toml").unwrap(), Path::new("a.toml"));
        assert!(of("run a.toml --config b.toml").is_err());
    }

    #[test]
    fn every_subcommand_with_config_takes_the_file_as_its_argument_too() {
        fn check(name: &str, command: &clap::Command, seen: &mut usize) {
            // The arguments of these are paths on a vehicle, recordings, and a key file.
            if !["vsm files", "vsm replay", "vsm guard rotate"].contains(&name)
                && command
                    .get_arguments()
                    .any(|one| one.get_long() == Some("config"))
            {
                let file = command.get_positionals().next();
                let default = file.map(|file| file.get_default_values().to_owned());
                let expected = if name.starts_with("vsm airside") {
                    "airside.toml"
                } else {
                    "vsm.toml"
                };
                assert_eq!(default, Some(vec![expected.into()]), "{name}");
                *seen += 1;
            }
            let subs = command.get_subcommands();
            for sub in subs.filter(|_| name != "vsm files") {
                check(&format!("{name} {}", sub.get_name()), sub, seen);
            }
        }
        let mut seen = 0;
        check("vsm", &command(), &mut seen);
        assert!(seen >= 14, "{seen}");
    }
}
