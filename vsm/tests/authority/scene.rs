//! Three ground stations around one vehicle, and a record of what they send each other through the VSM.
#![allow(
    dead_code,
    unreachable_pub,
    missing_docs,
    reason = "each test file uses its own part"
)]

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use stanag_msgs::enums::{AckType, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, Heartbeat, PositiveHandoverAuthorisationRequest,
    VehicleDataLinkTransitionCoordination,
};
use stanag_msgs::{Id, Message};
use vsm::session::Stations;

use kit::bridge::{Faults, Rig, Setup, Station, Ticket, cucs, vehicle_id};

pub const A: usize = 0;
/// May override, of a higher rank than the others.
pub const B: usize = 1;
pub const C: usize = 2;
/// LOI 4 and 5.
pub const CONTROL: u8 = 0x0c;

pub const TABLES: &str = "
[[cucs]]
id = \"1b:00:00:b0\"
loi = [2, 3, 4, 5]
override = true
rank = 1
[[cucs]]
id = \"1b:00:00:c0\"
loi = [2, 3, 4, 5]
override = true
";

/// Payload stations 1 to 3.
pub const PAYLOADS: &str = "
[[vehicle.payload]]
station = 1
[[vehicle.payload]]
station = 2
[[vehicle.payload]]
station = 3
";

pub struct Scene {
    pub rig: Rig,
    lines: Vec<(Duration, String)>,
    from: Duration,
}

impl Scene {
    pub fn new() -> Scene {
        Scene::with(Setup {
            tables: TABLES,
            ..Setup::default()
        })
    }

    pub fn with(setup: Setup) -> Scene {
        let mut rig = Rig::new(Setup {
            vehicle_keys: PAYLOADS,
            ..setup
        });
        for (id, port) in [(Id(0x1b00_00b0), 41_000), (Id(0x1b00_00c0), 42_000)] {
            let address = ([127, 0, 0, 1], port).into();
            rig.stations.push(Station::new(id, address));
        }
        // B has proved its address: what it is sent later waits for nothing.
        let now = rig.station_now();
        rig.stations[B].send_once(now, Id::BROADCAST, Heartbeat::default().into());
        rig.run(9.0);
        let from = rig.clock.elapsed();
        Scene {
            rig,
            lines: Vec::new(),
            from,
        }
    }

    /// A good link and A in control.
    pub fn controlled() -> Scene {
        let mut scene = Scene::new();
        scene.take(A);
        scene.from = scene.rig.clock.elapsed();
        scene.lines.clear();
        scene
    }

    /// Message 1 until it is answered.
    pub fn take(&mut self, by: usize) {
        let ticket = self.ask(by, RequestedAccess::Request, CONTROL);
        assert_eq!(self.end(by, ticket), Some(AckType::CarriedOut));
    }

    pub fn ask(&mut self, by: usize, access: RequestedAccess, loi: u8) -> Ticket {
        self.ask_stations(by, access, loi, Stations::NONE)
    }

    pub fn ask_stations(
        &mut self,
        by: usize,
        access: RequestedAccess,
        loi: u8,
        stations: Stations,
    ) -> Ticket {
        let loi = LoiBitmap::from_raw(loi);
        let what = match access {
            RequestedAccess::Relinquish => "release",
            RequestedAccess::Override => "override",
            _ => "request",
        };
        self.note(by, &format!("1 {what} {}", levels(loi)));
        let message = CucsAuthorisationRequest {
            requested_handover_loi: Some(loi),
            requested_handover_access: Some(access),
            controlled_station_1_16: Some(stations.low()),
            controlled_station_17_32: Some(stations.high()),
            ..CucsAuthorisationRequest::default()
        };
        self.rig.send_as(by, 0, message)
    }

    /// Message 4 that names `acquirer`.
    pub fn hand_over(&mut self, by: usize, acquirer: usize, loi: u8) -> Ticket {
        let loi = LoiBitmap::from_raw(loi);
        self.note(
            by,
            &format!(
                "4 {}: {}",
                name(self.rig.stations[acquirer].id),
                levels(loi)
            ),
        );
        let message = PositiveHandoverAuthorisationRequest {
            requested_handover_loi: Some(loi),
            requesting_cucs_id: Some(self.rig.stations[acquirer].id),
            ..PositiveHandoverAuthorisationRequest::default()
        };
        self.rig.send_as(by, 0, message)
    }

    /// 34000.
    pub fn transition(&mut self, by: usize, acquirer: usize) -> Ticket {
        self.note(
            by,
            &format!("34000 to {}", name(self.rig.stations[acquirer].id)),
        );
        let message = VehicleDataLinkTransitionCoordination {
            acquiring_cucs_id: Some(self.rig.stations[acquirer].id),
            ..VehicleDataLinkTransitionCoordination::default()
        };
        self.rig.send_as(by, 0, message)
    }

    /// Waits 60 s at most for the end of a message.
    pub fn end(&mut self, by: usize, ticket: Ticket) -> Option<AckType> {
        self.rig
            .until(60.0, |rig| rig.stations[by].end(ticket).is_some());
        // What was sent beside the acknowledgement arrives too.
        self.rig.run(0.2);
        self.rig.stations[by].end(ticket)
    }

    /// Who controls, by the bridge's own status.
    pub fn controller(&self) -> Option<usize> {
        let status = self
            .rig
            .bridge
            .as_ref()?
            .status(String::new(), Duration::ZERO);
        let controller = status.vehicles.first()?.controller.clone()?;
        self.rig
            .stations
            .iter()
            .position(|station| station.id.to_string() == controller)
    }

    pub fn pending(&self) -> usize {
        let status = self
            .rig
            .bridge
            .as_ref()
            .map(|bridge| bridge.status(String::new(), Duration::ZERO));
        status
            .and_then(|status| Some(status.vehicles.first()?.handovers.len()))
            .unwrap_or(0)
    }

    /// Whether a station was sent a message that fits.
    pub fn received(&self, by: usize, fits: impl Fn(&Message) -> bool) -> bool {
        let received = &self.rig.stations[by].received;
        received
            .iter()
            .any(|(at, _, message)| *at >= self.from && fits(message))
    }

    pub fn note_event(&mut self, text: &str) {
        self.lines.push((
            self.rig.clock.elapsed(),
            format!("    Note over VSM: {text}"),
        ));
    }

    fn note(&mut self, by: usize, text: &str) {
        let line = format!("    {}->>VSM: {text}", name(self.rig.stations[by].id));
        self.lines.push((self.rig.clock.elapsed(), line));
    }

    /// What was sent, as a Mermaid sequence diagram.
    pub fn diagram(&self) -> String {
        let mut lines = self.lines.clone();
        for station in &self.rig.stations {
            let mut last = None;
            for (at, source, message) in &station.received {
                if *at < self.from || *source != vehicle_id(0) {
                    continue;
                }
                let Some(text) = label(message) else { continue };
                let line = format!("    VSM->>{}: {text}", name(station.id));
                // The same again, for a repeated question, is one arrow.
                if last.replace(line.clone()).as_ref() != Some(&line) {
                    lines.push((*at, line));
                }
            }
        }
        lines.sort_by_key(|(at, _)| *at);
        let mut text = "```mermaid\nsequenceDiagram\n    participant A\n    participant VSM\n    participant B\n    participant C\n".to_owned();
        for (_, line) in lines {
            let _ = writeln!(text, "{line}");
        }
        text + "```\n"
    }

    /// The diagram stands in docs/guide/authority.md under the name of the case. `AUTHORITY_DIAGRAMS=write` puts it there.
    pub fn drawn(&self, case: &str) {
        let page = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/authority.md");
        let wanted = self.diagram();
        let _lock = WRITING.lock();
        let mut text = std::fs::read_to_string(&page).expect("docs/guide/authority.md is there");
        let drawn = diagram_of(&text, case);
        if std::env::var_os("AUTHORITY_DIAGRAMS").is_some_and(|how| how == "write") {
            text.replace_range(drawn, &wanted);
            return std::fs::write(&page, text).expect("docs/guide/authority.md can be written");
        }
        assert_eq!(
            &text[drawn], wanted,
            "{case}: run with AUTHORITY_DIAGRAMS=write and look at the change"
        );
    }
}

/// Where the diagram of a case stands.
fn diagram_of(text: &str, case: &str) -> std::ops::Range<usize> {
    let heading = format!("### `{case}`\n");
    let at = text
        .find(&heading)
        .unwrap_or_else(|| panic!("docs/guide/authority.md has no {heading}"));
    let begins = at
        + text[at..]
            .find("```mermaid")
            .expect("the case has a diagram");
    let length = text[begins + 3..].find("```\n").expect("the diagram ends") + 7;
    begins..begins + length
}

static WRITING: std::sync::Mutex<()> = std::sync::Mutex::new(());

fn label(message: &Message) -> Option<String> {
    match message {
        Message::VsmAuthorisationResponse(m) => Some(format!(
            "2 holds {}",
            levels(m.loi_granted.unwrap_or_default())
        )),
        Message::PositiveHandoverAuthorisationRequest(m) => Some(format!(
            "4 {}: {}",
            name(m.requesting_cucs_id.unwrap_or_default()),
            levels(m.requested_handover_loi.unwrap_or_default())
        )),
        Message::PositiveHandoverAuthorisationGranted(m) => Some(format!(
            "5 {}",
            levels(m.loi_authorized.unwrap_or_default())
        )),
        Message::HandoverStatusReport(m) => Some(format!(
            "35000 {} to {}: {}",
            name(m.cucs_id_relinquishing_control.unwrap_or_default()),
            name(m.cucs_id_acquiring_control.unwrap_or_default()),
            m.status
                .map_or_else(String::new, |status| status.to_string())
        )),
        _ => None,
    }
}

fn levels(loi: LoiBitmap) -> String {
    let names: Vec<&str> = [(1, "2"), (2, "3"), (4, "4"), (8, "5")]
        .into_iter()
        .filter(|(bit, _)| loi.raw() & bit != 0)
        .map(|(_, name)| name)
        .collect();
    if names.is_empty() {
        "nothing".to_owned()
    } else {
        format!("LOI {}", names.join(", "))
    }
}

fn name(id: Id) -> &'static str {
    match id {
        id if id == cucs(0) => "A",
        Id(0x1b00_00b0) => "B",
        Id(0x1b00_00c0) => "C",
        _ => "nobody",
    }
}

/// A link that loses this part of its packets and holds the rest 20 to 40 ms.
pub fn lossy(loss: f64) -> Faults {
    Faults {
        loss,
        delay: (Duration::from_millis(20), Duration::from_millis(40)),
        ..Faults::NONE
    }
}
