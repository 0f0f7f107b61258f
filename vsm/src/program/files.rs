//! `vsm files`: the files of a vehicle, over the link that the running bridge holds.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use mavlink_link::service::ftp::{FilePath, MAX_WRITE, crc32};
use serde_json::json;

use super::process::{Failure, Waiting, bad, failed, print, report_line, waiting, warn_of_fault};
use super::status::no_answer;
use crate::config::Stored;
use crate::shell::files_socket::{ANSWER_WITHIN, Action, Asker, Entry, Reply, Request};

/// Which bridge, and which of its vehicles.
#[derive(Debug, Args)]
pub(crate) struct Files {
    #[command(subcommand)]
    action: Verb,
    /// Configuration of the running bridge
    #[arg(long, value_name = "FILE", default_value = "vsm.toml", global = true)]
    config: PathBuf,
    /// Id of the vehicle, such as 1b:00:01:01; needed where several are configured
    #[arg(long, value_name = "ID", global = true)]
    vehicle: Option<String>,
    /// Print JSON
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// List a folder of the vehicle, such as @MAV_LOG, the folder of PX4's logs
    Ls {
        /// Folder on the vehicle
        #[arg(default_value = "/")]
        path: String,
    },
    /// Read a file of the vehicle: verify its checksum, then put it in place; continue a transfer that broke off
    Get {
        /// File on the vehicle, such as @MAV_LOG/2026-11-23/09_15_02.ulg
        path: String,
        /// Where to write it: a file, or a folder [default: its name, in the current folder]
        to: Option<PathBuf>,
        /// Replace a file that is there already
        #[arg(long)]
        force: bool,
    },
    /// Write a file to the vehicle, while it is disarmed, and verify its checksum
    Put {
        /// File of this computer, 8 MiB at most
        file: PathBuf,
        /// File on the vehicle; with a slash at its end, the folder for it
        path: String,
    },
    /// Remove a file of the vehicle, while it is disarmed
    Rm {
        /// File on the vehicle
        path: String,
        /// Remove an empty folder instead
        #[arg(long)]
        folder: bool,
    },
    /// Create a folder on the vehicle, while it is disarmed
    Mkdir {
        /// Folder on the vehicle
        path: String,
    },
}

/// Status 0: done, and where a file was transferred, both ends have the same checksum of it.
pub(crate) fn run(arguments: &Files) -> Result<(), Failure> {
    let stored = Stored::load(&arguments.config).map_err(bad)?;
    warn_of_fault(&stored);
    let bridge = Bridge {
        store: stored.dir,
        arguments,
    };
    match &arguments.action {
        Verb::Ls { path } => {
            let entries = bridge.list(path)?;
            print(&if arguments.json {
                listing_json(&entries)?
            } else {
                listing(&entries)
            })
        }
        Verb::Get { path, to, force } => bridge.get(path, to.as_deref(), *force),
        Verb::Put { file, path } => bridge.put(file, path),
        Verb::Rm { path, folder } => {
            let action = if *folder {
                Action::RemoveFolder
            } else {
                Action::Remove
            };
            bridge.once(path, action, "removed")
        }
        Verb::Mkdir { path } => bridge.once(path, Action::CreateFolder, "created"),
    }
}

struct Bridge<'a> {
    store: PathBuf,
    arguments: &'a Files,
}

/// What became of a transfer.
struct Transferred {
    size: u32,
    crc: u32,
}

impl Bridge<'_> {
    fn ask(&self, path: &str, action: Action, content: &[u8]) -> Result<Asker, Failure> {
        // The same check as in the bridge, so that a bad path is reported as a bad argument.
        let path = FilePath::new(path).map_err(bad)?.as_str().to_owned();
        let vehicle = self.arguments.vehicle.clone();
        let request = Request {
            vehicle,
            path,
            action,
        };
        Asker::ask(&self.store, &request, content)
            .map_err(|cause| failed(no_answer("vsm", &self.store, cause)))
    }

    fn list(&self, path: &str) -> Result<Vec<Entry>, Failure> {
        let mut asker = self.ask(path, Action::List, &[])?;
        let _waiting = waiting("the vehicle's list", ANSWER_WITHIN);
        match answer(&mut asker)? {
            (Reply::Listing(mut entries), _) => {
                entries.sort_by(|a, b| a.name.cmp(&b.name));
                Ok(entries)
            }
            (Reply::Refused { why, .. }, _) => Err(failed(anyhow!("{path}: {why}"))),
            (other, _) => Err(odd(&other)),
        }
    }

    fn once(&self, path: &str, action: Action, done: &str) -> Result<(), Failure> {
        let mut asker = self.ask(path, action, &[])?;
        let _waiting = waiting("the vehicle's answer", ANSWER_WITHIN);
        match answer(&mut asker)? {
            (Reply::Done { .. }, _) if self.arguments.json => {
                print(&format!("{}\n", json!({ "path": path, "done": done })))
            }
            (Reply::Done { .. }, _) => print(&format!("{path}: {done}\n")),
            (Reply::Refused { why, .. }, _) => Err(failed(anyhow!("{path}: {why}"))),
            (other, _) => Err(odd(&other)),
        }
    }

    fn get(&self, path: &str, to: Option<&Path>, force: bool) -> Result<(), Failure> {
        let to = destination(path, to)?;
        if to.exists() && !force {
            let text = format!(
                "{} is there already: name another file, or give --force",
                to.display()
            );
            return Err(bad(anyhow!(text)));
        }
        // What arrives is appended to a part file, from which the same command continues after an interruption.
        let part = part_of(&to);
        let mut file = OpenOptions::new()
            .create(true)
            .read(true)
            .append(true)
            .open(&part)
            .with_context(|| part.display().to_string())
            .map_err(failed)?;
        let (offset, crc) = checksum(&mut file)
            .with_context(|| part.display().to_string())
            .map_err(failed)?;
        let begun = Instant::now();
        let action = Action::Read { offset, crc };
        let asked = self.ask(path, action, &[]);
        // Nothing has arrived, so there is nothing to continue from.
        if asked.is_err() && offset == 0 {
            let _ = fs::remove_file(&part);
        }
        let mut asker = asked?;
        let mut progress = Progress::new(path);
        let (mut total, mut arrived) = (None, u64::from(offset));
        loop {
            let (reply, bytes) = answer(&mut asker)?;
            match reply {
                Reply::Opened(size) => {
                    total = Some(u64::from(size));
                    progress.show(arrived, total);
                }
                Reply::Data(_) => {
                    arrived += bytes.len() as u64;
                    progress.show(arrived, total);
                    // After a failed write (a full disk) the bridge must not be left with a transfer that nobody receives.
                    if let Err(cause) = file.write_all(&bytes) {
                        asker.close();
                        return Err(failed(anyhow!(cause).context(part.display().to_string())));
                    }
                }
                Reply::Done { size, crc } => {
                    // Renamed only when complete and on disk, so that the destination never holds half a file.
                    let placed = file.sync_all().and_then(|()| fs::rename(&part, &to));
                    placed
                        .with_context(|| to.display().to_string())
                        .map_err(failed)?;
                    let done = Transferred { size, crc };
                    return self.report(path, &to, &done, offset, begun);
                }
                Reply::Refused { why, anew } => {
                    let left = if anew || file.metadata().is_ok_and(|it| it.len() == 0) {
                        let _ = fs::remove_file(&part);
                        String::new()
                    } else {
                        format!(
                            "; {} has what arrived: the same command continues",
                            part.display()
                        )
                    };
                    return Err(failed(anyhow!("{path}: {why}{left}")));
                }
                other => return Err(odd(&other)),
            }
        }
    }

    fn put(&self, from: &Path, path: &str) -> Result<(), Failure> {
        let content = fs::read(from)
            .with_context(|| from.display().to_string())
            .map_err(bad)?;
        if content.len() > MAX_WRITE {
            let (name, length) = (from.display(), content.len());
            return Err(bad(anyhow!(
                "{name} has {length} bytes: expected at most {MAX_WRITE}"
            )));
        }
        let path = match from.file_name() {
            Some(name) if path.ends_with('/') => format!("{path}{}", name.to_string_lossy()),
            _ => path.to_owned(),
        };
        let begun = Instant::now();
        let length = content.len();
        let mut asker = self.ask(&path, Action::Write { length }, &content)?;
        let mut progress = Progress::new(&path);
        loop {
            match answer(&mut asker)?.0 {
                Reply::Written(bytes, of) => progress.show(bytes.into(), Some(of.into())),
                Reply::Done { size, crc } => {
                    let done = Transferred { size, crc };
                    return self.report(&path, from, &done, 0, begun);
                }
                Reply::Refused { why, .. } => return Err(failed(anyhow!("{path}: {why}"))),
                other => return Err(odd(&other)),
            }
        }
    }

    fn report(
        &self,
        path: &str,
        here: &Path,
        done: &Transferred,
        had: u32,
        begun: Instant,
    ) -> Result<(), Failure> {
        let seconds = begun.elapsed().as_secs_f64();
        let (size, crc) = (done.size, format!("{:08x}", done.crc));
        let moved = size.saturating_sub(had);
        if self.arguments.json {
            let text = json!({
                "path": path, "file": here, "bytes": size, "continued_at": had, "crc32": crc, "seconds": seconds,
            });
            return print(&format!("{text}\n"));
        }
        let kilobytes_per_s = f64::from(moved) / 1_000.0 / seconds.max(1e-6);
        print(&format!(
            "{path}: {size} bytes, {moved} of them now in {seconds:.1} s ({kilobytes_per_s:.0} kB/s), CRC32 {crc} on both \
             ends: {}\n",
            here.display()
        ))
    }
}

/// How far a transfer is, on standard error: over a radio it lasts minutes.
struct Progress<'a> {
    path: &'a str,
    /// Until the first answer, which for a file that was sent in part comes after a checksum of that part.
    first: Option<Waiting>,
    shown: Instant,
}

impl Progress<'_> {
    fn new(path: &str) -> Progress<'_> {
        Progress {
            path,
            first: Some(waiting("the vehicle to open the file", ANSWER_WITHIN)),
            shown: Instant::now(),
        }
    }

    fn show(&mut self, bytes: u64, total: Option<u64>) {
        self.first = None;
        if self.shown.elapsed() < SHOW_EVERY {
            return;
        }
        self.shown = Instant::now();
        let of = total.map_or_else(String::new, |total| format!(" of {}", total / 1_000));
        report_line(&format!("vsm: {}: {}{of} kB", self.path, bytes / 1_000));
    }
}

fn answer(asker: &mut Asker) -> Result<(Reply, Vec<u8>), Failure> {
    let answer = asker
        .receive()
        .context("the running bridge")
        .map_err(failed)?;
    answer.ok_or_else(|| {
        failed(anyhow!(
            "the bridge has hung up: it stops or restarts; try again"
        ))
    })
}

fn odd(reply: &Reply) -> Failure {
    failed(anyhow!("the bridge answers with something else: {reply:?}"))
}

fn destination(path: &str, to: Option<&Path>) -> Result<PathBuf, Failure> {
    let name = FilePath::new(path).map_err(bad)?;
    let name = name.file_name().filter(|name| !name.contains('\\'));
    let name = name.ok_or_else(|| bad(anyhow!("{path} names no file: expected a file's path")))?;
    Ok(match to {
        None => PathBuf::from(name),
        Some(to) if to.is_dir() => to.join(name),
        Some(to) => to.to_owned(),
    })
}

fn part_of(to: &Path) -> PathBuf {
    let mut name = to.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// The length of what an earlier transfer has left, and its CRC32.
fn checksum(file: &mut File) -> io::Result<(u32, u32)> {
    let (mut length, mut crc) = (0_u32, 0);
    let mut bytes = vec![0; 1 << 16];
    loop {
        let count = file.read(&mut bytes)?;
        if count == 0 {
            return Ok((length, crc));
        }
        crc = crc32(crc, &bytes[..count]);
        let longer = u32::try_from(count)
            .ok()
            .and_then(|count| length.checked_add(count));
        length = longer
            .ok_or_else(|| io::Error::other("it has over 4 GiB, which no file of a vehicle has"))?;
    }
}

fn listing(entries: &[Entry]) -> String {
    let lines = entries.iter().map(|entry| match entry.size {
        Some(size) => format!("{size:>12}  {}\n", entry.name),
        None => format!("{:>12}  {}/\n", "", entry.name),
    });
    lines.collect()
}

fn listing_json(entries: &[Entry]) -> Result<String, Failure> {
    Ok(serde_json::to_string(entries).map_err(failed)? + "\n")
}

/// A line for each so many seconds of a transfer.
const SHOW_EVERY: Duration = Duration::from_secs(2);
