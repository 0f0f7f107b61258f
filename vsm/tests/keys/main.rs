//! Signing keys from their first day to their last: the store, the key commands of the program (`commands`, `strangers`,
//! `unfinished`, `check_vehicle`; `ground` is the folder that they work in), keys agreed over the air, with the guards of CUCSs too (`guard_pairing`), and where keys must not show.

mod agreed_key_is_proven;
mod agreed_over_the_air;
mod check_vehicle;
mod commands;
mod ground;
mod guard_model;
mod guard_pairing;
mod key_store;
mod secrets;
mod strangers;
mod unfinished;
