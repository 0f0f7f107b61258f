//! This computer: what the shell has looked at, before or beside a running bridge, and what of it does not work.

use std::collections::BTreeSet;
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
    /// What is wrong with the store.
    pub store: Option<StoreFact>,
    /// Ports, addresses and devices that cannot be used.
    pub ports: Vec<PortFault>,
    /// The interface of the group where it is none of this computer's, and those that there are.
    pub interface: Option<(String, Vec<String>)>,
    /// Key files that cannot be used.
    pub keys: Vec<KeyFault>,
    /// The group's datagrams arrive on another interface: the group, the interface, who sends them.
    pub elsewhere: Option<(SocketAddr, IpAddr, SocketAddr)>,
    /// Why etcd does not answer, where several nodes share the store.
    pub etcd: Option<String>,
    /// No fault: the process that has the store stands by, and for what.
    pub standby: Option<String>,
    /// What else a start would end with, or serve without.
    pub start: Vec<StartFault>,
}

/// What is wrong with the store.
#[derive(Debug)]
pub enum StoreFact {
    /// A process has locked it and does not answer.
    Locked(String),
    /// Another VSM than the configured one answers: the store, who answers, who is configured.
    Other(String, String, String),
    /// It was zeroized, or is to be: the folder.
    Zeroized(String),
    /// It cannot be used, for this reason.
    Unusable(String),
    /// Its disk has no room.
    Full(String),
}

impl StoreFact {
    pub(crate) fn finding(&self) -> Finding {
        match self {
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
            StoreFact::Zeroized(folder) => Finding::new(
                Code::Zeroized,
                folder,
                format!("the store {folder} was zeroized: nothing is served from it"),
                "give it a new key, then run vsm zeroize --clear: see docs/guide/zeroize.md",
            ),
            StoreFact::Unusable(why) => Finding::new(
                Code::Store,
                "store",
                why,
                "mend that; the folder must belong to the user that runs vsm, with mode 0700, on a disk that can be written and has room",
            ),
            StoreFact::Full(why) => Finding::new(
                Code::Store,
                "store",
                why,
                "free space on it: vsm does not start without room, and refuses meanwhile what it has to keep (plans, loads, control); vehicles \
                 are flown on by whoever has control",
            ),
        }
    }
}

/// A port, address or device that cannot be used.
#[derive(Debug)]
pub struct PortFault {
    /// The key of the configuration.
    pub key: &'static str,
    /// Its value.
    pub value: String,
    /// What is wrong with it.
    pub problem: PortProblem,
    /// The system's reason.
    pub why: String,
}

/// What is wrong with a port, an address or a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortProblem {
    /// Another program has it.
    Taken,
    /// It is none of this computer.
    Elsewhere,
    /// The user may not use it.
    Denied,
    /// There is none of this name.
    Absent,
    /// Anything else.
    Other,
}

/// A key file that cannot be used, or that holds another key than the one in force.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct KeyFault {
    /// Whose: a vehicle, a CUCS, a table of the configuration.
    pub whose: String,
    /// Why.
    pub why: String,
    /// The file is good, and the running bridge has not read it since it was changed.
    pub reload: bool,
}

/// What else a start would end with, or serve without.
#[derive(Debug)]
pub struct StartFault {
    /// What it is about.
    pub what: StartPart,
    /// What the start would report.
    pub why: String,
}

/// What a start can fail at, beside store, keys and ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartPart {
    /// The file of the access list.
    AccessList,
    /// Another file or folder that the configuration names.
    File,
    /// The disk of the recordings has no room.
    FullRecording,
    /// Anything else.
    Other,
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
    found.extend(facts.store.as_ref().map(StoreFact::finding));
    found.extend(facts.etcd.as_ref().map(|why| {
        Finding::new(
            Code::Etcd,
            "etcd",
            format!("etcd does not answer: {why}"),
            "start it, or correct store.endpoints: until a member answers, this node neither serves nor takes over",
        )
    }));
    found.extend(facts.ports.iter().map(port));
    if let Some((interface, there)) = &facts.interface {
        found.push(Finding::new(
            Code::Interface,
            interface,
            format!("dli.interface = \"{interface}\" is no interface of this computer"),
            format!("set it to one of {}", there.join(", ")),
        ));
    }
    found.extend(facts.keys.iter().map(key_file));
    found.extend(facts.start.iter().map(start));
    found.extend(
        facts
            .elsewhere
            .map(|(group, at, from)| dli::elsewhere(group, at, from)),
    );
    found
}

fn port(fault: &PortFault) -> Finding {
    let PortFault {
        key,
        value,
        problem,
        why,
    } = fault;
    let cure = match problem {
        PortProblem::Taken => {
            "stop the program that uses it (find it with \"ss -ulnp\" or \"ss -tlnp\", a device with \"fuser\"), or configure another"
        }
        PortProblem::Elsewhere => {
            "name an address of this computer (\"ip address\" lists them), or 0.0.0.0 for all of them"
        }
        PortProblem::Denied => {
            "let the user that runs vsm use it (a port below 1024 needs rights, a serial device its group, such as dialout), or \
             configure another"
        }
        PortProblem::Absent => "plug it in, or correct the name",
        PortProblem::Other => "correct it, as the reason says",
    };
    Finding::new(
        Code::Port,
        value,
        format!("{key} = \"{value}\" cannot be used: {why}"),
        cure,
    )
}

fn key_file(fault: &KeyFault) -> Finding {
    let KeyFault { whose, why, reload } = fault;
    let cure = if *reload {
        "run vsm reload: until then the key before it is accepted"
    } else {
        "a running bridge has its keys in memory, and cannot start again without the file: see \"a key is lost\" in \
         docs/guide/troubleshooting.md"
    };
    let mut finding = Finding::new(Code::KeyFile, whose, format!("{whose}: {why}"), cure);
    finding.key = key_of(0, whose);
    finding
}

fn start(fault: &StartFault) -> Finding {
    let StartFault { what, why } = fault;
    match what {
        StartPart::AccessList => Finding::new(
            Code::AccessList,
            "access list",
            why,
            "sign the file again (vsm access sign): without a list in file or store vsm run does not start",
        ),
        StartPart::File => Finding::new(
            Code::File,
            "file",
            why,
            "mend the file or folder, or name another: vsm run does not start with it",
        ),
        StartPart::FullRecording => Finding::new(
            Code::File,
            "recordings",
            why,
            "make room, or name another folder: vsm run starts, and ends the recording at the first write that fails",
        ),
        StartPart::Other => Finding::new(
            Code::Start,
            "start",
            format!("vsm run would not start: {why}"),
            "mend that; vsm run ends with the same line",
        ),
    }
}

/// Key files as the shell looks at them again and again while the bridge runs.
#[derive(Debug, Default)]
pub(crate) struct KeyFiles {
    /// What the latest look found.
    latest: Vec<KeyFault>,
    standing: Vec<Finding>,
}

impl KeyFiles {
    /// The shell has looked: the files that cannot be used. Returns whether the look before has missed one of them.
    pub(crate) fn note(&mut self, faults: Vec<KeyFault>) -> bool {
        // A file that is missing at one look may be one that is just being replaced.
        let before: BTreeSet<&KeyFault> = self.latest.iter().collect();
        let twice = faults.iter().filter(|one| before.contains(one));
        self.standing = twice.take(MAX_NAMED).map(key_file).collect();
        let is_new = faults.iter().any(|one| !before.contains(one));
        self.latest = faults;
        is_new
    }

    /// A reload has read the files again: none waits for one any more.
    pub(crate) fn read_again(&mut self) {
        let waited = self.latest.iter().filter(|one| one.reload);
        let over: Vec<Finding> = waited.map(key_file).collect();
        self.standing.retain(|one| !over.contains(one));
        self.latest.retain(|one| !one.reload);
    }

    /// What does not work: what two looks in a row have found, the first few of it. `vsm doctor` lists all.
    pub(crate) fn standing(&self) -> &[Finding] {
        &self.standing
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
    fn a_key_file_that_waits_for_a_reload_does_so_no_longer_after_one() {
        let mut files = KeyFiles::default();
        let faults = [true, false].map(|reload| KeyFault {
            whose: "CUCS 1b:00:00:a0".to_owned(),
            why: format!("{reload}"),
            reload,
        });
        for _ in 0..2 {
            files.note(faults.clone().into());
        }
        assert_eq!(files.standing().len(), 2);
        files.read_again();
        assert_eq!(files.standing(), [key_file(&faults[1])]);
        // Where it has another fault, two looks find that one.
        files.note(faults.into());
        assert_eq!(files.standing().len(), 1);
    }

    #[test]
    fn a_key_file_is_missed_at_the_second_look_until_it_is_back() {
        let mut files = KeyFiles::default();
        let fault = |name: &str| KeyFault {
            whose: name.to_owned(),
            why: "there is no key file".to_owned(),
            reload: false,
        };
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
            ports: vec![PortFault {
                key: "dli.listen",
                value: "127.0.0.1:4586".to_owned(),
                problem: PortProblem::Taken,
                why: "in use".to_owned(),
            }],
            interface: Some(("10.9.8.7".to_owned(), vec!["lo (127.0.0.1)".to_owned()])),
            keys: vec![KeyFault {
                whose: "vehicle 1b:00:01:01".to_owned(),
                why: "key file uav.key: missing".to_owned(),
                reload: false,
            }],
            standby: None,
            etcd: Some("connection refused".to_owned()),
            start: [
                StartPart::AccessList,
                StartPart::File,
                StartPart::FullRecording,
                StartPart::Other,
            ]
            .map(|what| StartFault {
                what,
                why: "why".to_owned(),
            })
            .into(),
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
            Code::Etcd,
            Code::Port,
            Code::Interface,
            Code::KeyFile,
            Code::AccessList,
            Code::File,
            Code::File,
            Code::Start,
            Code::GroupInterface,
        ];
        assert_eq!(codes, expected);
        assert!(
            found[4].cure.contains("one of lo (127.0.0.1)"),
            "{}",
            found[4]
        );
    }

    #[test]
    fn what_to_do_about_a_port_depends_on_what_is_wrong() {
        for (problem, words) in [
            (PortProblem::Taken, "stop the program"),
            (PortProblem::Elsewhere, "name an address of this computer"),
            (PortProblem::Denied, "needs rights"),
            (PortProblem::Absent, "correct the name"),
            (PortProblem::Other, "as the reason says"),
        ] {
            let fault = PortFault {
                key: "dli.listen",
                value: "203.0.113.9:4586".to_owned(),
                problem,
                why: "why".to_owned(),
            };
            let cure = port(&fault).cure;
            assert!(cure.contains(words), "{problem:?}: {cure}");
        }
    }

    #[test]
    fn a_key_that_waits_for_a_reload_has_another_cure_than_one_that_is_lost() {
        let cure = |reload| {
            let fault = KeyFault {
                whose: "CUCS 1b:00:00:a0".to_owned(),
                why: "why".to_owned(),
                reload,
            };
            key_file(&fault).cure
        };
        assert!(cure(true).contains("vsm reload"), "{}", cure(true));
        assert!(cure(false).contains("a key is lost"), "{}", cure(false));
    }
}
