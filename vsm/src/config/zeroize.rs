//! `[zeroize]`: what a zeroize erases.

use serde::Deserialize;

use super::key::WhenAbsent::Value;
use super::key::table;

table! {
    /// `[zeroize]`
    #[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Zeroize {
        /// Keep the audit logs and their key, `audit.key`; with `false` a zeroize erases them too
        /// ([zeroize.md](../guide/zeroize.md))
        pub keep_audit: bool => Value("false"),
    }
}
