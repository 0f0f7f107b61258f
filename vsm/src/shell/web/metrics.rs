//! /metrics: counters and gauges in the text format of Prometheus (exposition format 0.0.4).

use std::fmt::{Display, Write as _};

use crate::session::{Status, VehicleStatus};

/// All of them. What a vehicle does not report has no sample: an absent battery is not an empty one, and that of a silent vehicle is
/// not what it was.
#[must_use]
pub(super) fn text(status: &Status) -> String {
    let mut all = Text::default();
    all.family(
        "uptime_seconds",
        "gauge",
        "Time since the start of the bridge.",
    );
    all.sample("", status.uptime_s);
    all.family(
        "dli_received_total",
        "counter",
        "DLI messages accepted, by message type.",
    );
    for (kind, count) in status.received.iter() {
        all.sample(&format!("type=\"{kind}\""), count);
    }
    all.family(
        "dli_sent_total",
        "counter",
        "DLI messages sent, by message type.",
    );
    for (kind, count) in status.sent.iter() {
        all.sample(&format!("type=\"{kind}\""), count);
    }
    all.family(
        "dli_refused_total",
        "counter",
        "DLI datagrams dropped and messages refused, by reason.",
    );
    for (reason, count) in status.refused.iter() {
        all.sample(&format!("reason=\"{}\"", escaped(reason)), count);
    }
    all.family(
        "station_silence_seconds",
        "gauge",
        "Time since a message of the ground station was accepted.",
    );
    for station in &status.stations {
        all.optional(&format!("cucs=\"{}\"", station.id), station.silent_s);
    }
    all.family(
        "web_client_connected",
        "gauge",
        "1 where the web client is connected to /control.",
    );
    for station in &status.stations {
        let connected = station.web.as_ref().map(|web| web.connected);
        let value = connected.map(|connected| f64::from(u8::from(connected)));
        all.optional(&format!("cucs=\"{}\"", station.id), value);
    }
    all.gauge(
        status,
        "vehicle_live",
        "1 where data of the vehicle is fresh; 0 also where none was received yet.",
        |one| Some(f64::from(u8::from(one.live))),
    );
    all.gauge(
        status,
        "vehicle_armed",
        "1 where the vehicle reports that it is armed; none of a silent vehicle.",
        |one| (one.armed.filter(|_| one.live)).map(|armed| f64::from(u8::from(armed))),
    );
    all.gauge(
        status,
        "vehicle_battery_percent",
        "Energy left; none of a silent vehicle.",
        |one| one.battery_percent.filter(|_| one.live).map(f64::from),
    );
    all.gauge(
        status,
        "vehicle_controlled",
        "1 where a ground station holds LOI 4 or 5.",
        |one| Some(f64::from(u8::from(one.controller.is_some()))),
    );
    all.family(
        "vehicle_controller",
        "gauge",
        "1 for the ground station that holds LOI 4 or 5.",
    );
    for vehicle in &status.vehicles {
        if let Some(cucs) = &vehicle.controller {
            let labels = format!("vehicle=\"{}\",cucs=\"{cucs}\"", vehicle.id);
            all.sample(&labels, 1);
        }
    }
    all.gauge(status, "vehicle_alerts", "Alerts that stand.", |one| {
        Some(one.alerts.len() as f64)
    });
    all.gauge(
        status,
        "vehicle_signed",
        "1 where frames must be signed and one has verified within 3.5 s.",
        |one| Some(f64::from(u8::from(one.link.signed && is_fresh(one)))),
    );
    all.gauge(
        status,
        "vehicle_verified_seconds",
        "Time since a frame last verified under a key.",
        |one| one.link.verified_s,
    );
    all.gauge(
        status,
        "vehicle_round_trip_seconds",
        "Round trip to the vehicle (TIMESYNC).",
        |one| one.link.round_trip_s,
    );
    all.gauge(
        status,
        "vehicle_lost_ratio",
        "Part of the vehicle's frames that did not arrive, 0 to 1.",
        |one| one.link.lost,
    );
    all.family(
        "mavlink_frames_total",
        "counter",
        "MAVLink frames of the link, by what became of them.",
    );
    for vehicle in &status.vehicles {
        for (what, count) in &vehicle.link.frames {
            let labels = format!("vehicle=\"{}\",what=\"{}\"", vehicle.id, escaped(what));
            all.sample(&labels, count);
        }
    }
    all.0
}

fn is_fresh(vehicle: &VehicleStatus) -> bool {
    vehicle.link.verified_s.is_some_and(|age_s| age_s <= 3.5)
}

#[derive(Default)]
struct Text(String, &'static str);

impl Text {
    fn family(&mut self, name: &'static str, kind: &str, help: &str) {
        let _ = write!(
            self.0,
            "# HELP vsm_{name} {help}\n# TYPE vsm_{name} {kind}\n"
        );
        self.1 = name;
    }

    fn sample(&mut self, labels: &str, value: impl Display) {
        let name = self.1;
        let _ = match labels {
            "" => writeln!(self.0, "vsm_{name} {value}"),
            _ => writeln!(self.0, "vsm_{name}{{{labels}}} {value}"),
        };
    }

    fn optional(&mut self, labels: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.sample(labels, value);
        }
    }

    fn gauge(
        &mut self,
        status: &Status,
        name: &'static str,
        help: &str,
        value: impl Fn(&VehicleStatus) -> Option<f64>,
    ) {
        self.family(name, "gauge", help);
        for vehicle in &status.vehicles {
            self.optional(&format!("vehicle=\"{}\"", vehicle.id), value(vehicle));
        }
    }
}

/// A label's value.
fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"")
}
