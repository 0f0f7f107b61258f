//! A private message of this project, since no edition has a public one for it: zeroize (50024).

use super::codec::messages;
use crate::enums::FtState;
use crate::scalar::TimeStamp;

messages! {
    ZeroizeCommand = 50024, "Zeroize Command", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("provisional id; two orders, to arm and then to execute, erase keys, plans, recordings and logs of the whole VSM")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        commanded_zeroize_state: FtState = 1, "Commanded Zeroize State", note("of the zeroize, as of a flight termination");
    }
}
