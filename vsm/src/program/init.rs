//! `vsm init`: creates a configuration from a few answers, the signing key, and for a simulated vehicle PX4's own key file.
//!
//! With `--protect` all authentication and encryption is on: [`protect`].
//!
//! A value with a safe default needs no answer. With `--sitl` that is everything, since bridge, vehicle and ground station
//! are on this computer. For another vehicle its link and the ids decide what is commanded, and by whom: they are asked for
//! on a terminal, and required as options elsewhere. Nothing is overwritten, and a run that fails leaves no file behind.

mod protect;

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufRead, IsTerminal as _, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, anyhow};
use clap::{Args, ValueEnum};
use stanag_msgs::Id;

use crate::config::{Config, LinkAddress};
use crate::shell::disk::folder_of;
use crate::shell::key_file;

use self::protect::Protected;
use super::config_arg::ConfigArg;
use super::key::wall_stamp;
use super::process::{Failure, act_for, bad, failed, print};

#[derive(Debug, Args)]
#[command(mut_arg("file", |file| file.help("Configuration to write; it must not exist")))]
pub(crate) struct Init {
    #[command(flatten)]
    config: ConfigArg,
    /// For a simulated vehicle on this computer (PX4 SITL, px4-sim): everything else has a default
    #[arg(long)]
    sitl: bool,
    /// Switch everything on: a guard and an access list for the ground station, an encrypted link to an air-side agent and keys
    /// agreed with it; writes the agent's configuration too. --link is the ground's end of the radio
    #[arg(long)]
    protect: bool,
    /// Where the vehicle's MAVLink is, such as serial:/dev/ttyUSB0:57600 or udpin:0.0.0.0:14550
    #[arg(long, value_name = "LINK")]
    link: Option<LinkAddress>,
    /// MAVLink system id of the vehicle, 1 to 255
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=255))]
    system_id: u8,
    /// Identification number of the vehicle: four bytes in hex, the owning nation first, such as 1b:00:01:01
    #[arg(long, value_name = "ID")]
    vehicle_id: Option<Id>,
    /// Identification number of the ground station that may connect, such as 1b:00:00:a0
    #[arg(long, value_name = "ID")]
    cucs_id: Option<Id>,
    /// Identification number of this VSM
    #[arg(long, value_name = "ID", default_value = "1b:00:00:01")]
    vsm_id: Id,
    /// Airframe: how closely curved routes are followed
    #[arg(long, value_enum)]
    airframe: Option<Airframe>,
    /// UDP address for ground stations
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:4586")]
    listen: SocketAddr,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Airframe {
    Quad,
    Plane,
    Vtol,
}

impl Airframe {
    /// `vehicle.curve.tolerance_m`: a wing follows its path to some metres, so that closer points would cost mission items
    /// and bring nothing.
    fn tolerance_m(self) -> &'static str {
        match self {
            Airframe::Quad => "1.0",
            Airframe::Plane | Airframe::Vtol => "5.0",
        }
    }

    /// `PX4_SIM_MODEL` of PX4's built-in simulation.
    fn px4_model(self) -> &'static str {
        match self {
            Airframe::Quad => "sihsim_quadx",
            Airframe::Plane => "sihsim_airplane",
            Airframe::Vtol => "sihsim_standard_vtol",
        }
    }
}

impl Display for Airframe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Airframe::Quad => "quad",
            Airframe::Plane => "plane",
            Airframe::Vtol => "vtol",
        })
    }
}

impl FromStr for Airframe {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        <Airframe as ValueEnum>::from_str(text, true)
            .map_err(|_| format!("{text:?} is no airframe: expected quad, plane or vtol"))
    }
}

/// What the configuration is made of.
#[derive(Debug, Clone, PartialEq)]
struct Answers {
    sitl: bool,
    link: LinkAddress,
    vehicle_id: Id,
    cucs_id: Id,
    airframe: Airframe,
}

/// The files that a run makes.
struct Files {
    config: PathBuf,
    key: PathBuf,
    /// PX4's own, for a simulated vehicle: to be copied into its working folder, or that is this one.
    px4: PathBuf,
    /// What `--protect` makes beside these.
    agent: PathBuf,
    guard: PathBuf,
    access_key: PathBuf,
    access_list: PathBuf,
}

impl Files {
    fn beside(config: &Path) -> Files {
        Files {
            config: config.to_owned(),
            key: config.with_file_name(KEY_FILE),
            px4: config
                .with_file_name("mavlink")
                .join("mavlink-signing-key.bin"),
            agent: config.with_file_name("airside.toml"),
            guard: config.with_file_name(protect::GUARD_KEY),
            access_key: config.with_file_name(protect::ACCESS_KEY),
            access_list: config.with_file_name(protect::ACCESS_LIST),
        }
    }
}

pub(crate) fn run(init: &Init) -> Result<(), Failure> {
    let files = Files::beside(init.config.path());
    act_for(folder_of(&files.config), &[])?;
    // First of all, so that nobody answers questions for a file that is refused afterwards.
    refuse_to_overwrite(&files)?;
    let answers = if io::stdin().is_terminal() {
        ask(init, &mut io::stdin().lock(), &mut io::stdout()).map_err(failed)?
    } else {
        without_questions(init).map_err(bad)?
    };
    let text = configuration(init, &answers);
    // For example ids that collide: reported by the same text as for every other configuration.
    Config::parse(&text, folder_of(&files.config)).map_err(bad)?;
    let mut made = Made::default();
    if init.protect {
        let of = Protected {
            vsm_id: init.vsm_id,
            vehicle_id: answers.vehicle_id,
            cucs_id: answers.cucs_id,
            system_id: init.system_id,
            listen: init.listen,
            link: &answers.link,
            sitl: answers.sitl,
            config: &files.config,
            is_default: files.config == Path::new(DEFAULT_CONFIG),
            agent: &files.agent,
            guard: &files.guard,
            access_key: &files.access_key,
            access_list: &files.access_list,
        };
        protect::write(&of, &text, &mut made.0).map_err(failed)?;
        made.keep();
        return print(&protect::report(&of));
    }
    write_files(&files, &text, answers.sitl, &mut made).map_err(failed)?;
    made.keep();
    let key = key_file::read(&files.key).map_err(failed)?;
    print(&report(init, &answers, &files, &key.id().to_string()))
}

fn refuse_to_overwrite(files: &Files) -> Result<(), Failure> {
    for (file, what) in [
        (&files.config, "a configuration"),
        (&files.key, "a signing key"),
        (&files.px4, "PX4's signing key"),
        (&files.agent, "a configuration"),
        (&files.guard, "a guard key"),
        (&files.access_key, "an access key"),
        (&files.access_list, "an access list"),
    ] {
        // A dangling symbolic link exists too.
        if fs::symlink_metadata(file).is_ok() {
            let file = file.display();
            return Err(bad(anyhow!(
                "{file} exists, and {what} is never overwritten: move it away, or name a configuration in another folder, \
                 such as `vsm init other/vsm.toml`"
            )));
        }
    }
    Ok(())
}

/// The answers of the command line, with defaults where they are safe.
fn without_questions(init: &Init) -> anyhow::Result<Answers> {
    fn required<T>(given: Option<T>, sitl: Option<T>, option: &str) -> anyhow::Result<T> {
        given.or(sitl).with_context(|| {
            format!(
                "{option} is missing, and standard input is no terminal to ask on: expected {option}, or --sitl for a \
                 simulated vehicle on this computer"
            )
        })
    }
    let sitl = init.sitl;
    let link = init.link.clone();
    let of_sitl = if init.protect {
        protect::sitl_link()
    } else {
        SITL_LINK
    };
    Ok(Answers {
        sitl,
        link: required(link, sitl.then_some(of_sitl), "--link LINK")?,
        vehicle_id: required(
            init.vehicle_id,
            sitl.then_some(VEHICLE_ID),
            "--vehicle-id ID",
        )?,
        cucs_id: required(init.cucs_id, sitl.then_some(CUCS_ID), "--cucs-id ID")?,
        airframe: required(
            init.airframe,
            sitl.then_some(Airframe::Quad),
            "--airframe quad|plane|vtol",
        )?,
    })
}

/// The same, each that is missing asked for.
fn ask(init: &Init, input: &mut dyn BufRead, out: &mut dyn Write) -> anyhow::Result<Answers> {
    if init.sitl {
        return without_questions(init);
    }
    let mut sitl = false;
    let link = match &init.link {
        Some(link) => link.clone(),
        None => {
            let question = "Where is the vehicle's MAVLink: sitl (PX4 SITL or px4-sim on this computer), udpin:ADDRESS:PORT, \
                            udpout:HOST:PORT or serial:DEVICE:BAUD";
            match answer(input, out, question, LinkOrSitl::Sitl)? {
                LinkOrSitl::Link(link) => link,
                LinkOrSitl::Sitl => {
                    sitl = true;
                    if init.protect {
                        protect::sitl_link()
                    } else {
                        SITL_LINK
                    }
                }
            }
        }
    };
    let mut id = |given: Option<Id>, question, default| match given {
        Some(id) => Ok(id),
        None => answer(input, out, question, default),
    };
    let vehicle_id = id(
        init.vehicle_id,
        "Identification number of the vehicle, four bytes, the owning nation first",
        VEHICLE_ID,
    )?;
    let question = "Identification number of the ground station (CUCS) that may command it";
    let cucs_id = id(init.cucs_id, question, CUCS_ID)?;
    let airframe = match init.airframe {
        Some(airframe) => airframe,
        None => answer(input, out, "Airframe: quad, plane or vtol", Airframe::Quad)?,
    };
    Ok(Answers {
        sitl,
        link,
        vehicle_id,
        cucs_id,
        airframe,
    })
}

/// An answer to the first question.
enum LinkOrSitl {
    Link(LinkAddress),
    Sitl,
}

impl FromStr for LinkOrSitl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "sitl" => Ok(LinkOrSitl::Sitl),
            link => Ok(LinkOrSitl::Link(link.parse()?)),
        }
    }
}

impl Display for LinkOrSitl {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LinkOrSitl::Link(link) => link.fmt(f),
            LinkOrSitl::Sitl => f.write_str("sitl"),
        }
    }
}

/// One question, until its answer can be used; an empty line is the default.
fn answer<T: FromStr<Err: Display> + Display>(
    input: &mut dyn BufRead,
    out: &mut dyn Write,
    question: &str,
    default: T,
) -> anyhow::Result<T> {
    loop {
        write!(out, "{question} [{default}]: ")?;
        out.flush()?;
        let mut line = String::new();
        if input.read_line(&mut line)? == 0 {
            return Err(anyhow!("the input ended before {question:?} was answered"));
        }
        match line.trim() {
            "" => return Ok(default),
            text => match text.parse() {
                Ok(found) => return Ok(found),
                Err(fault) => writeln!(out, "{fault}")?,
            },
        }
    }
}

/// The text of the file.
fn configuration(init: &Init, answers: &Answers) -> String {
    let quoted = |value: &dyn Display| toml::Value::String(value.to_string()).to_string();
    [
        ("{vsm_id}", quoted(&init.vsm_id)),
        ("{listen}", quoted(&init.listen)),
        ("{cucs_id}", quoted(&answers.cucs_id)),
        ("{vehicle_id}", quoted(&answers.vehicle_id)),
        ("{link}", quoted(&answers.link)),
        ("{system_id}", init.system_id.to_string()),
        (
            "{station}",
            if init.protect {
                protect::STATION
            } else {
                STATION
            }
            .to_owned(),
        ),
        (
            "{signing}",
            if init.protect {
                protect::SIGNING
            } else {
                SIGNING
            }
            .to_owned(),
        ),
        (
            "{access}",
            if init.protect { protect::ACCESS } else { "" }.to_owned(),
        ),
        (
            "{listened}",
            if init.protect {
                protect::LISTENED
            } else {
                LISTENED
            }
            .to_owned(),
        ),
        ("{key_file}", quoted(&KEY_FILE)),
        ("{tolerance_m}", answers.airframe.tolerance_m().to_owned()),
        ("{airframe}", answers.airframe.to_string()),
    ]
    .into_iter()
    .fold(TEMPLATE.to_owned(), |text, (name, value)| {
        text.replace(name, &value)
    })
}

/// What a run has made so far: deleted again where it fails.
#[derive(Default)]
struct Made(Vec<PathBuf>);

impl Made {
    fn keep(mut self) {
        self.0.clear();
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        for path in self.0.drain(..).rev() {
            // Errors here are ignored, since the cause of the failure is reported. A folder that existed before is not
            // empty, and stays.
            let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir(&path));
        }
    }
}

fn write_files(files: &Files, text: &str, sitl: bool, made: &mut Made) -> anyhow::Result<()> {
    let folder = folder_of(&files.config);
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    key_file::generate(&files.key)?;
    made.0.push(files.key.clone());
    if sitl {
        let key = key_file::read(&files.key)?;
        key_file::make_px4_folder(&files.px4)?;
        made.0.push(folder_of(&files.px4).to_owned());
        key_file::write_px4(&files.px4, &key, wall_stamp()?)
            .with_context(|| files.px4.display().to_string())?;
        made.0.push(files.px4.clone());
    }
    // The configuration is written last: if it exists, so does everything that it names.
    let mut file =
        File::create_new(&files.config).with_context(|| files.config.display().to_string())?;
    made.0.push(files.config.clone());
    file.write_all(text.as_bytes())
        .and_then(|()| file.sync_all())
        .with_context(|| files.config.display().to_string())
}

/// The folder of this program as it was typed, such as `./target/release/`; empty where it was found by its name.
fn called_from() -> String {
    let typed = std::env::args().next().unwrap_or_default();
    let end = typed.rfind('/').map_or(0, |slash| slash + 1);
    typed[..end].to_owned()
}

/// What was written, and the commands that come next.
fn report(init: &Init, answers: &Answers, files: &Files, key: &str) -> String {
    let (config, key_file) = (files.config.display(), files.key.display());
    let mut text =
        format!("{config}: the configuration\n{key_file}: a new signing key, id {key}\n");
    if answers.sitl {
        text += &format!(
            "{}: the same key, as PX4 reads it below its working folder\n",
            files.px4.display()
        );
    }
    let file = if files.config == Path::new(DEFAULT_CONFIG) {
        String::new()
    } else {
        format!(" {config}")
    };
    let here = called_from();
    text += &format!("next:\n  {here}vsm check-config{file}\n");
    if answers.sitl {
        text += &format!("  {here}vsm run{file}\n");
        let peer = match &answers.link {
            LinkAddress::UdpIn(address) => Some(format!("udpout:{address}")),
            LinkAddress::UdpOut(address) => Some(format!("udpin:{address}")),
            LinkAddress::Serial { .. } => None,
        };
        // px4-sim flies no transitions.
        if let Some(peer) = peer.filter(|_| answers.airframe != Airframe::Vtol) {
            text += &format!("  {here}px4-sim --link {peer} --key-file {key_file}");
            if answers.airframe != Airframe::Quad {
                text += &format!(" --airframe {}", answers.airframe);
            }
            if init.system_id != 1 {
                text += &format!(" --system-id {}", init.system_id);
            }
            text += "\n  or PX4 SITL: ";
        } else {
            text += "  PX4 SITL: ";
        }
        text += &format!(
            "copy {} into its working folder, and start it with PX4_SIM_MODEL={}\n",
            folder_of(&files.px4).display(),
            answers.airframe.px4_model()
        );
    } else {
        text += &format!(
            "  give PX4 the key, while it is off, on its SD card in this computer:\n    {here}vsm key provision{file} --sitl-file \
             SDCARD/mavlink/mavlink-signing-key.bin\n  {here}vsm run{file}\n"
        );
    }
    text += &format!("  {here}cucs discover");
    if init.listen.to_string() != "127.0.0.1:4586" {
        text += &format!(" --vsm {}", init.listen);
    }
    if answers.cucs_id != CUCS_ID {
        text += &format!(" --id {}", answers.cucs_id);
    }
    text + "\n"
}

const TEMPLATE: &str = include_str!("init.toml");
/// What stands in it where nothing else is asked for.
const STATION: &str = "# address = \"127.0.0.1\"     # refused from anywhere else";
const SIGNING: &str =
    "signing = { key_file = {key_file} }    # PX4 has the same key: docs/guide/px4.md";
const LISTENED: &str =
    "CUCSs are not authenticated: stay on loopback, or behind a tunnel or firewall";
const KEY_FILE: &str = "uav1.key";
const DEFAULT_CONFIG: &str = "vsm.toml";
const VEHICLE_ID: Id = Id(0x1b00_0101);
/// Also that of `cucs` where it is given none.
const CUCS_ID: Id = Id(0x1b00_00a0);
const SITL_LINK: LinkAddress = LinkAddress::UdpIn(SocketAddr::V4(std::net::SocketAddrV4::new(
    std::net::Ipv4Addr::LOCALHOST,
    14_550,
)));

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Words {
        #[command(flatten)]
        init: Init,
    }

    fn init(options: &str) -> Init {
        let words = ["init"].into_iter().chain(options.split_whitespace());
        Words::try_parse_from(words).unwrap().init
    }

    fn asked(options: &str, typed: &str) -> (anyhow::Result<Answers>, String) {
        let mut shown = Vec::new();
        let answers = ask(&init(options), &mut typed.as_bytes(), &mut shown);
        (answers, String::from_utf8(shown).unwrap())
    }

    #[test]
    fn what_is_missing_is_asked_for_and_an_empty_line_is_the_default() {
        let (answers, shown) = asked("", "serial:/dev/ttyUSB0:57600\n\n1b:00:00:b0\nvtol\n");
        let answers = answers.unwrap();
        assert_eq!(answers.link.to_string(), "serial:/dev/ttyUSB0:57600");
        assert_eq!(
            (
                answers.sitl,
                answers.vehicle_id,
                answers.cucs_id,
                answers.airframe
            ),
            (false, VEHICLE_ID, Id(0x1b00_00b0), Airframe::Vtol)
        );
        assert_eq!(shown.matches("]: ").count(), 4, "{shown}");
        let (answers, shown) = asked("--link udpin:0.0.0.0:14550 --vehicle-id 1b:0:1:2", "\n\n");
        let answers = answers.unwrap();
        assert_eq!(
            (answers.vehicle_id, answers.cucs_id),
            (Id(0x1b00_0102), CUCS_ID)
        );
        assert_eq!(shown.matches("]: ").count(), 2, "{shown}");
        let (answers, _) = asked("", "\n\n\n\n");
        assert_eq!(
            answers.unwrap(),
            without_questions(&init("--sitl")).unwrap()
        );
        assert!(asked("--sitl", "").1.is_empty());
    }

    #[test]
    fn an_answer_that_cannot_be_used_is_explained_and_asked_for_again() {
        let (answers, shown) = asked(
            "",
            "tcp:1.2.3.4:5\nudpin:127.0.0.1:14550\n1b:zz\n\n\ncar\n\n",
        );
        assert_eq!(answers.unwrap().airframe, Airframe::Quad);
        for part in ["udpin:ADDRESS:PORT", "expected quad, plane or vtol"] {
            assert!(shown.contains(part), "{part}: {shown}");
        }
        assert_eq!(shown.matches("]: ").count(), 7, "{shown}");
        let ended = asked("", "sitl\n").0.unwrap_err().to_string();
        assert!(ended.contains("the vehicle"), "{ended}");
    }

    #[test]
    fn whatever_is_answered_the_configuration_is_good_and_says_it() {
        for link in [
            "udpin:0.0.0.0:14550",
            "udpout:px4.local:14550",
            "serial:/dev/tty\"\\:57600",
        ] {
            for airframe in Airframe::value_variants() {
                let options = format!(
                    "--link {link} --vehicle-id 2c:01:01:07 --cucs-id 2c:00:00:a1 --vsm-id 2c:00:00:07 --system-id 254 \
                     --listen 0.0.0.0:5000 --airframe {airframe}"
                );
                let init = init(&options);
                let text = configuration(&init, &without_questions(&init).unwrap());
                assert!(!text.contains("{v") && !text.contains("{l"), "{text}");
                let config = Config::parse(&text, Path::new("/etc")).unwrap();
                let vehicle = config.vehicles().next().unwrap();
                assert_eq!(vehicle.link.to_string(), link);
                assert_eq!((vehicle.id, vehicle.system_id), (Id(0x2c01_0107), 254));
                assert_eq!(config.stations().next().unwrap().id, Id(0x2c00_00a1));
                assert_eq!(config.dli.listen, init.listen);
            }
        }
    }

    #[test]
    fn the_example_is_what_init_writes() {
        let init = init("--sitl");
        let written = configuration(&init, &without_questions(&init).unwrap());
        assert_eq!(written, include_str!("../../../examples/vsm.toml"));
    }

    #[test]
    fn a_run_that_fails_leaves_no_file_behind() {
        let folder = tempfile::tempdir().unwrap();
        let files = Files::beside(&folder.path().join("vsm.toml"));
        // By then a folder is in the place of the configuration, so the last step fails.
        fs::create_dir(&files.config).unwrap();
        let mut made = Made::default();
        write_files(&files, "", true, &mut made).unwrap_err();
        drop(made);
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "{left:?}");
    }
}
