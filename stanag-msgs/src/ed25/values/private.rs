//! Values of the private messages.

use super::values;

values! {
    PARAMETER_KIND = "parameter_kind", Enumeration, "what a parameter of the vehicle is" {
        0 Integer "integer of 32 bits";
        1 Float "float of 32 bits";
    }
}
