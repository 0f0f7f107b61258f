//! Values of authorisation and identification: LOI, access, stations.

use super::EnumInfo;
use super::macros::{bitmaps, enumerations};
use crate::table::Confidence::{B, C};

bitmaps! {
    LoiBitmap(u8) = "loi_bitmap", C, source "E2 + F; piotrmaslanka disagrees (NA=1, LOI2=2, LOI3=4, LOI4=8, LOI5=16)",
        description "LOI bits" {
        NONE = 0x0 "unspecified (request) / not authorised (authorised field) / N/A (granted)";
        LOI2 = 0x1 "LOI 2";
        LOI3 = 0x2 "LOI 3";
        LOI4 = 0x4 "LOI 4";
        LOI5 = 0x8 "LOI 5";
    }

    StationBitmap1To16(u16) = "station_bitmap_1_16", B, source "E2 (u32 in Ed2, split 1-16 / 17-32 in Ed3/4)",
        description "payload stations, bit k = station k+1; 0 = the vehicle itself (no station)" {
        NONE = 0x0 "no station / vehicle";
        STATION_1 = 0x1 "station 1";
        STATION_2 = 0x2 "station 2";
        STATION_3 = 0x4 "station 3";
        STATION_4 = 0x8 "station 4";
        .. "0x10..0x8000" "station 5..16";
    }

    StationBitmap17To32(u16) = "station_bitmap_17_32", B, source "K/T naming",
        description "bit k = station 17+k" {
    }
}

enumerations! {
    RequestedAccess(u8) = "requested_access", C, source "E2; Ed4 value set may be larger",
        description "#1 Requested/Handover Access, Ed2 'Controlled Station Mode' 0001.10" {
        Relinquish = 0 "relinquish / hand off control";
        Request = 1 "request control";
        Override = 2 "override control";
    }

    AccessGranted(u8) = "access_granted", C, source "E2 + K(uid)",
        description "#2 Access Granted keeps unique id 0021.09 = Ed2 Controlled Station Mode" {
        NotInControl = 0 "not in control";
        InControl = 1 "in control";
    }

    WaitTransition(u8) = "wait_transition", C, source "E2 0001.11",
        description "#1 wait for Vehicle Data Link Transition Coordination (#34000)" {
        DoNotWait = 0 "do not wait";
        Wait = 1 "wait for the message";
    }
}
