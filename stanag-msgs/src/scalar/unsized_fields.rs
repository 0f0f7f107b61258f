//! Fields whose length no source gives.

use super::Field;
use crate::codec::{Fault, Reader, Writer};
use crate::table::Wire;

macro_rules! unsized_fields {
    ($($(#[$doc:meta])* $Name:ident => $wire:ident;)*) => { $(
        $(#[$doc])*
        ///
        /// Whether it is present is known, how long it is then is not: a message that carries it
        /// can be neither decoded nor encoded, and both say so.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $Name;

        impl Field for $Name {
            const WIRE: Wire = Wire::$wire;

            fn read(_: &mut Reader<'_>) -> Result<Self, Fault> {
                Err(Fault::UnknownLength)
            }

            fn write(self, _: &mut Writer<'_>) -> Result<(), Fault> {
                Err(Fault::UnknownLength)
            }
        }
    )* };
}

unsized_fields! {
    /// A text of unknown length.
    UnsizedText => UnsizedText;
    /// Bytes of a length that another field is said to give (32301).
    UnsizedBytes => UnsizedBytes;
}
