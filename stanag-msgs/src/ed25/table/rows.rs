//! The macro that makes rows of the table of Edition 2.5.

/// Declares the messages of a group, as `GROUP`:
///
/// ```text
/// Name = id, "name" fact(..) fact(..) ... {
///     field: Wire = number, "name", fact(..), fact(..) ...;
/// }
/// ```
///
/// Fields are numbered from 1, as in the text, and as #1200 and #1300 to #1303 refer to them. The facts are the
/// builder methods of `MessageInfo` and `FieldInfo`. There are no structs: only the border of the codec handles these
/// messages, and it treats them all alike.
macro_rules! messages {
    ($(
        $Name:ident = $id:literal, $title:literal $($fact:ident($($value:expr),*))* {
            $($field:ident: $Wire:ident $(($length:literal))? = $number:literal, $label:literal $(, $note:ident($($text:expr),*))*;)*
        }
    )*) => {
        pub(super) static GROUP: &[$crate::table::MessageInfo] = {
            #[allow(unused_imports, reason = "not every group uses every fact")]
            use $crate::{field::Confidence::*, table::{Direction::*, Traffic::*}};
            &[$(
                $crate::table::MessageInfo::new($id, $title, stringify!($Name), 0, &[$(
                    $crate::field::FieldInfo::of($Wire $(($length))?, $number - 1, $label, stringify!($field))
                        $(.$note($($text),*))*
                ),*])$(.$fact($($value),*))*
            ),*]
        };
    };
}

pub(super) use messages;
