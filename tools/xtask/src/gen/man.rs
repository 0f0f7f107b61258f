//! The manual page and the shell completions of each program, made from its command line.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use clap::Command;
use clap_complete::Shell;

/// Writes them into `tree`, as into the root of a file system.
pub(crate) fn write(tree: &Path) -> Result<()> {
    for command in commands() {
        let name = command.get_name().to_owned();
        let pages = folder(tree, "usr/share/man/man1")?;
        clap_mangen::generate_to(command.clone(), pages)
            .with_context(|| format!("the manual page of {name}"))?;
        for (shell, place) in SHELLS {
            let into = folder(tree, place)?;
            let path = clap_complete::generate_to(shell, &mut command.clone(), &name, &into)
                .with_context(|| format!("completions of {name}"))?;
            if shell == Shell::Bash {
                // Bash loads them by the program's own name.
                fs::rename(&path, into.join(&name)).with_context(|| path.display().to_string())?;
            }
        }
    }
    Ok(())
}

fn commands() -> [Command; 4] {
    [
        // The packaged program is built without its demo.
        vsm::program::command().mut_subcommand("demo", |demo| demo.hide(true)),
        cucs::program::command(),
        px4_sim::program::command(),
        curve_plan::command(),
    ]
}

fn folder(tree: &Path, place: &str) -> Result<PathBuf> {
    let folder = tree.join(place);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    Ok(folder)
}

const SHELLS: [(Shell, &str); 3] = [
    (Shell::Bash, "usr/share/bash-completion/completions"),
    (Shell::Zsh, "usr/share/zsh/vendor-completions"),
    (Shell::Fish, "usr/share/fish/vendor_completions.d"),
];
