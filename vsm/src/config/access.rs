//! `[access]`: the signed access list, which narrows what a CUCS may do.

use std::path::PathBuf;

use serde::Deserialize;

use super::key::WhenAbsent::Required;
use super::key::table;

table! {
    /// `[access]`
    #[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Access {
        /// File of the list, as `vsm access sign` writes it: each CUCS may send what `[[cucs]]` and the list allow. Read again by
        /// `vsm reload`; an older list, or one that does not verify, leaves the one in force ([guard.md](../guide/guard.md#the-access-list))
        pub list: PathBuf => Required,
        /// File of the key that the list is signed by: 32 bytes in hex, mode 0600, written by `vsm keygen`; no other key of this
        /// file, and of no CUCS
        pub key_file: PathBuf => Required,
    }
}
