//! The table at the end of the demo.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::session::Status;
use cucs::Traffic;
use px4_sim::Counters;
use stanag_msgs::table;

/// What is printed.
pub(crate) struct Summary<'a> {
    pub(crate) traffic: &'a Traffic,
    pub(crate) status: &'a Status,
    pub(crate) simulator: &'a Counters,
    pub(crate) flight_s: f64,
    pub(crate) took: Duration,
    pub(crate) speed: f64,
}

impl Summary<'_> {
    /// The text.
    pub(crate) fn text(&self) -> String {
        let mut text = String::from(
            "\nDLI messages                                       to the VSM    to the CUCS\n",
        );
        let mut types: BTreeMap<u16, (u64, u64)> = BTreeMap::new();
        for (kind, count) in self.traffic.sent.iter() {
            types.entry(kind).or_default().0 = count;
        }
        for (kind, count) in self.traffic.received.iter() {
            types.entry(kind).or_default().1 = count;
        }
        for (kind, (up, down)) in &types {
            let name = table::message(*kind).map_or("", |info| info.name);
            text += &format!(
                "  {kind:5} {name:<42} {:>10} {:>14}\n",
                blank(*up),
                blank(*down)
            );
        }
        text += "\nMAVLink messages                                   to the PX4    from the PX4\n";
        if let Some(vehicle) = self.status.vehicles.first() {
            let mut types: BTreeMap<u32, (u64, u64)> = BTreeMap::new();
            for (kind, count) in vehicle.link.sent.iter() {
                types.entry(kind).or_default().0 = count;
            }
            for (kind, count) in vehicle.link.received.iter() {
                types.entry(kind).or_default().1 = count;
            }
            for (kind, (up, down)) in &types {
                let name = crate::message_name(*kind);
                text += &format!(
                    "  {kind:5} {name:<42} {:>10} {:>14}\n",
                    blank(*up),
                    blank(*down)
                );
            }
        }
        text += "\nSigned and refused\n";
        if let Some(vehicle) = self.status.vehicles.first() {
            let frames = &vehicle.link.frames;
            let of = |name: &str| frames.get(name).copied().unwrap_or(0);
            // Frames with timestamps from before PX4's start, until a heartbeat has raised them: every start has some.
            let at_start = vehicle.link.stale_at_start;
            text += &format!(
                "  by the bridge: {} frames verified, {at_start} from before the link was live, {} sent signed",
                of("delivered_verified"),
                of("sent")
            );
            text += &refusals(
                frames
                    .iter()
                    .filter(|(name, _)| REFUSALS.contains(name))
                    .map(|(name, count)| match *name {
                        "stale" => ("stale", count.saturating_sub(at_start)),
                        name => (name, *count),
                    }),
            );
        }
        if let Some(link) = self.simulator.links.first() {
            text += &format!(
                "  by the PX4:    {} frames verified, {} sent signed",
                link.verified, link.sent_signed
            );
            text += &refusals([
                ("unsigned", link.dropped_unsigned),
                ("bad signature", link.dropped_bad_signature),
                ("old stamp", link.dropped_old_stamp),
            ]);
        }
        text += "  DLI:           ";
        text += &refusals(self.status.refused.iter()).replacen("; refused: ", "refused: ", 1);
        text
    }

    /// How long it all took.
    pub(crate) fn times(&self) -> String {
        format!(
            "flight of {:.0} s in {:.1} s, the simulator at {} times real time",
            self.flight_s,
            self.took.as_secs_f64(),
            self.speed
        )
    }
}

fn blank(count: u64) -> String {
    if count == 0 {
        String::new()
    } else {
        count.to_string()
    }
}

fn refusals<'a>(counts: impl IntoIterator<Item = (&'a str, u64)>) -> String {
    let counts: Vec<String> = counts
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    let counts = if counts.is_empty() {
        "none".to_owned()
    } else {
        counts.join(", ")
    };
    format!("; refused: {counts}\n")
}

/// The counters of the link that are refusals.
const REFUSALS: &[&str] = &[
    "bad_crc",
    "mavlink1",
    "unknown_incompat",
    "truncated",
    "reflected",
    "unexpected_system",
    "unexpected_link",
    "unsigned_vehicle",
    "unsigned_stranger",
    "bad_signature",
    "stream_table_full",
    "future",
    "stale",
    "late",
    "wrong_peer",
];
