//! A private message: zeroize (50024).

use crate::support::row::facts;

facts! {
    50024 taken "two orders of the CUCS that holds LOI 5, to arm and then to execute: the order is stored, the VSM ends and erases keys, plans, recordings and logs; refused unless zeroize.by_message is set, and while a vehicle is not known to be disarmed or controlled by another CUCS; 17000 type 2 once the order is stored" {
        "Time Stamp": "needed: at most 2 s old, later than that of the order before, and returned in 17000";
        "Commanded Zeroize State": "0 disarms, 1 arms for zeroize.armed_s, 2 executes what the same CUCS has armed";
    }
}
