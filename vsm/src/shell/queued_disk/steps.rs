//! What a thread of a queued disk is to do, in steps.
//!
//! Files whose names are the same up to the first dot are a family: `plan-1b000101.json` and `plan-1b000101.log`, or a log and
//! those put aside (`audit-1b000101.log`, `audit-1b000101.log.1`). The steps of a family are done in their order, and one that
//! fails holds up those behind it: the log of a plan names the record that it continues, and a rename moves what was added
//! before. No family waits for another, but that records wait for lines of logs (`writer`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use zeroize::Zeroizing;

/// The content of a file, which the caller reads until the thread has written it.
pub(super) type Content = Arc<Zeroizing<Vec<u8>>>;

/// Families by their names.
pub(super) type Families = BTreeMap<String, Family>;

/// The name of a file's family.
pub(super) fn family_of(name: &str) -> &str {
    name.split_once('.').map_or(name, |(family, _)| family)
}

/// A step about a file.
#[derive(Debug)]
pub(super) enum Step {
    /// It has this content.
    Replace {
        name: String,
        content: Content,
        written: Written,
    },
    /// It is a log, and these lines are added to it.
    Append { name: String, lines: Vec<u8> },
    /// The same, after a failure that may have lost what follows these bytes: the log is written whole.
    Mend {
        name: String,
        start: u64,
        lines: Vec<u8>,
    },
    /// It is renamed over another.
    Rename { from: String, to: String },
    /// It is deleted.
    Remove { name: String },
}

/// Where the content of a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Written {
    /// In memory alone.
    No,
    /// Under a temporary name.
    Beside,
    /// In its place, where the disk has no room beside.
    InPlace,
}

impl Step {
    /// The file, by the name that it has after this step.
    fn file(&self) -> &str {
        match self {
            Step::Replace { name, .. }
            | Step::Append { name, .. }
            | Step::Mend { name, .. }
            | Step::Remove { name }
            | Step::Rename { to: name, .. } => name,
        }
    }

    fn is_whole(&self) -> bool {
        matches!(self, Step::Replace { .. } | Step::Remove { .. })
    }

    fn adds(&self) -> bool {
        matches!(self, Step::Append { .. } | Step::Mend { .. })
    }
}

/// The steps of a family.
#[derive(Debug, Default)]
pub(super) struct Family {
    pub(super) steps: Vec<Step>,
    /// The last change among them.
    pub(super) change: u64,
    /// They must survive a power cut.
    pub(super) power: bool,
    /// The file of the last step, to name the family by.
    pub(super) file: String,
    /// Names in the folder have changed, which is not synchronised yet.
    pub(super) names: bool,
    /// It has failed before.
    pub(super) again: bool,
}

impl Family {
    /// Adds a step, and drops those that it makes superfluous: what waits for a slow disk is no more than its files.
    pub(super) fn push(&mut self, step: Step) {
        step.file().clone_into(&mut self.file);
        // Before a rename the same name is another file.
        let is_rename = |one: &Step| matches!(one, Step::Rename { .. });
        let from = self
            .steps
            .iter()
            .rposition(is_rename)
            .map_or(0, |at| at + 1);
        if step.is_whole() {
            let mut later = self.steps.split_off(from);
            later.retain(|one| !(one.adds() && one.file() == step.file()));
            // In its place: a log is not begun before the record that it names is there.
            match later.iter().position(|one| one.file() == step.file()) {
                Some(at) => later[at] = step,
                None => later.push(step),
            }
            return self.steps.append(&mut later);
        }
        if let Step::Append { name, lines } = &step
            && let Some(
                Step::Append {
                    name: last,
                    lines: before,
                }
                | Step::Mend {
                    name: last,
                    lines: before,
                    ..
                },
            ) = self.steps.last_mut()
            && *last == *name
        {
            return before.extend_from_slice(lines);
        }
        self.steps.push(step);
    }

    /// Adds the steps that came since.
    pub(super) fn follow(&mut self, newer: Family) {
        for step in newer.steps {
            self.push(step);
        }
        self.change = newer.change;
        self.power |= newer.power;
    }

    /// Whether these are lines of a log, before which no record is written.
    pub(super) fn is_log(&self) -> bool {
        let is_record = |one: &Step| matches!(one, Step::Replace { .. });
        self.steps.iter().any(Step::adds) && !self.steps.iter().any(is_record)
    }

    /// It has failed: after a failed synchronisation the system may count its cached pages as written, so all is written again.
    pub(super) fn fail(&mut self) {
        self.again = true;
        for step in &mut self.steps {
            if let Step::Replace { written, .. } = step {
                *written = Written::No;
            }
        }
    }
}

/// Where a file is written before it gets its name. Only its thread writes there.
pub(super) fn beside(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}{BESIDE}1"))
}

/// Separates the name of a file that is being written from a number.
pub(super) const BESIDE: &str = ".new-";

#[cfg(test)]
mod tests {
    use super::*;

    fn replace(name: &str, text: &str) -> Step {
        Step::Replace {
            name: name.to_owned(),
            content: Arc::new(Zeroizing::new(text.as_bytes().to_vec())),
            written: Written::No,
        }
    }

    fn append(name: &str, lines: &str) -> Step {
        Step::Append {
            name: name.to_owned(),
            lines: lines.as_bytes().to_vec(),
        }
    }

    fn remove(name: &str) -> Step {
        let name = name.to_owned();
        Step::Remove { name }
    }

    fn rename(from: &str, to: &str) -> Step {
        let (from, to) = (from.to_owned(), to.to_owned());
        Step::Rename { from, to }
    }

    fn text(bytes: &[u8]) -> String {
        String::from_utf8_lossy(bytes).into_owned()
    }

    fn steps(of: Vec<Step>) -> Vec<String> {
        let mut family = Family::default();
        for step in of {
            family.push(step);
        }
        let named = family.steps.iter().map(|step| match step {
            Step::Replace { name, content, .. } => format!("{name}: {}", text(content)),
            Step::Append { name, lines } => format!("{name}+ {}", text(lines)),
            Step::Mend { name, start, lines } => format!("{name}[{start}]+ {}", text(lines)),
            Step::Rename { from, to } => format!("{from} -> {to}"),
            Step::Remove { name } => format!("no {name}"),
        });
        named.collect()
    }

    #[test]
    fn a_plan_that_is_folded_again_and_again_is_its_record_and_then_its_log() {
        let mut all = vec![append("p.log", "1")];
        for record in ["a", "b", "c"] {
            all.push(replace("p.json", record));
            all.push(remove("p.log"));
            all.push(replace("p.log", record));
            all.push(append("p.log", "2"));
            all.push(append("p.log", "3"));
        }
        // Had the log the first place, a process that ends in between would leave a log without its record.
        assert_eq!(steps(all), ["p.json: c", "p.log: c", "p.log+ 23"]);
    }

    #[test]
    fn what_was_before_a_rename_stays_before_it() {
        let all = vec![
            append("a.log", "1"),
            append("a.log", "2"),
            rename("a.log.1", "a.log.2"),
            rename("a.log", "a.log.1"),
            append("a.log", "3"),
            append("a.log", "4"),
            remove("a.log.9"),
            rename("a.log", "a.log.1"),
            replace("a.log", "5"),
        ];
        assert_eq!(
            steps(all),
            [
                "a.log+ 12",
                "a.log.1 -> a.log.2",
                "a.log -> a.log.1",
                "a.log+ 34",
                "no a.log.9",
                "a.log -> a.log.1",
                "a.log: 5",
            ]
        );
    }

    #[test]
    fn files_of_one_name_up_to_the_dot_are_a_family() {
        for (name, family) in [
            ("plan-1b000101.json", "plan-1b000101"),
            ("audit-1b000101.log.12", "audit-1b000101"),
            ("clock-0102030405060708", "clock-0102030405060708"),
        ] {
            assert_eq!(family_of(name), family);
        }
    }
}
