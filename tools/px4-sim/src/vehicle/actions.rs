//! What mission items do with the payload: a record of the camera, its trigger and the outputs, without their
//! physics.
//!
//! As in PX4 v1.18: commands for the camera are sent to the camera, one for a single picture by way of the camera
//! trigger (execute.rs). The camera trigger fires by distance flown or by time, whichever was set last, once it is
//! enabled (DO_SET_CAM_TRIGG_DIST and DO_TRIGGER_CONTROL enable it, DO_SET_CAM_TRIGG_INTERVAL does not).
//! DO_SET_ACTUATOR sets the outputs whose parameter is a number, and always 5 and 6.

use mavlink_link::service::mission::Item;

use crate::physics::motion::Ned;

/// What items have done.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Actions {
    /// The commands of the items that were carried out, in order.
    pub commands: Vec<u16>,
    /// Pictures requested of the camera.
    pub photos: u32,
    /// Whether the camera records.
    pub films: bool,
    /// Pulses of the camera trigger.
    pub triggers: u32,
    /// The outputs Peripheral via Actuator Set 1 to 6, -1 to 1; `None` where never set.
    pub outputs: [Option<f64>; 6],
    photo_every_s: Option<f64>,
    photo_at: f64,
    every: Option<Every>,
    enabled: bool,
    fired_at: f64,
    fired_from: Ned,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Every {
    Metres(f64),
    Seconds(f64),
}

impl Actions {
    /// Carries out an item.
    pub(crate) fn take(&mut self, item: &Item, now: f64, here: Ned) {
        let [p1, p2, p3, _] = item.params.map(f64::from);
        match item.command {
            IMAGE_START_CAPTURE => {
                self.photos += 1;
                self.photo_at = now;
                self.photo_every_s = (p2 > 0.0 && p3 != 1.0).then_some(p2);
            }
            IMAGE_STOP_CAPTURE => self.photo_every_s = None,
            VIDEO_START_CAPTURE => self.films = true,
            VIDEO_STOP_CAPTURE => self.films = false,
            DO_SET_CAM_TRIGG_DIST => {
                if p1 > 0.0 {
                    self.every = Some(Every::Metres(p1));
                    self.enabled = true;
                }
                if p3 > 0.0 {
                    self.triggers += 1;
                }
                (self.fired_at, self.fired_from) = (now, here);
            }
            DO_SET_CAM_TRIGG_INTERVAL if p1 > 0.0 => {
                self.every = Some(Every::Seconds(p1 / 1_000.0))
            }
            DO_TRIGGER_CONTROL => {
                self.enabled = p1 == 1.0;
                (self.fired_at, self.fired_from) = (now, here);
            }
            DO_SET_ACTUATOR => {
                let last = [f64::from(item.x), f64::from(item.y)];
                let values = item.params.map(f64::from).into_iter().chain(last);
                for (output, value) in self.outputs.iter_mut().zip(values) {
                    if value.is_finite() {
                        *output = Some(value);
                    }
                }
            }
            CHANGE_SPEED | JUMP | TRANSITION | LAND_START => return,
            _ => {}
        }
        self.commands.push(item.command);
    }

    /// Lets time pass.
    pub(crate) fn step(&mut self, now: f64, here: Ned) {
        if let Some(every_s) = self.photo_every_s
            && now - self.photo_at >= every_s
        {
            self.photos += 1;
            self.photo_at += every_s;
        }
        let due = match self.every.filter(|_| self.enabled) {
            Some(Every::Metres(metres)) => (here - self.fired_from).horizontal() >= metres,
            Some(Every::Seconds(seconds)) => now - self.fired_at >= seconds,
            None => false,
        };
        if due {
            self.triggers += 1;
            (self.fired_at, self.fired_from) = (now, here);
        }
    }
}

// MAV_CMD numbers.
const JUMP: u16 = 177;
const CHANGE_SPEED: u16 = 178;
const DO_SET_ACTUATOR: u16 = 187;
const LAND_START: u16 = 189;
const DO_SET_CAM_TRIGG_DIST: u16 = 206;
const DO_SET_CAM_TRIGG_INTERVAL: u16 = 214;
pub(crate) const IMAGE_START_CAPTURE: u16 = 2000;
pub(crate) const IMAGE_STOP_CAPTURE: u16 = 2001;
const DO_TRIGGER_CONTROL: u16 = 2003;
pub(crate) const VIDEO_START_CAPTURE: u16 = 2500;
pub(crate) const VIDEO_STOP_CAPTURE: u16 = 2501;
const TRANSITION: u16 = 3000;
