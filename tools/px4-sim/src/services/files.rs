//! The vehicle's card: files and folders in memory, as a flight board has them under `/fs/microsd`.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Files and folders by their absolute paths.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Files(BTreeMap<String, Content>);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Content {
    Folder,
    File(Vec<u8>),
}

/// The POSIX errors that PX4 sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Errno {
    NoEntry = 2,
    Exists = 17,
    NotFolder = 20,
    IsFolder = 21,
    ReadOnly = 30,
    NotEmpty = 39,
}

impl Default for Files {
    fn default() -> Self {
        let mut files = Self(BTreeMap::new());
        files.0.insert("/".into(), Content::Folder);
        for folder in [LOGS, "/etc/extras"] {
            files.make_folders(folder);
        }
        files
    }
}

impl Files {
    /// Writes a file, with the folders above it; it replaces what had its name.
    pub fn insert(&mut self, path: &str, content: impl Into<Vec<u8>>) {
        let path = normal(path);
        self.make_folders(parent(&path));
        self.0.insert(path, Content::File(content.into()));
    }

    /// The contents of a file.
    #[must_use]
    pub fn get(&self, path: &str) -> Option<&[u8]> {
        match self.0.get(&normal(path))? {
            Content::File(content) => Some(content),
            Content::Folder => None,
        }
    }

    /// Copies the contents of a folder of this computer to the root of the card: `fs/microsd/log/a.ulg` becomes
    /// `/fs/microsd/log/a.ulg`. Nothing is ever written back. Links and devices are left out.
    ///
    /// # Errors
    /// The error of the file system, with the path; the folder is the root of this computer; or there is more than a card
    /// in memory holds, 1 GB.
    pub fn load(&mut self, folder: &Path) -> io::Result<Loaded> {
        let mut loaded = Loaded {
            folder: folder.to_owned(),
            names: Vec::new(),
            files: 0,
            bytes: 0,
            left_out: 0,
        };
        let canonical = folder.canonicalize().map_err(|cause| at(folder, &cause))?;
        if canonical.parent().is_none() {
            let cause = "all files of this computer, expected a folder made for the vehicle's";
            return Err(at(folder, &io::Error::other(cause)));
        }
        self.load_below(folder, "/", &mut loaded)?;
        loaded.names.sort();
        Ok(loaded)
    }

    fn load_below(&mut self, folder: &Path, root: &str, loaded: &mut Loaded) -> io::Result<()> {
        for entry in std::fs::read_dir(folder).map_err(|cause| at(folder, &cause))? {
            let entry = entry.map_err(|cause| at(folder, &cause))?;
            let from = entry.path();
            let path = format!("{root}{}", entry.file_name().to_string_lossy());
            let kind = entry.file_type().map_err(|cause| at(&from, &cause))?;
            if kind.is_dir() {
                self.make_folders(&path);
                self.load_below(&from, &format!("{path}/"), loaded)?;
            } else if kind.is_file() {
                let content =
                    read(&from, LOADED - loaded.bytes).map_err(|cause| at(&from, &cause))?;
                loaded.files += 1;
                loaded.bytes += content.len() as u64;
                self.insert(&path, content);
            } else {
                loaded.left_out += 1;
                continue;
            }
            if root == "/" {
                loaded.names.push(path);
            }
        }
        Ok(())
    }

    pub(super) fn is_folder(&self, path: &str) -> bool {
        self.0.get(&normal(path)) == Some(&Content::Folder)
    }

    /// The names in a folder, with the sizes of files.
    pub(super) fn list(&self, folder: &str) -> Option<Vec<(&str, Option<usize>)>> {
        let folder = normal(folder);
        if self.0.get(&folder)? != &Content::Folder {
            return None;
        }
        let inside = self
            .0
            .iter()
            .filter(|(path, _)| *path != "/" && parent(path) == folder);
        let entries = inside.map(|(path, content)| {
            let name = path.rsplit('/').next().unwrap_or_default();
            match content {
                Content::Folder => (name, None),
                Content::File(bytes) => (name, Some(bytes.len())),
            }
        });
        Some(entries.collect())
    }

    pub(super) fn create(&mut self, path: &str, truncate: bool) -> Result<(), Errno> {
        let path = self.in_folder(path)?;
        match self.0.get_mut(&path) {
            Some(Content::Folder) => return Err(Errno::IsFolder),
            Some(Content::File(bytes)) if truncate => bytes.clear(),
            Some(Content::File(_)) => {}
            None => {
                self.0.insert(path, Content::File(Vec::new()));
            }
        }
        Ok(())
    }

    /// Writes; a gap is filled with zeros. False where the file no longer exists.
    pub(super) fn write(&mut self, path: &str, offset: u32, data: &[u8]) -> bool {
        let Some(Content::File(bytes)) = self.0.get_mut(&normal(path)) else {
            return false;
        };
        let start = offset as usize;
        let end = start + data.len();
        if end > CARD {
            return false;
        }
        bytes.resize(bytes.len().max(end), 0);
        bytes[start..end].copy_from_slice(data);
        true
    }

    pub(super) fn truncate(&mut self, path: &str, length: u32) -> Result<(), Errno> {
        match self.0.get_mut(&normal(path)) {
            Some(Content::File(bytes)) => {
                bytes.resize((length as usize).min(CARD), 0);
                Ok(())
            }
            Some(Content::Folder) => Err(Errno::IsFolder),
            None => Err(Errno::NoEntry),
        }
    }

    pub(super) fn remove_file(&mut self, path: &str) -> Result<(), Errno> {
        let path = normal(path);
        match self.0.get(&path) {
            Some(Content::File(_)) => {
                self.0.remove(&path);
                Ok(())
            }
            Some(Content::Folder) => Err(Errno::IsFolder),
            None => Err(Errno::NoEntry),
        }
    }

    pub(super) fn remove_folder(&mut self, path: &str) -> Result<(), Errno> {
        let path = normal(path);
        match self.list(&path) {
            Some(entries) if entries.is_empty() => {
                self.0.remove(&path);
                Ok(())
            }
            Some(_) => Err(Errno::NotEmpty),
            None if self.0.contains_key(&path) => Err(Errno::NotFolder),
            None => Err(Errno::NoEntry),
        }
    }

    pub(super) fn make_folder(&mut self, path: &str) -> Result<(), Errno> {
        let path = self.in_folder(path)?;
        if self.0.contains_key(&path) {
            return Err(Errno::Exists);
        }
        self.0.insert(path, Content::Folder);
        Ok(())
    }

    pub(super) fn rename(&mut self, from: &str, to: &str) -> Result<(), Errno> {
        let to = self.in_folder(to)?;
        let file = self.0.remove(&normal(from)).ok_or(Errno::NoEntry)?;
        self.0.insert(to, file);
        Ok(())
    }

    fn in_folder(&self, path: &str) -> Result<String, Errno> {
        let path = normal(path);
        match self.0.get(parent(&path)) {
            Some(Content::Folder) => Ok(path),
            Some(Content::File(_)) => Err(Errno::NotFolder),
            None => Err(Errno::NoEntry),
        }
    }

    fn make_folders(&mut self, path: &str) {
        let path = normal(path);
        for (at, _) in path.match_indices('/').skip(1) {
            self.0
                .entry(path[..at].to_owned())
                .or_insert(Content::Folder);
        }
        self.0.entry(path).or_insert(Content::Folder);
    }
}

/// What was copied to the card.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loaded {
    /// The folder of this computer.
    pub folder: PathBuf,
    /// The paths that its files and folders have on the card.
    pub names: Vec<String>,
    /// How many files, those in folders included.
    pub files: usize,
    /// How many bytes they have.
    pub bytes: u64,
    /// How many links and devices are not among them.
    pub left_out: usize,
}

impl fmt::Display for Loaded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (folder, shown) = (self.folder.display(), self.names.len().min(NAMES));
        let kinds = if self.files == 1 { "file" } else { "files" };
        write!(
            f,
            "{} {kinds} of {folder}, {} bytes",
            self.files, self.bytes
        )?;
        if shown > 0 {
            write!(f, ", as {}", self.names[..shown].join(", "))?;
        }
        if shown < self.names.len() {
            write!(f, " and {} more", self.names.len() - shown)?;
        }
        if self.left_out > 0 {
            write!(f, ", {} left out: links, devices", self.left_out)?;
        }
        Ok(())
    }
}

/// The content of a file of this computer. One that says it is empty may have content, as those of the kernel do.
fn read(file: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    File::open(file)?.take(most + 1).read_to_end(&mut content)?;
    if content.len() as u64 > most {
        let cause = format!("over {} MB with it, expected less", LOADED / 1_000_000);
        return Err(io::Error::other(cause));
    }
    Ok(content)
}

fn at(path: &Path, cause: &io::Error) -> io::Error {
    io::Error::new(cause.kind(), format!("{}: {cause}", path.display()))
}

/// The path with one slash at its beginning, and one between two parts.
fn normal(path: &str) -> String {
    let parts = path
        .split('/')
        .filter(|part| !part.is_empty() && *part != ".");
    let text: String = parts.flat_map(|part| ["/", part]).collect();
    if text.is_empty() { "/".into() } else { text }
}

fn parent(path: &str) -> &str {
    match path.rfind('/') {
        Some(0) | None => "/",
        Some(at) => &path[..at],
    }
}

/// The path of a board's card.
pub(super) const ROOT: &str = "/fs/microsd";
/// The path for `@MAV_LOG`.
pub(super) const LOGS: &str = "/fs/microsd/log";
/// Bytes of a folder of this computer beyond which it is not copied: it would be kept in memory.
const LOADED: u64 = 1_000_000_000;
/// Names at the root of the card that are listed of a folder.
const NAMES: usize = 5;
/// Bytes of one file beyond which the card is full.
const CARD: usize = 64 * 1024 * 1024;
