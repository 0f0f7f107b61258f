//! What passes between the agent and PX4, seen on the wire: what the vehicle was commanded and when, the mission that it
//! accepted, and how it stands, without asking any program under test.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use kit::relay::End;
use mavlink_link::dialect::{MavCmd, MavMessage, MavMissionResult, MavMissionType, MavModeFlag};
use mavlink_link::frame::Parser;

/// Something that the vehicle was commanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Command {
    /// DO_REPOSITION or NAV_TAKEOFF: to metres above mean sea level.
    Altitude(f64),
    /// MISSION_COUNT: an upload begins.
    Upload,
    /// SETUP_SIGNING.
    Key,
}

/// The vehicle as its own frames show it.
#[derive(Debug, Default)]
pub(super) struct Vehicle {
    pub(super) armed: bool,
    /// Metres above home.
    pub(super) height_m: f64,
    /// Since the last look.
    commands: Vec<(Instant, Command)>,
    /// Items of an upload that is under way, degrees.
    items: Vec<(f64, f64)>,
    /// The mission that it has accepted last, degrees.
    pub(super) mission: Vec<(f64, f64)>,
}

/// The wire's end for the test.
#[derive(Debug, Clone, Default)]
pub(super) struct Tap(Arc<Mutex<Vehicle>>);

impl Tap {
    /// What a relay between the two shows its datagrams to.
    pub(super) fn observer(&self) -> impl FnMut(End, &[u8]) + Send + 'static {
        let tap = self.clone();
        move |to, bytes| {
            let mut parser = Parser::new();
            let mut frames = parser.feed(bytes);
            while let Some(frame) = frames.next() {
                if let Ok(message) = frame.map(|frame| frame.message())
                    && let Ok(message) = message
                {
                    tap.look(|vehicle| vehicle.note(to, &message));
                }
            }
        }
    }

    pub(super) fn look<T>(&self, at: impl FnOnce(&mut Vehicle) -> T) -> T {
        at(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// What was commanded since the last call.
    pub(super) fn commands(&self) -> Vec<(Instant, Command)> {
        self.look(|vehicle| std::mem::take(&mut vehicle.commands))
    }
}

impl Vehicle {
    // PX4 is the client of the relay.
    fn note(&mut self, to: End, message: &MavMessage) {
        let command = match (to, message) {
            (End::Server, MavMessage::HEARTBEAT(beat)) => {
                let armed = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
                self.armed = beat.base_mode.contains(armed);
                return;
            }
            (End::Server, MavMessage::GLOBAL_POSITION_INT(position)) => {
                self.height_m = f64::from(position.relative_alt) / 1e3;
                return;
            }
            (End::Server, MavMessage::MISSION_ACK(ack)) => {
                let whole = ack.mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION
                    && ack.mavtype == MavMissionResult::MAV_MISSION_ACCEPTED;
                if whole && !self.items.is_empty() {
                    self.mission.clone_from(&self.items);
                }
                return;
            }
            (End::Client, MavMessage::MISSION_ITEM_INT(item)) => {
                let index = usize::from(item.seq);
                if self.items.len() <= index {
                    self.items.resize(index + 1, (0.0, 0.0));
                }
                self.items[index] = (f64::from(item.x) / 1e7, f64::from(item.y) / 1e7);
                return;
            }
            (End::Client, MavMessage::MISSION_COUNT(count))
                if count.mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION =>
            {
                // Repeated it restarts nothing: what is left of an upload that was cut off is sent again, too.
                self.items.resize(count.count.into(), (0.0, 0.0));
                Command::Upload
            }
            (End::Client, MavMessage::COMMAND_INT(command))
                // A hold has no altitude.
                if command.command == MavCmd::MAV_CMD_DO_REPOSITION && command.z.is_finite() =>
            {
                Command::Altitude(command.z.into())
            }
            (End::Client, MavMessage::COMMAND_LONG(command))
                if command.command == MavCmd::MAV_CMD_NAV_TAKEOFF =>
            {
                Command::Altitude(command.param7.into())
            }
            (End::Client, MavMessage::SETUP_SIGNING(_)) => Command::Key,
            _ => return,
        };
        self.commands.push((Instant::now(), command));
    }
}
