//! Payload commands of Edition 2.5 (#200, #201). Each carries all of its fields, so a field that is not commanded has
//! to repeat what the station does already, or it would be commanded as well. A #201 whose System Operating Mode is
//! left at 0 stows the payload.
//!
//! So a #201 repeats what #302 has shown. A #200 repeats the last #200 since the pointing mode was commanded,
//! otherwise what #302 has shown.

use std::collections::BTreeMap;

use stanag_msgs::Message;
use stanag_msgs::ed25::Record;
use stanag_msgs::enums::{EoirPointingMode as Pointing, EoirSystemMode as System, SetZoom};
use stanag_msgs::messages::EoIrLaserOperatingState;

use super::places::{NoCounterpart, all_placed, empty};

/// The payload stations of a vehicle, by their bitmap.
#[derive(Clone, Debug, Default)]
pub(super) struct Payloads(BTreeMap<u32, Payload>);

#[derive(Clone, Debug, Default)]
struct Payload {
    /// The last #302, translated to Edition 4.
    state: Option<EoIrLaserOperatingState>,
    /// The last commanded pointing mode.
    mode: Option<Pointing>,
    /// The last #200.
    steered: Option<Record>,
    /// Whether that was sent after the pointing mode: then its angles, rates and place still apply.
    aimed: bool,
}

impl Payloads {
    /// Notes a report of a station.
    pub(super) fn note(&mut self, state: &EoIrLaserOperatingState) {
        let station = state.station_number_1_16.map_or(0, u32::from);
        if station.is_power_of_two() {
            self.0.entry(station).or_default().state = Some(state.clone());
        }
    }

    /// The last report of a station.
    pub(super) fn state(&self, station: u32) -> Option<&EoIrLaserOperatingState> {
        self.0.get(&station)?.state.as_ref()
    }

    /// #201.
    pub(super) fn sensor(&mut self, ed4: &Record) -> Result<Record, NoCounterpart> {
        all_placed(&[SENSOR], ed4)?;
        let payload = self.0.entry(ed4.whole(STATION)).or_default();
        let shown = payload.shown("201")?;
        let mut record = empty(SENSOR)?;
        record.set(5, shown.number(3).unwrap_or(EO));
        let system = shown.number(4).map(|mode| System::from_raw(mode as u8));
        let names_pointing = ed4.whole(8) != 0;
        record.set(
            6,
            match system {
                // A stowed payload cannot point: a command with a pointing mode makes it active.
                Some(System::Stow) if names_pointing => System::Active.raw(),
                Some(mode) => mode.raw(),
                None => System::Active.raw(),
            },
        );
        record.set(7, shown.number(5).unwrap_or(COLOUR));
        record.set(8, shown.whole(6));
        record.set(9, shown.whole(7));
        let mode = payload
            .mode
            .map_or(shown.whole(17), |mode| mode.raw().into());
        record.set(10, mode);
        record.set(12, FIRST_PULSE);
        record.set(15, MANUAL);
        record.take_from(ed4);
        if names_pointing {
            let mode = Pointing::from_raw(ed4.whole(8) as u8);
            payload.aimed &= payload.mode == Some(mode);
            payload.mode = Some(mode);
        }
        Ok(record)
    }

    /// #200.
    pub(super) fn steering(&mut self, ed4: &Record) -> Result<Record, NoCounterpart> {
        all_placed(&[STEERING], ed4)?;
        let payload = self.0.entry(ed4.whole(STATION)).or_default();
        let shown = payload.shown("200")?;
        let mut record = match &payload.steered {
            Some(before) => before.clone(),
            None => {
                let mut first = empty(STEERING)?;
                first.set(7, SetZoom::NoChange.raw());
                first
            }
        };
        if !payload.aimed {
            // Angles, rates and place; the pointing mode selects among them.
            let fields = [(5, 10), (6, 8), (12, 14), (13, 15), (14, 16)];
            for (field, of) in fields {
                record.set(field, shown.number(of).unwrap_or(0.0));
            }
            record.set(10, 0);
            record.set(11, 0);
            record.set(15, WGS84);
            let known = match payload.mode {
                Some(Pointing::AngleToUa) => shown.number(10).is_some(),
                Some(Pointing::LatLongSlaved) => shown.whole(13) == 1,
                _ => true,
            };
            let names = [3, 10].iter().any(|field| ed4.number(*field).is_some());
            if !known && !names {
                let why = "#200 always names where to look, and #302 has not shown where it does";
                return Err(NoCounterpart(why.to_owned()));
            }
        }
        // A step of focus must not be repeated.
        record.set(16, 0);
        record.take_from(ed4);
        payload.steered = Some(record.clone());
        payload.aimed = true;
        Ok(record)
    }
}

impl Payload {
    /// The last #302, by the fields of 21101.
    fn shown(&self, number: &str) -> Result<Record, NoCounterpart> {
        let state = self.state.clone().ok_or_else(|| {
            NoCounterpart(format!(
                "#{number} always carries all of its fields, and the payload station has not shown yet what it does (#302): take LOI 3 \
                 of it, or request its state first"
            ))
        })?;
        Ok(Record::of(&Message::EoIrLaserOperatingState(state)))
    }
}

/// What #302 has to report before a payload command counts as carried out: Edition 2.5 acknowledges its arrival only.
#[derive(Debug, Default)]
pub(super) struct Shows {
    pub(super) station: u32,
    system: Option<System>,
    pointing: Option<Pointing>,
    /// Azimuth and elevation, rad.
    angles: Option<[f64; 2]>,
    /// Horizontal field of view, rad.
    field: Option<f64>,
}

impl Shows {
    /// `None` for a message that is not a payload command.
    pub(super) fn of(message: &Message) -> Option<Shows> {
        match message {
            Message::EoIrLaserPayloadCommand(m) => Some(Shows {
                station: m.station_number_1_16?.raw().into(),
                system: m.system_operating_mode.filter(|mode| {
                    matches!(mode, System::Stow | System::Active) || *mode == RECORDING
                }),
                pointing: m.set_eo_ir_pointing_mode,
                ..Shows::default()
            }),
            Message::PayloadSteeringCommand(m) => Some(Shows {
                station: m.station_number_1_16?.raw().into(),
                angles: m
                    .set_centreline_azimuth_angle
                    .zip(m.set_centreline_elevation_angle)
                    .map(|(azimuth, elevation)| [azimuth.radians(), elevation.radians()]),
                field: m.set_horizontal_field_of_view.map(|field| field.radians()),
                ..Shows::default()
            }),
            _ => None,
        }
    }

    pub(super) fn is_met(&self, state: &EoIrLaserOperatingState) -> bool {
        let near = |wanted: f64, seen: f64| {
            use std::f64::consts::{PI, TAU};
            ((seen - wanted + PI).rem_euclid(TAU) - PI).abs() <= NEAR_RAD
        };
        let seen = [
            state.actual_centreline_azimuth_angle,
            state.actual_centreline_elevation_angle,
        ];
        let looks = self.angles.is_none_or(|wanted| {
            let mut pairs = wanted.iter().zip(seen);
            pairs.all(|(wanted, seen)| seen.is_some_and(|seen| near(*wanted, seen.radians())))
        });
        let field = state.actual_horizontal_field_of_view;
        looks
            && (self.system).is_none_or(|mode| state.system_operating_mode_state == Some(mode))
            && (self.pointing).is_none_or(|mode| state.pointing_mode_state == Some(mode))
            && (self.field)
                .is_none_or(|wanted| field.is_some_and(|seen| near(wanted, seen.radians())))
    }
}

// Message Types of Edition 2.5.
const STEERING: u16 = 200;
const SENSOR: u16 = 201;
/// Station Number 1-16 of 19001 and 19100.
const STATION: u8 = 2;
const RECORDING: System = System::Unknown(10);
const EO: f64 = 1.0;
const COLOUR: f64 = 1.0;
const FIRST_PULSE: u32 = 1;
/// Preplan Mode: operated by hand.
const MANUAL: u32 = 1;
const WGS84: u32 = 3;
/// Tolerance of the report, rad: 3 degrees, as in the VSM.
const NEAR_RAD: f64 = 0.053;
