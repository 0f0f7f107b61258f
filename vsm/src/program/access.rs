//! `vsm access`: the access list as a file. Anybody may write a draft; the holder of the access key signs it, on any
//! computer.

use std::io::{ErrorKind, Read as _};
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;

use super::process::{Failure, act_for, bad, failed, print};
use crate::config::open_file;
use crate::session::{
    AccessEntry, AccessGroup, AccessKey, AccessList, MAX_LIST_BYTES, parse_until,
};
use crate::shell::disk::{NativeFileSystem, folder_of, replace};
use crate::shell::{key_file, ownership};

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Print the entries of an access list; with the key, verify it first
    List {
        /// The access list
        file: PathBuf,
        /// Key that it must be signed by
        #[arg(long, value_name = "FILE")]
        key_file: Option<PathBuf>,
    },
    /// Add entries to an access list, which must be signed again afterwards; a list that is not there is made
    Grant(Grant),
    /// Take entries out of an access list, which must be signed again afterwards
    Revoke {
        /// The access list
        file: PathBuf,
        /// Id of the CUCS, such as 1b:00:00:a0
        #[arg(long, value_name = "ID")]
        cucs: Id,
        /// Take out those for this vehicle only, such as 1b:00:01:01
        #[arg(long, value_name = "ID")]
        vehicle: Option<Id>,
        /// Take out these groups only
        #[arg(long, value_name = "GROUP", value_delimiter = ',')]
        groups: Vec<AccessGroup>,
        /// Take out those for this guard key only, by its id
        #[arg(long, value_name = "ID", value_parser = key_id)]
        guard_key: Option<KeyId>,
    },
    /// Sign an access list as the next version; copy it to its VSM, and run `vsm reload` there
    Sign {
        /// The access list
        file: PathBuf,
        /// Key to sign it by, which its VSM has too: access.key_file, written by `vsm keygen`
        #[arg(long, value_name = "FILE")]
        key_file: PathBuf,
        /// Sign it as this version, greater than that of the file, in place of the next one
        #[arg(long, value_name = "NUMBER")]
        version: Option<u64>,
    },
}

#[derive(Debug, Args)]
pub(crate) struct Grant {
    /// The access list
    file: PathBuf,
    /// Id of the VSM, where the list is not there yet: its dli.vsm_id
    #[arg(long, value_name = "ID")]
    vsm_id: Option<Id>,
    /// Id of the CUCS, such as 1b:00:00:a0
    #[arg(long, value_name = "ID")]
    cucs: Id,
    /// Id of the vehicle, such as 1b:00:01:01
    #[arg(long, value_name = "ID")]
    vehicle: Id,
    /// Groups of messages: monitor, payload, plan, fly, settings, launch, terminate, zeroize
    #[arg(long, value_name = "GROUP", value_delimiter = ',', required = true)]
    groups: Vec<AccessGroup>,
    /// Id of the guard key of the CUCS, 16 hex digits, as `vsm guard keygen` and `vsm guard status` show it
    #[arg(long, value_name = "ID", value_parser = key_id)]
    guard_key: KeyId,
    /// Until when: never, or a time (UTC) such as 2027-01-31T00:00:00Z
    #[arg(long, value_name = "TIME", value_parser = until)]
    until: Until,
}

#[derive(Debug, Clone, Copy)]
struct Until(Option<NonZeroU64>);

fn until(text: &str) -> Result<Until, String> {
    let until = parse_until(text).map(Until);
    until.ok_or_else(|| "expected never, or a time (UTC) such as 2027-01-31T00:00:00Z".to_owned())
}

fn key_id(text: &str) -> Result<KeyId, String> {
    KeyId::parse(text).ok_or_else(|| "expected the 16 hex digits of a key's id".to_owned())
}

impl Action {
    /// The list, and the key that is used with it.
    fn files(&self) -> (&Path, Option<&Path>) {
        match self {
            Action::List { file, key_file } => (file.as_path(), key_file.as_deref()),
            Action::Grant(grant) => (grant.file.as_path(), None),
            Action::Revoke { file, .. } => (file.as_path(), None),
            Action::Sign { file, key_file, .. } => (file.as_path(), Some(key_file.as_path())),
        }
    }
}

pub(crate) fn run(action: Action) -> Result<(), Failure> {
    let (file, key) = action.files();
    // A key of root's own is read before root acts as the list's owner, who cannot read it.
    let key = key.map(|path| (path, key_file::read(path)));
    act_for(folder_of(file), &[])?;
    let key = key.map(|(path, read)| read.or_else(|_| key_file::read(path)));
    let key = key.transpose().map_err(bad)?;
    let key = key.map(|key| AccessKey::new(&key));
    match action {
        Action::List { file, .. } => show(&file, key.as_ref()),
        Action::Grant(grant) => grant.run(),
        Action::Revoke {
            file,
            cucs,
            vehicle,
            groups,
            guard_key,
        } => {
            let (_, mut list) = read(&file)?;
            let gone = list.revoke(|one| {
                one.cucs == cucs
                    && vehicle.is_none_or(|vehicle| vehicle == one.vehicle)
                    && (groups.is_empty() || groups.contains(&one.group))
                    && guard_key.is_none_or(|key| key == one.key)
            });
            if gone == 0 {
                let file = file.display();
                return Err(failed(anyhow!(
                    "{file} has no such entry: see `vsm access list {file}`"
                )));
            }
            drafted(&file, &list, &format!("{gone} entries taken out"))
        }
        Action::Sign { file, version, .. } => {
            let key = key.ok_or_else(|| failed(anyhow!("no --key-file")))?;
            sign(&file, &key, version)
        }
    }
}

impl Grant {
    fn run(self) -> Result<(), Failure> {
        let mut list = match (read(&self.file), self.vsm_id) {
            (Ok((_, list)), None) => list,
            (Ok((_, list)), Some(vsm)) if list.vsm() == vsm => list,
            (Ok((_, list)), Some(vsm)) => {
                let (file, of) = (self.file.display(), list.vsm());
                return Err(failed(anyhow!(
                    "{file} is for VSM {of}, and --vsm-id is {vsm}"
                )));
            }
            (Err(_), Some(vsm)) if !self.file.exists() => AccessList::new(vsm),
            (Err(fault), _) => return Err(fault),
        };
        for group in &self.groups {
            let entry = AccessEntry {
                cucs: self.cucs,
                vehicle: self.vehicle,
                group: *group,
                key: self.guard_key,
                until: self.until.0,
            };
            list.grant(entry).map_err(bad)?;
        }
        let count = self.groups.len();
        drafted(&self.file, &list, &format!("{count} entries granted"))
    }
}

fn drafted(file: &Path, list: &AccessList, what: &str) -> Result<(), Failure> {
    write(file, &list.draft())?;
    let file = file.display();
    print(&format!(
        "{file}: {what}; not signed: run `vsm access sign {file} --key-file KEY`\n"
    ))
}

fn sign(file: &Path, key: &AccessKey, version: Option<u64>) -> Result<(), Failure> {
    let (_, mut list) = read(file)?;
    let before = list.version();
    let version = match version {
        Some(version) if version <= before => {
            let why = anyhow!(
                "--version {version}, expected more than {before}, the version of {}",
                file.display()
            );
            return Err(failed(why));
        }
        Some(version) => version,
        None => before.checked_add(1).ok_or_else(|| {
            failed(anyhow!(
                "{} is version {before}, the last that there is: make a new list, and another key (`vsm keygen`) where a VSM has this version in force",
                file.display()
            ))
        })?,
    };
    let text = list.signed(version, key);
    write(file, &text)?;
    let (file, count, id) = (file.display(), list.entries().len(), key.id());
    print(&format!(
        "{file}: version {version}, {count} entries, signed by key {id}; copy it to VSM {}, and run `vsm reload` there\n",
        list.vsm()
    ))
}

fn show(file: &Path, key: Option<&AccessKey>) -> Result<(), Failure> {
    let (bytes, list) = read(file)?;
    let signed = match key {
        Some(key) => {
            let verified = AccessList::verified(&bytes, key, list.vsm());
            verified
                .with_context(|| file.display().to_string())
                .map_err(failed)?;
            format!("signed by key {}", key.id())
        }
        None => "not verified: give --key-file".to_owned(),
    };
    let (vsm, version) = (list.vsm(), list.version());
    let mut text = format!("VSM {vsm}, version {version}, {signed}\n");
    text += "CUCS         vehicle      group      until                 guard key\n";
    for one in list.entries() {
        let (until, group) = (one.until_text(), one.group);
        text += &format!(
            "{}  {}  {group:9}  {until:20}  {}\n",
            one.cucs, one.vehicle, one.key
        );
    }
    print(&text)
}

fn read(path: &Path) -> Result<(Vec<u8>, AccessList), Failure> {
    let mut bytes = Vec::new();
    let read = open_file(path).and_then(|file| {
        ownership::check_readable(&file.metadata()?, path)?;
        let most = MAX_LIST_BYTES as u64 + 1;
        file.take(most).read_to_end(&mut bytes)
    });
    read.map_err(|cause| {
        let hint = match cause.kind() {
            ErrorKind::NotFound => ": `vsm access grant --vsm-id ID ..` makes one",
            _ => "",
        };
        failed(anyhow!("{}: {cause}{hint}", path.display()))
    })?;
    let list = AccessList::read(&bytes);
    let list = list
        .with_context(|| path.display().to_string())
        .map_err(bad)?;
    Ok((bytes, list))
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let written = replace(&NativeFileSystem, path, text.as_bytes(), true);
    written
        .with_context(|| path.display().to_string())
        .map_err(failed)
}
