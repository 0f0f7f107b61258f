//! The vehicle's card: files and folders in memory, as a flight board has them under `/fs/microsd`.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

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
    /// `/fs/microsd/log/a.ulg`. Nothing is ever written back.
    ///
    /// # Errors
    /// The error of the file system.
    pub fn load(&mut self, folder: &Path) -> io::Result<()> {
        self.load_below(folder, "/")
    }

    fn load_below(&mut self, folder: &Path, at: &str) -> io::Result<()> {
        for entry in std::fs::read_dir(folder)? {
            let entry = entry?;
            let path = format!("{at}{}", entry.file_name().to_string_lossy());
            let kind = entry.file_type()?;
            if kind.is_dir() {
                self.make_folders(&path);
                self.load_below(&entry.path(), &format!("{path}/"))?;
            } else if kind.is_file() {
                self.insert(&path, std::fs::read(entry.path())?);
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
/// Bytes of one file beyond which the card is full.
const CARD: usize = 64 * 1024 * 1024;
