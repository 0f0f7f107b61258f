//! This computer: what the shell has looked at, before or beside a running bridge, and what of it does not work.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use super::{Code, Finding, clock, dli, key_of};

/// What the shell found. Empty where nothing is wrong.
#[derive(Debug, Default)]
pub struct HostFacts {
    /// The wall clock, since 1970.
    pub wall: Duration,
    /// A date that the clock cannot be before.
    pub not_before: Duration,
    /// The process that uses the store.
    pub store: Option<StoreFact>,
    /// Ports, addresses and devices that cannot be used: the configuration's key, its value, the system's reason.
    pub ports: Vec<(&'static str, String, String)>,
    /// The interface of the group where it is none of this computer's, and those that there are.
    pub interface: Option<(String, Vec<String>)>,
    /// Key files that cannot be used: whose, and why.
    pub keys: Vec<(String, String)>,
    /// The group's datagrams arrive on another interface: the group, the interface, who sends them.
    pub elsewhere: Option<(SocketAddr, IpAddr, SocketAddr)>,
}

/// What is wrong with the store.
#[derive(Debug)]
pub enum StoreFact {
    /// A process has locked it and does not answer.
    Locked(String),
    /// Another VSM than the configured one answers: the store, who answers, who is configured.
    Other(String, String, String),
    /// It cannot be used, for this reason.
    Unusable(String),
}

/// What does not work.
#[must_use]
pub fn judge(facts: &HostFacts) -> Vec<Finding> {
    let mut found = vec![];
    found.extend(clock(
        facts.wall.as_secs(),
        facts.not_before.as_secs(),
        false,
    ));
    found.extend(facts.store.as_ref().map(store));
    for (key, value, why) in &facts.ports {
        found.push(Finding::new(
            Code::Port,
            value,
            format!("{key} = \"{value}\" cannot be used: {why}"),
            "stop the program that uses it (find it with \"ss -ulnp\" or \"ss -tlnp\"), or configure another",
        ));
    }
    if let Some((interface, there)) = &facts.interface {
        found.push(Finding::new(
            Code::Interface,
            interface,
            format!("dli.interface = \"{interface}\" is no interface of this computer"),
            format!("set it to one of {}", there.join(", ")),
        ));
    }
    found.extend(facts.keys.iter().map(key_file));
    found.extend(
        facts
            .elsewhere
            .map(|(group, at, from)| dli::elsewhere(group, at, from)),
    );
    found
}

fn key_file((name, why): &(String, String)) -> Finding {
    let mut finding = Finding::new(
        Code::KeyFile,
        name,
        format!("{name}: {why}"),
        "a running bridge has its keys in memory, and cannot start again without the file: see \"a key is lost\" in \
         docs/guide/troubleshooting.md",
    );
    finding.key = key_of(0, name);
    finding
}

/// Key files as the shell looks at them again and again while the bridge runs.
#[derive(Debug, Default)]
pub(crate) struct KeyFiles {
    /// What the latest look found.
    latest: Vec<(String, String)>,
    standing: Vec<Finding>,
}

impl KeyFiles {
    /// The shell has looked: the files that cannot be used, whose and why.
    pub(crate) fn note(&mut self, faults: Vec<(String, String)>) {
        // A file that is missing at one look may be one that is just being replaced.
        let twice = faults.iter().filter(|one| self.latest.contains(one));
        self.standing = twice.take(MAX_NAMED).map(key_file).collect();
        self.latest = faults;
    }

    /// What does not work: what two looks in a row have found, the first few of it. `vsm doctor` lists all.
    pub(crate) fn standing(&self) -> &[Finding] {
        &self.standing
    }
}

fn store(fact: &StoreFact) -> Finding {
    match fact {
        StoreFact::Locked(folder) => Finding::new(
            Code::StoreInUse,
            folder,
            format!("another vsm uses the store {folder} and does not answer"),
            "it is starting, stopping or hanging, or is not \"vsm run\": look for it with \"pgrep -a vsm\"; two must not share one store",
        ),
        StoreFact::Other(folder, there, configured) => Finding::new(
            Code::OtherVsm,
            folder,
            format!(
                "another vsm uses the store {folder}: VSM {there} answers, and {configured} is configured"
            ),
            "give each its own [store] dir, or restart the bridge where dli.vsm_id was changed",
        ),
        StoreFact::Unusable(why) => Finding::new(
            Code::Store,
            "store",
            why,
            "the folder must belong to the user that runs vsm, with mode 0700, on a disk that can be written",
        ),
    }
}

/// A folder that is gone has the keys of all vehicles: each is an alert.
const MAX_NAMED: usize = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_without_a_fault_have_no_finding() {
        let facts = HostFacts {
            wall: Duration::from_secs(1_795_219_200),
            not_before: Duration::from_secs(1_767_225_600),
            ..HostFacts::default()
        };
        assert_eq!(judge(&facts), []);
    }

    #[test]
    fn a_key_file_is_missed_at_the_second_look_until_it_is_back() {
        let mut files = KeyFiles::default();
        let fault = |name: &str| (name.to_owned(), "there is no key file".to_owned());
        files.note(vec![fault("vehicle 1b:00:01:01")]);
        assert_eq!(files.standing(), []);
        // That one was being replaced.
        files.note(vec![fault("vehicle 1b:00:01:02")]);
        assert_eq!(files.standing(), []);
        files.note(vec![
            fault("vehicle 1b:00:01:01"),
            fault("vehicle 1b:00:01:02"),
        ]);
        let about = |files: &KeyFiles| {
            let each = files.standing().iter().map(|one| one.about.clone());
            each.collect::<Vec<_>>()
        };
        assert_eq!(about(&files), ["vehicle 1b:00:01:02"]);
        files.note(vec![
            fault("vehicle 1b:00:01:01"),
            fault("vehicle 1b:00:01:02"),
        ]);
        let [one, two] = files.standing() else {
            panic!("{:?}", files.standing());
        };
        assert_ne!(one.key, two.key, "they would take turns as one alert");
        let all: Vec<_> = (0..100).map(|n| fault(&n.to_string())).collect();
        files.note(all.clone());
        assert_eq!(files.standing(), []);
        files.note(all);
        assert_eq!(files.standing().len(), MAX_NAMED);
        files.note(vec![]);
        assert_eq!(files.standing(), []);
    }

    #[test]
    fn each_fact_has_its_finding() {
        let here = IpAddr::from([127, 0, 0, 1]);
        let facts = HostFacts {
            wall: Duration::from_secs(100),
            not_before: Duration::from_secs(1_767_225_600),
            store: Some(StoreFact::Locked("state".to_owned())),
            ports: vec![(
                "dli.listen",
                "127.0.0.1:4586".to_owned(),
                "in use".to_owned(),
            )],
            interface: Some(("10.9.8.7".to_owned(), vec!["lo (127.0.0.1)".to_owned()])),
            keys: vec![(
                "vehicle 1b:00:01:01".to_owned(),
                "key file uav.key: missing".to_owned(),
            )],
            elsewhere: Some((
                SocketAddr::from(([225, 0, 0, 1], 51_017)),
                here,
                SocketAddr::from(([127, 0, 0, 1], 4000)),
            )),
        };
        let found = judge(&facts);
        let codes: Vec<_> = found.iter().map(|one| one.code).collect();
        let expected = [
            Code::Clock,
            Code::StoreInUse,
            Code::Port,
            Code::Interface,
            Code::KeyFile,
            Code::GroupInterface,
        ];
        assert_eq!(codes, expected);
        assert!(
            found[3].cure.contains("one of lo (127.0.0.1)"),
            "{}",
            found[3]
        );
    }
}
