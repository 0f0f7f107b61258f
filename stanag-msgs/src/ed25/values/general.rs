//! Values of acknowledgements and of IFF.

use super::values;

values! {
    IFF_ONOFF = "iff_onoff", Enumeration, "" {
        0 Off "off";
        1 On "on";
    }

    IFF_MODE4_AB = "iff_mode4_ab", Enumeration, "" {
        0 A "A";
        1 B "B";
    }

    IFF_HOLD = "iff_hold", Enumeration, "" {
        0 Normal "normal";
        1 Hold "hold";
    }

    IFF_ZEROIZE = "iff_zeroize", Enumeration, "" {
        0 Normal "normal";
        1 Zeroize "zeroize";
    }

    IFF_IDENT = "iff_ident", Enumeration, "" {
        0 Normal "normal";
        1 Ident "ident";
    }

    IFF_MODE = "iff_mode", Enumeration, "" {
        0 Off "off";
        1 Standby "standby";
        2 Normal "normal";
        3 Emergency "emergency";
    }
}
