//! Values of the configuration phase.

use super::EnumInfo;
use super::macros::enumerations;
use crate::table::Confidence::{B, C};

enumerations! {
    FieldSupported(u8) = "field_supported", B, source "E2" {
        NotSupported = 0 "field not supported";
        Supported = 1 "field supported";
    }

    ConfigRequestType(u8) = "config_request_type", C, source "E2 1200.06",
        description "Field Configuration Request" {
        SingleParameter = 0 "single parameter";
        Loi2 = 1 "LOI 2";
        Loi3 = 2 "LOI 3";
        Loi4 = 3 "LOI 4";
        Loi5 = 4 "LOI 5";
        DataLink = 5 "data link";
        Abort = 6 "abort configuration";
    }

    FieldAvailable(u8) = "field_available", B, source "E2 1303.08" {
        NotAvailable = 0 "not available for selection";
        Available = 1 "available for selection";
    }

    EnumIndexEnable(i8) = "enum_index_enable", B, source "E2 1303.10",
        description "signed" {
        NotImplemented = -2 "not implemented (index not supported)";
        Unavailable = -1 "unavailable for selection";
        Available = 0 "available for selection";
    }
}
