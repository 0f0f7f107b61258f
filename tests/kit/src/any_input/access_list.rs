//! Any bytes as an access list: it has a single written form, and nothing verifies that the key has not signed.

use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;
use vsm::session::{AccessKey, AccessList};

/// Reads the bytes as an access list.
///
/// # Panics
/// A list that was read is written differently, or verifies.
pub fn run(bytes: &[u8]) {
    let key = key();
    let mut list = match AccessList::read(bytes) {
        Ok(list) => list,
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            return;
        }
    };
    assert!(AccessList::verified(bytes, &key, list.vsm()).is_err());
    let draft = list.draft();
    assert_eq!(AccessList::read(draft.as_bytes()).as_ref(), Ok(&list));
    assert!(draft.lines().count() == 4 + list.entries().len());
    let signed = list.signed(list.version(), &key);
    let verified = AccessList::verified(signed.as_bytes(), &key, list.vsm());
    assert_eq!(verified.as_ref(), Ok(&list));
    let other = Id(list.vsm().0 ^ 1);
    assert!(AccessList::verified(signed.as_bytes(), &key, other).is_err());
}

fn key() -> AccessKey {
    AccessKey::new(&SigningKey::new([7; 32]).expect("not all zero"))
}
