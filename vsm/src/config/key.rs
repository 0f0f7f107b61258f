//! A table of the configuration file, declared once: the struct that the parser fills, and its rows of the reference.

/// One key of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct Key {
    /// Its name in the table.
    pub(super) name: &'static str,
    /// What stands where it is left out.
    pub(super) absent: WhenAbsent,
    /// What it means, and what it may be: the lines of the field's doc comment.
    pub(super) meaning: &'static [&'static str],
}

/// What stands where a key is left out.
#[derive(Debug, Clone, Copy)]
pub(super) enum WhenAbsent {
    /// The key is required.
    Required,
    /// This value, as it would stand in the file.
    Value(&'static str),
    /// No value: what the key is for is not done, or is done as this describes.
    Nothing(&'static str),
    /// It is a table, or an array of them, with keys of its own.
    Table(&'static [Key]),
    /// It is required, and is a value or a table with these keys.
    ValueOrTable(&'static [Key]),
}

/// Declares a table. After each field: what stands where the key is left out. A name in brackets is the key's in the file.
macro_rules! table {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident {
            $(
                $(#[doc = $doc:literal])*
                $(#[serde($($serde:tt)*)])*
                $field_vis:vis $field:ident $([$key:literal])?: $kind:ty => $absent:expr,
            )*
        }
    ) => {
        $(#[$meta])*
        $vis struct $name {
            $(
                $(#[doc = $doc])*
                $(#[serde($($serde)*)])*
                $field_vis $field: $kind,
            )*
        }

        impl $name {
            /// The keys whose values differ.
            #[allow(dead_code, reason = "not every table is compared by itself")]
            pub(super) fn differing(&self, other: &Self) -> Vec<&'static str> {
                let mut keys = Vec::new();
                $(
                    // By their Debug output: not every type can be compared, and no value of these tables hides anything
                    // there.
                    if format!("{:?}", self.$field) != format!("{:?}", other.$field) {
                        keys.push($crate::config::key::table!(@name $field $($key)?));
                    }
                )*
                keys
            }

            pub(super) const KEYS: &'static [$crate::config::key::Key] = &[$(
                $crate::config::key::Key {
                    name: $crate::config::key::table!(@name $field $($key)?),
                    absent: $absent,
                    meaning: &[$($doc),*],
                },
            )*];
        }
    };
    (@name $field:ident $key:literal) => { $key };
    (@name $field:ident) => { stringify!($field) };
}
pub(super) use table;
