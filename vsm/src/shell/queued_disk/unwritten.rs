//! What is read of a file whose changes are on their way to the disk.

use mavlink_link::store::StoreError;
use zeroize::Zeroizing;

use super::steps::Content;

/// A file with changes that are not done yet.
#[derive(Debug)]
pub(super) struct Unwritten {
    /// The last of them.
    pub(super) change: u64,
    base: Base,
    /// What was added behind that.
    lines: Vec<u8>,
    /// How many bytes of these the thread has, and the last change among them.
    given: (usize, u64),
}

/// What a file begins with.
#[derive(Debug)]
pub(super) enum Base {
    /// What the disk has of it, up to this length.
    Disk(u64),
    /// This.
    Content(Content),
    /// Nothing: there is no such file.
    Missing,
    /// What another file has, which is being renamed.
    Renamed,
}

impl Unwritten {
    pub(super) fn new(base: Base, change: u64) -> Unwritten {
        Unwritten {
            change,
            base,
            lines: Vec::new(),
            given: (0, 0),
        }
    }

    pub(super) fn append(&mut self, lines: &[u8], change: u64) {
        self.lines.extend_from_slice(lines);
        self.change = change;
    }

    pub(super) fn is_there(&self) -> bool {
        !matches!(self.base, Base::Missing) || !self.lines.is_empty()
    }

    /// Its length; `None` where only the thread knows it.
    pub(super) fn length(&self) -> Option<u64> {
        let base = match &self.base {
            Base::Disk(length) => *length,
            Base::Content(content) => content.len() as u64,
            Base::Missing => 0,
            Base::Renamed => return None,
        };
        Some(base + self.lines.len() as u64)
    }

    /// How much is not on the disk.
    pub(super) fn bytes(&self) -> u64 {
        let content = match &self.base {
            Base::Content(content) => content.len(),
            _ => 0,
        };
        (content + self.lines.len()) as u64
    }

    /// The thread has all of it.
    pub(super) fn note_given(&mut self) {
        self.given = (self.lines.len(), self.change);
    }

    /// All changes up to this one are done; returns whether any is left.
    pub(super) fn is_left_after(&mut self, change: u64) -> bool {
        let (given, last) = self.given;
        if let Base::Disk(length) = &mut self.base
            && last <= change
        {
            // A log to which something is always being added must not fill the memory.
            self.lines.drain(..given);
            *length += given as u64;
            self.given.0 = 0;
        }
        self.change > change
    }

    /// Its first bytes; `disk` reads so many of what the disk has.
    ///
    /// # Errors
    /// The disk's, or it is being renamed.
    pub(super) fn read(
        &self,
        name: &str,
        max_bytes: u64,
        disk: impl FnOnce(u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError>,
    ) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        if !self.is_there() {
            return Ok(None);
        }
        let on_disk;
        let before: &[u8] = match &self.base {
            Base::Content(content) => content,
            Base::Missing => &[],
            // The thread may have added some of the lines already.
            Base::Disk(length) => {
                on_disk = disk((*length).min(max_bytes))?.unwrap_or_default();
                &on_disk
            }
            Base::Renamed => return Err(StoreError::new(name, "it is still being renamed")),
        };
        let most = usize::try_from(max_bytes).unwrap_or(usize::MAX);
        // Allocated in full: a growing buffer leaves copies of its content behind.
        let length = most.min(before.len() + self.lines.len());
        let mut bytes = Zeroizing::new(Vec::<u8>::with_capacity(length));
        bytes.extend(before.iter().chain(&self.lines).take(most));
        Ok(Some(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_that_is_never_idle_keeps_only_what_is_on_its_way() {
        let disk = |count: u64| Ok(Some(Zeroizing::new(b"disk!"[..count as usize].to_vec())));
        let mut log = Unwritten::new(Base::Disk(4), 1);
        log.append(b"12", 1);
        log.note_given();
        log.append(b"3", 2);
        assert_eq!(**log.read("log", 99, disk).unwrap().unwrap(), *b"disk123");
        assert_eq!(**log.read("log", 5, disk).unwrap().unwrap(), *b"disk1");
        // What was given is done, the rest is on its way.
        assert!(log.is_left_after(1));
        assert_eq!((log.bytes(), log.length()), (1, Some(7)));
        log.note_given();
        assert!(!log.is_left_after(2));
        assert_eq!((log.bytes(), log.length()), (0, Some(7)));
    }
}
