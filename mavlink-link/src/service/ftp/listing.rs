//! Entries of a directory: `F` name, tab and size; `D` name; `S` for one that the vehicle skips; each ended by a zero byte.

use super::failure::Lie;

/// What an entry is.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash, PartialOrd, Ord)]
pub enum Kind {
    /// A folder.
    Directory,
    /// A file with its size in bytes.
    File(u32),
}

/// One entry of a directory.
#[derive(Clone, PartialEq, Eq, Debug, Hash, PartialOrd, Ord)]
pub struct Entry {
    /// Its name, without a folder.
    pub name: String,
    /// What it is.
    pub kind: Kind,
}

/// Appends the entries of one answer, and returns how many the vehicle counts, those that it skips among them.
///
/// # Errors
/// An entry that is none, or a name that would lead out of the directory.
pub(super) fn append(entries: &mut Vec<Entry>, data: &[u8]) -> Result<u32, Lie> {
    let mut count = 0;
    let mut texts = data.split(|byte| *byte == 0).collect::<Vec<_>>();
    // PX4 ends each entry by a zero byte, so that nothing follows the last one.
    if texts.last().is_some_and(|last| last.is_empty()) {
        texts.pop();
    }
    for text in texts {
        count += 1;
        // An entry of the peer goes into an error text, so its length is bounded.
        let lie = || Lie::Entry(String::from_utf8_lossy(text).chars().take(80).collect());
        let (kind, rest) = text.split_first().ok_or_else(lie)?;
        let rest = std::str::from_utf8(rest).map_err(|_| lie())?;
        let (name, kind) = match kind {
            b'S' => continue,
            b'D' => (rest, Kind::Directory),
            b'F' => {
                let (name, size) = rest.split_once('\t').ok_or_else(lie)?;
                (name, Kind::File(size.parse().map_err(|_| lie())?))
            }
            _ => return Err(lie()),
        };
        if matches!(name, "." | "..") && kind == Kind::Directory {
            // ArduPilot lists both; PX4 marks them as skipped (`S`).
            continue;
        }
        // The name becomes a path on our disk, so a hostile one must not leave its folder.
        let leads_out = name.is_empty()
            || name == ".."
            || name.contains(['/', '\\'])
            || name.chars().any(char::is_control);
        if leads_out {
            return Err(lie());
        }
        let name = name.to_owned();
        entries.push(Entry { name, kind });
    }
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(data: &[u8]) -> Result<(u32, Vec<Entry>), Lie> {
        let mut entries = Vec::new();
        append(&mut entries, data).map(|count| (count, entries))
    }

    #[test]
    fn files_folders_and_what_is_skipped() {
        let (count, entries) = read(b"Da\0S\0Fb.ulg\t12\0").unwrap();
        assert_eq!(count, 3);
        let entry = |name: &str, kind| Entry {
            name: name.into(),
            kind,
        };
        let expected = [entry("a", Kind::Directory), entry("b.ulg", Kind::File(12))];
        assert_eq!(entries, expected);
    }

    #[test]
    fn an_entry_that_is_none_is_refused_by_its_text() {
        for bad in [
            "Xa",
            "Fa",
            "Fa\tx",
            "F../a\t1",
            "F..\t1",
            "Da/b",
            "D",
            "Fa\t99999999999",
        ] {
            let mut data = bad.as_bytes().to_vec();
            data.push(0);
            assert_eq!(read(&data), Err(Lie::Entry(bad.into())), "{bad}");
        }
    }
}
