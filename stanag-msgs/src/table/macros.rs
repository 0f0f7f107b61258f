//! The macro that makes a message of a table row.

/// Declares messages: the struct, its codec in straight-line code, and its row in the table.
///
/// ```text
/// Struct = id, "name", presence bytes 3 fact(..) fact(..) ... {
///     field: Type = bit, "name", fact(..), fact(..) ...;
/// }
/// ```
///
/// The facts are the builder methods of `MessageInfo` and `FieldInfo`. A field's wire type, scale,
/// unit and enumeration come from its Rust type.
macro_rules! messages {
    ($(
        $Name:ident = $id:literal, $title:literal, presence bytes $bytes:literal
        $($fact:ident($($value:expr),*))* {
            $($field:ident: $Type:ty = $bit:literal, $label:literal $(, $note:ident($($text:expr),*))*;)*
        }
    )*) => { $(
        #[doc = concat!($title, " (", stringify!($id), ").\n")]
        #[doc = concat!($("\n- ", stringify!($fact), ": ", stringify!($($value),*),)* "\n")]
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $Name { $(
            #[doc = concat!("Field ", stringify!($bit), " (from 0): ", $label, ".\n")]
            #[doc = concat!($("\n- ", stringify!($note), ": ", stringify!($($text),*),)* "\n")]
            pub $field: Option<$Type>,
        )* }

        impl $Name {
            /// The Message Type.
            pub const ID: u16 = $id;
            /// The name.
            pub const NAME: &'static str = $title;
            /// The row in the table.
            pub const INFO: MessageInfo =
                MessageInfo::new($id, $title, stringify!($Name), $bytes, Self::FIELDS)$(.$fact($($value),*))*;

            const FIELDS: &'static [FieldInfo] =
                &[$(FieldInfo::new::<$Type>($bit, $label, stringify!($field))$(.$note($($text),*))*),*];
            const KNOWN: u64 = 0 $(| 1 << $bit)*;

            /// Reads message data: presence vector and fields.
            pub fn decode(data: &[u8]) -> Result<Self, DecodeError> {
                let mut reader = DataReader::new::<$bytes>($id, Self::KNOWN, data)?;
                let message = Self { $($field: reader.field($bit)?),* };
                reader.finish()?;
                Ok(message)
            }

            /// Writes message data, presence vector and fields, and says how many bytes.
            pub fn encode_data(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
                let mut writer = DataWriter::<$bytes>::new($id, out)?;
                $(writer.field($bit, self.$field)?;)*
                Ok(writer.finish())
            }
        }
    )* };
}

pub(super) use messages;
