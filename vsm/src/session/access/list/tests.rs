use super::*;

const VSM: Id = Id(0x1b00_0001);

fn key(byte: u8) -> AccessKey {
    AccessKey::new(&SigningKey::new([byte; 32]).unwrap())
}

fn entry(cucs: u32, group: Group) -> AccessEntry {
    AccessEntry {
        cucs: Id(cucs),
        vehicle: Id(0x1b00_0101),
        group,
        key: KeyId::from_bytes([7; 8]),
        until: NonZeroU64::new(1_801_353_600),
    }
}

/// Three entries, signed.
fn signed(version: u64, by: &AccessKey) -> String {
    let mut list = AccessList::new(VSM);
    for (cucs, group) in [
        (0xa1, Group::Launch),
        (0xa0, Group::Fly),
        (0xa1, Group::Plan),
    ] {
        list.grant(entry(cucs, group)).unwrap();
    }
    list.signed(version, by)
}

fn fault(text: &str) -> ListError {
    AccessList::verified(text.as_bytes(), &key(1), VSM).unwrap_err()
}

fn lines(text: &str) -> Vec<String> {
    text.lines().map(|line| format!("{line}\n")).collect()
}

#[test]
fn a_signed_list_is_readable_and_verifies() {
    let text = signed(7, &key(1));
    let list = AccessList::verified(text.as_bytes(), &key(1), VSM).unwrap();
    assert_eq!((list.version(), list.vsm()), (7, VSM));
    let groups: Vec<_> = list
        .entries()
        .iter()
        .map(|one| (one.cucs.0, one.group))
        .collect();
    let expected = [
        (0xa0, Group::Fly),
        (0xa1, Group::Plan),
        (0xa1, Group::Launch),
    ];
    assert_eq!(groups, expected);
    assert_eq!(AccessList::read(text.as_bytes()).unwrap(), list);
    let words: Vec<&str> = text.lines().nth(3).unwrap().split(' ').collect();
    let expected = [
        "grant",
        "00:00:00:a0",
        "1b:00:01:01",
        "fly",
        "2027-01-31T00:00:00Z",
    ];
    assert_eq!(words[..5], expected);
    // Granting again replaces, revoking takes out; either way nobody has signed it.
    let mut changed = list.clone();
    changed
        .grant(AccessEntry {
            until: None,
            ..entry(0xa0, Group::Fly)
        })
        .unwrap();
    assert_eq!(changed.revoke(|one| one.cucs == Id(0xa1)), 2);
    let draft = changed.draft();
    assert!(draft.contains(" never "), "{draft}");
    assert_eq!(AccessList::read(draft.as_bytes()).unwrap(), changed);
    assert_eq!(fault(&draft), ListError::Unsigned);
}

#[test]
fn the_macs_are_those_of_the_description() {
    // Computed with Python's hmac: see the description at the top of the module.
    let text = signed(7, &key(1));
    let macs: Vec<&str> = text
        .lines()
        .skip(3)
        .filter_map(|line| line.split(' ').next_back())
        .collect();
    assert_eq!(macs, MACS);
}

#[test]
fn what_is_cut_moved_doubled_or_changed_is_refused_by_name() {
    let text = signed(7, &key(1));
    let whole = lines(&text);
    for count in 0..whole.len() {
        assert_eq!(
            fault(&whole[..count].concat()),
            ListError::Truncated,
            "{count}"
        );
    }
    let mut moved = whole.clone();
    moved.swap(3, 4);
    assert_eq!(fault(&moved.concat()), ListError::Order { line: 5 });
    let mut doubled = whole.clone();
    doubled.insert(4, whole[3].clone());
    assert_eq!(fault(&doubled.concat()), ListError::Duplicate { line: 5 });
    let mut less = whole.clone();
    less.remove(4);
    assert_eq!(
        fault(&less.concat()),
        ListError::Count { named: 3, found: 2 }
    );
    // With the count mended too: the entries that are left are genuine, and the list is not.
    let last = less.len() - 1;
    less[last] = less[last].replace("end 3", "end 2");
    assert_eq!(
        fault(&less.concat()),
        ListError::Closing { key: key(1).id() }
    );
    for (from, to) in [
        ("vsm-acl 1", "vsm-acl 2"),
        ("fly", "rule"),
        ("version 7", "version x"),
    ] {
        assert!(
            matches!(fault(&text.replace(from, to)), ListError::Line { .. }),
            "{to}"
        );
    }
    for (from, to) in [
        ("version 7", "version 07"),
        ("\n", "\r\n"),
        ("end 3", "end 03"),
        ("00:a0", "0:a0"),
    ] {
        let fault = fault(&text.replacen(from, to, 1));
        assert!(matches!(fault, ListError::Form { .. }), "{to}: {fault}");
    }
    let more = fault(&(text.clone() + "\n"));
    assert!(matches!(more, ListError::Form { .. }), "{more}");
    assert_eq!(
        AccessList::verified(&[0xff], &key(1), VSM),
        Err(ListError::NoText)
    );
    let long = vec![b' '; MAX_LIST_BYTES + 1];
    let length = long.len();
    assert_eq!(
        AccessList::verified(&long, &key(1), VSM),
        Err(ListError::TooLong(length))
    );
}

#[test]
fn an_entry_counts_in_its_own_list_alone() {
    let text = signed(7, &key(1));
    let id = key(1).id();
    let changes = [
        ("version 7", "version 8"),
        ("fly", "launch"),
        ("2027-01-31", "2028-01-31"),
        ("00:00:00:a0", "00:00:00:a2"),
        ("1b:00:01:01", "1b:00:01:02"),
        ("0707070707070707", "0707070707070708"),
    ];
    let mut alone = AccessList::new(VSM);
    alone.grant(entry(0xa0, Group::Fly)).unwrap();
    let alone = alone.signed(7, &key(1));
    for (from, to) in changes {
        let fault = fault(&alone.replacen(from, to, 1));
        assert_eq!(fault, ListError::Entry { line: 4, key: id }, "{to}");
    }
    // An entry of an older version, and of another list of the same key, in this one.
    let mut spliced = lines(&text);
    spliced[3].clone_from(&lines(&signed(6, &key(1)))[3]);
    assert_eq!(
        fault(&spliced.concat()),
        ListError::Entry { line: 4, key: id }
    );
    // Another key, another VSM.
    assert_eq!(
        fault(&signed(7, &key(2))),
        ListError::Entry { line: 4, key: id }
    );
    let other = AccessList::verified(text.as_bytes(), &key(1), Id(2)).unwrap_err();
    assert_eq!(
        other,
        ListError::OtherVsm {
            found: VSM,
            expected: Id(2)
        }
    );
    let renamed = text.replace(&VSM.to_string(), &Id(2).to_string());
    let other = AccessList::verified(renamed.as_bytes(), &key(1), Id(2)).unwrap_err();
    assert_eq!(other, ListError::Entry { line: 4, key: id });
    // A list without entries is one too: nobody may do anything.
    let none = AccessList::new(VSM).signed(1, &key(1));
    assert!(AccessList::verified(none.as_bytes(), &key(1), VSM).is_ok());
    assert_eq!(
        fault(&none.replace("version 1", "version 2")),
        ListError::Closing { key: id }
    );
}

#[test]
fn no_bit_of_a_signed_list_can_be_changed() {
    let text = signed(7, &key(1));
    for at in 0..text.len() {
        for bit in 0..8 {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1 << bit;
            assert!(
                AccessList::verified(&bytes, &key(1), VSM).is_err(),
                "byte {at}, bit {bit}"
            );
        }
    }
}

#[test]
fn a_key_shows_its_id_alone() {
    let text = format!("{:?}", key(1));
    assert_eq!(text, format!("AccessKey({})", key(1).id()));
}

const MACS: [&str; 4] = [
    "98c2c78aa9635921b08b81420d84735660b2679d58504091fb1d3508655eeff1",
    "d6b167902ab29bd41222bd0078e3fcd34c61fc0caf331a61509ca82070993040",
    "4bc11da73700eac5e47461331fdb4e215ad5044d1e3560103b3561ba3226ead7",
    "67653157f31d74f59c0105e0ad800dc5d4c8fe12b8ed0c84f759d7e591f399d5",
];
