//! Identification friend or foe, and electrical status: 5000 to 12101.

use super::codec::messages;
use crate::enums::{IffMode, IffOnoff};
use crate::scalar::{TimeStamp, U24};

messages! {
    IffSsrCodeCommand = 5000, "IFF/SSR Code Command", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) table("4-75?") ed2_message("1500")
        source("E2 #1500")
        note("Ed4 adds Mode S / Mode 5 and renames to IFF/SSR: do not trust the order")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1500.01");
        mode_1_code: i8 = 1, "Mode 1 Code", uid("1500.04");
        mode_1_enable: IffOnoff = 2, "Mode 1 Enable", uid("1500.05");
        mode_2_code: i16 = 3, "Mode 2 Code", uid("1500.06");
        mode_2_enable: IffOnoff = 4, "Mode 2 Enable", uid("1500.07");
        mode_3_a_code: i16 = 5, "Mode 3/A Code", uid("1500.08");
        mode_3_a_enable: IffOnoff = 6, "Mode 3/A Enable", uid("1500.09");
        mode_c_enable: IffOnoff = 7, "Mode C Enable", uid("1500.10");
        mode_4_enable: IffOnoff = 8, "Mode 4 Enable", uid("1500.11");
        mode_4_a_b: u8 = 9, "Mode 4 A/B", uid("1500.12");
        mode_4_hold: u8 = 10, "Mode 4 Hold", uid("1500.13");
        mode_4_zeroize: u8 = 11, "Mode 4 Zeroize", uid("1500.14");
        mode: IffMode = 12, "Mode", uid("1500.15");
    }

    IffSsrIdentSquawkCommand = 5001, "IFF/SSR Ident (Squawk) Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1501")
        source("E2 #1501; id 5001 inferred (Ed3 group IFF Command has 2)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1501.01");
        mode_3_a_ident: u8 = 1, "Mode 3/A Ident", uid("1501.04");
        ident_enable_duration: u16 = 2, "Ident Enable Duration",
            uid("1501.05"), unit("s"), note("0 = indefinite");
    }

    IffSsrStatusReport = 6000, "IFF/SSR Status Report", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1600")
        source("E2 #1600 (E3 confirms the id)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1600.01");
        mode_1_code: i8 = 1, "Mode 1 Code", uid("1600.04");
        mode_1_enabled: IffOnoff = 2, "Mode 1 Enabled", uid("1600.05");
        mode_2_enabled: IffOnoff = 3, "Mode 2 Enabled", uid("1600.06");
        mode_3_a_code: i16 = 4, "Mode 3/A Code", uid("1600.07");
        mode_3_a_enabled: IffOnoff = 5, "Mode 3/A Enabled", uid("1600.08");
        mode_c_enabled: IffOnoff = 6, "Mode C Enabled", uid("1600.09");
        mode_4_enable: IffOnoff = 7, "Mode 4 Enable", uid("1600.10");
        mode_4_a_b: u8 = 8, "Mode 4 A/B", uid("1600.11");
        mode_4_hold: u8 = 9, "Mode 4 Hold", uid("1600.12");
        mode: IffMode = 10, "Mode", uid("1600.13");
    }

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
