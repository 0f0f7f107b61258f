//! Requests what gimbals and cameras can do, and the state of cameras, since they send little of it by themselves.
//!
//! Nothing is requested before a device has reported by itself: a vehicle without payload is sent no requests, and its
//! radio carries none.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink_link::dialect::{CameraCapFlags, MavResult};
use mavlink_link::service::command::{Outcome, Ticket};

use super::step::{
    CAMERA_CAPTURE_STATUS, CAMERA_FOV_STATUS, CAMERA_INFORMATION, CAMERA_SETTINGS,
    GIMBAL_MANAGER_INFORMATION, STORAGE_INFORMATION, VIDEO_STREAM_INFORMATION, VIDEO_STREAM_STATUS,
    request,
};
use crate::session::context::Context;
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct Discovery {
    /// By component and requested message: the next time, and how often it was refused.
    next: BTreeMap<(u8, u16), (Duration, u32)>,
    /// The same, before this call of `advance`.
    before: BTreeMap<(u8, u16), (Duration, u32)>,
    /// Outstanding requests: component, ticket, message.
    running: Vec<(u8, Ticket, u16)>,
    /// The next status message to request of a camera.
    turn: BTreeMap<u8, usize>,
}

impl Discovery {
    /// Requests what is due.
    pub(super) fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        // Only messages that are wanted now keep a time: one that is known, or cannot be requested, must not wake the
        // timer.
        let before = std::mem::take(&mut self.next);
        if !context.vehicle.live() {
            return;
        }
        self.before = before;
        let payloads = &context.vehicle.payloads;
        let autopilot = effects.vehicle.autopilot().component;
        for (device, gimbal) in payloads.gimbals() {
            let manager = gimbal.manager.unwrap_or(autopilot);
            if gimbal.regard.is_none() {
                self.request(manager, GIMBAL_MANAGER_INFORMATION, AGAIN, context, effects);
            }
            if manager == autopilot {
                // PX4 sends it every 2 s, which is too seldom to confirm a change of control.
                effects.vehicle.request_rate(GIMBAL_MANAGER_STATUS, 2.0);
                if device == ON_OUTPUTS {
                    effects.vehicle.request_rate(MOUNT_ORIENTATION, 5.0);
                }
            }
        }
        for (component, camera) in payloads.cameras() {
            let Some(known) = &camera.information else {
                self.request(component, CAMERA_INFORMATION, AGAIN, context, effects);
                continue;
            };
            if effects.listeners.is_empty() {
                continue;
            }
            let turn = self.turn.get(&component).copied().unwrap_or(0);
            let has_streams =
                (known.can).contains(CameraCapFlags::CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM);
            let asks = has_streams && camera.streams.is_empty() && turn / STATUS.len() % 2 == 1;
            let due = match STATUS[turn % STATUS.len()] {
                // Until the streams are known, every other time: with a timer of its own this request would often find the
                // camera busy.
                STORAGE_INFORMATION if asks => VIDEO_STREAM_INFORMATION,
                due => due,
            };
            let skipped = due == VIDEO_STREAM_STATUS && !has_streams;
            if skipped || self.request(component, due, STATUS_EVERY, context, effects) {
                self.turn.insert(component, turn + 1);
            }
        }
    }

    /// When [`Discovery::advance`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.next.values().map(|(at, _)| *at).min()
    }

    /// Handles the end of a request; returns false if it is not one of these.
    pub(super) fn ended(
        &mut self,
        component: u8,
        ticket: Ticket,
        outcome: &Outcome,
        now: Duration,
    ) -> bool {
        let ours = |(of, one, _): &(u8, Ticket, u16)| (*of, *one) == (component, ticket);
        let Some(place) = self.running.iter().position(ours) else {
            return false;
        };
        let (_, _, message) = self.running.swap_remove(place);
        let accepted = MavResult::MAV_RESULT_ACCEPTED;
        let refused = !matches!(outcome, Outcome::Answered { result, .. } if *result == accepted);
        if let Some((next, refusals)) = self.next.get_mut(&(component, key(message))) {
            *refusals = if refused { *refusals + 1 } else { 0 };
            // A message that is refused repeatedly does not exist there; it may after the next restart.
            if *refusals >= MAX_REFUSALS && message != CAMERA_SETTINGS {
                *next = now + SELDOM;
            }
        }
        true
    }

    /// Requests a message if it is due and nothing else is outstanding there; returns true if it was sent.
    fn request(
        &mut self,
        component: u8,
        message: u16,
        every: Duration,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> bool {
        let (now, key) = (context.mono(), (component, key(message)));
        let before = self.before.get(&key).copied().unwrap_or((now, 0));
        let next = self.next.entry(key).or_insert(before);
        if now < next.0 {
            return false;
        }
        next.0 = now + every;
        let client = effects.vehicle.commands_to(component);
        if client.pending() > 0 {
            return false;
        }
        let Ok(ticket) = client.submit(now, request(message)) else {
            return false;
        };
        self.running.push((component, ticket, message));
        true
    }
}

/// All status messages of a camera share one timer.
fn key(message: u16) -> u16 {
    if STATUS.contains(&message) || message == VIDEO_STREAM_INFORMATION {
        CAMERA_SETTINGS
    } else {
        message
    }
}

/// Status messages of a camera, in turn; those that change most often come most often.
const STATUS: [u16; 6] = [
    CAMERA_SETTINGS,
    CAMERA_CAPTURE_STATUS,
    CAMERA_FOV_STATUS,
    VIDEO_STREAM_STATUS,
    CAMERA_CAPTURE_STATUS,
    STORAGE_INFORMATION,
];
const STATUS_EVERY: Duration = Duration::from_millis(500);
const AGAIN: Duration = Duration::from_secs(2);
const SELDOM: Duration = Duration::from_secs(60);
const MAX_REFUSALS: u32 = 5;
const GIMBAL_MANAGER_STATUS: u32 = 281;
/// Where PX4's own outputs stand, which have this gimbal device id.
const MOUNT_ORIENTATION: u32 = 265;
const ON_OUTPUTS: u8 = 1;
