//! Auxiliary status of the vehicle: 12001 and 12101.

use super::info::Confidence::{B, C};
use super::info::Direction::ToCucs;
use super::info::Layout::Ed4;
use super::info::Traffic::Push;
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::scalar::{TimeStamp, U24};

messages! {
    ElectricalReport = 12001, "Electrical Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("12001.01");
        bus_id: u8 = 1, "Bus ID", uid("12001.02");
        bus_voltage: u8 = 2, "Bus Voltage",
            uid("12001.03"), note("K Byte; 12101 uses u16; scale not found");
        bus_current: u16 = 3, "Bus Current", uid("12001.04"), note("scale not found");
        battery_time_remaining: U24 = 4, "Battery Time Remaining",
            uid("12001.05"), conf(C), width_inferred(), note("u24 or u32, unit probably s");
    }

    BatteryReport = 12101, "Battery Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
        note("scales not found")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("12101.01");
        bank_selected: u8 = 1, "Bank Selected", uid("12101.02");
        connection_status: u8 = 2, "Connection Status", uid("12101.03");
        bus_voltage: u16 = 3, "Bus Voltage", uid("12101.04");
        battery_current: i16 = 4, "Battery Current", uid("12101.05");
        battery_charge_remaining: u16 = 5, "Battery Charge Remaining", uid("12101.06");
        battery_temperature: u16 = 6, "Battery Temperature",
            uid("12101.07"), note("K, scale likely 0.5 K");
    }
}
