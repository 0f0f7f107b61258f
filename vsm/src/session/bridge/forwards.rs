//! Other ground stations (`[[forward]]`): their commands go to their vehicles, as far as each is allowed.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::FrameView;
use mavlink_link::link::Link;
use mavlink_link::signing::KeyId;
use mavlink_link::store::{Disk, StoreError};
use stanag_msgs::Id;

use super::{Bridge, LinkEnd};
use crate::config::{self, Config};
use crate::relay_policy::Px4Now;
use crate::session::aircraft::Aircraft;
use crate::session::forward::{Forward, Request, Situation, only_asks};
use crate::session::link::frame::{OutFrame, Peer};
use crate::session::log::LogLevel;

/// Prepared ground stations that will replace the present ones.
#[derive(Debug)]
pub struct PreparedForwards(Vec<Place>);

#[derive(Debug)]
struct Place {
    number: usize,
    config: config::Forward,
    /// `None` if the present one stays.
    new: Option<Forward>,
}

impl Bridge {
    /// Serves the other ground stations of a configuration, with one [`LinkEnd`] for each, in order.
    ///
    /// # Errors
    /// The signing clock of a key cannot be read.
    pub fn serve_forwards(
        &mut self,
        config: &Config,
        ends: Vec<LinkEnd>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let ends = ends.into_iter().map(Some).enumerate().collect();
        let prepared = self.prepare_forwards(config, ends, now, not_before, disk)?;
        self.take_forwards(prepared);
        Ok(())
    }

    /// Prepares the other ground stations of a configuration without changing anything. `ends`, in their order: the place
    /// of each, and the end of its link; `None` if the present one in this place stays, with its key, its ids and what it
    /// has proven.
    ///
    /// # Errors
    /// The signing clock of a key cannot be read.
    pub fn prepare_forwards(
        &self,
        config: &Config,
        ends: Vec<(usize, Option<LinkEnd>)>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<PreparedForwards, StoreError> {
        let mut places = Vec::new();
        for (forward, (number, end)) in config.forwards().zip(ends) {
            let mut place = Place {
                number,
                config: forward.clone(),
                new: None,
            };
            if let Some(end) = end {
                let mut link = end.link(forward.system_id, self.setup.own);
                link.link_id = forward.link_id;
                link.accept_unsigned = &[];
                let key = end.start_key(now, not_before, disk)?;
                let link = Link::new(link);
                place.new = Some(Forward::new(number, forward.clone(), link, key));
            }
            places.push(place);
        }
        Ok(PreparedForwards(places))
    }

    /// Serves these ground stations, and stops serving all others.
    pub fn take_forwards(&mut self, prepared: PreparedForwards) {
        let mut before = std::mem::take(&mut self.forwards);
        for Place {
            number,
            config,
            new,
        } in prepared.0
        {
            let kept = before.iter().position(|one| one.number == number);
            let kept = kept.map(|at| before.swap_remove(at));
            let stays = |mut kept: Forward| {
                kept.reconfigure(config);
                kept
            };
            self.forwards.extend(new.or_else(|| kept.map(stays)));
        }
        self.name_commanders();
    }

    /// The key of the ground station in this place.
    #[must_use]
    pub fn forward_key(&self, number: usize) -> Option<KeyId> {
        let mut forwards = self.forwards.iter();
        forwards.find(|one| one.number == number)?.key_id()
    }

    /// The address of the ground station in this place, once it was received.
    #[must_use]
    pub fn forward_peer(&self, number: usize) -> Option<Peer> {
        let mut forwards = self.forwards.iter();
        forwards.find(|one| one.number == number)?.peer()
    }

    /// Sets for each vehicle the system ids under which others may command it through this VSM.
    pub(super) fn name_commanders(&mut self) {
        for one in self.aircraft.iter_mut() {
            let (id, forwards) = (one.id(), self.forwards.iter());
            let commanders = forwards.filter(|forward| forward.covers(id));
            one.link.commanders = commanders.filter_map(Forward::commander).collect();
        }
    }

    /// Takes bytes received from the other ground station in this place.
    pub fn handle_forward(
        &mut self,
        now: Now,
        number: usize,
        from: Peer,
        bytes: &[u8],
        disk: &mut dyn Disk,
    ) {
        let index = self.forwards.iter().position(|one| one.number == number);
        let Some((index, forward)) = index.and_then(|at| Some((at, self.forwards.get_mut(at)?)))
        else {
            return;
        };
        let requests = forward.receive(now, from, bytes, disk);
        for request in &requests {
            self.pass_request(now, index, request, disk);
        }
        self.log_moved(now, index, disk);
    }

    /// Counts a datagram of another user's program, which is dropped on a link that checks this.
    pub fn count_foreign(&mut self, number: usize) {
        let mut forwards = self.forwards.iter_mut();
        if let Some(forward) = forwards.find(|one| one.number == number) {
            forward.count("program of another user");
        }
    }

    fn pass_request(&mut self, now: Now, index: usize, request: &Request, disk: &mut dyn Disk) {
        let Some(forward) = self.forwards.get_mut(index) else {
            return;
        };
        let mut found = false;
        for one in self.aircraft.iter_mut() {
            let system = one.system();
            if !forward.covers(one.id()) || !Forward::is_for(request, system) {
                continue;
            }
            let situation = situation(one);
            found = match forward.judge(now, request, (system, situation), disk) {
                Some(frame) if !is_urgent(&frame) && !one.link.has_room(now) => {
                    forward.count("no room on the vehicle's link (rate_bps)");
                    true
                }
                Some(frame) => {
                    let link_id = forward.vehicle_link_id();
                    one.link.pass_on(now, &frame, link_id, disk)
                }
                None => true,
            };
        }
        if !found {
            forward.count_lost();
        }
    }

    /// Forwards an accepted frame to the other ground stations of its vehicle.
    pub(super) fn pass_on(
        forwards: &mut [Forward],
        now: Now,
        (vehicle, signed): (Id, bool),
        frame: &FrameView<'_>,
        disk: &mut dyn Disk,
    ) {
        // RADIO_STATUS of a radio is accepted unsigned: it is about the link itself and cannot be verified.
        if signed && !frame.is_signed() {
            return;
        }
        for forward in forwards.iter_mut().filter(|one| one.covers(vehicle)) {
            forward.pass(now, frame, disk);
        }
    }

    pub(super) fn watch_forwards(&mut self, now: Now, disk: &mut dyn Disk) {
        for index in 0..self.forwards.len() {
            self.forwards[index].handle_timeout(now, disk);
            self.log_moved(now, index, disk);
        }
    }

    fn log_moved(&mut self, now: Now, index: usize, disk: &mut dyn Disk) {
        let forward = &mut self.forwards[index];
        if let Some(peer) = forward.poll_moved() {
            let text = format!("ground station {} is at {peer}", forward.config.name);
            let vsm = self.vsm;
            self.effects(now, disk).0.note(LogLevel::Info, vsm, text);
        }
    }

    /// The next frame for another ground station: (its place, frame).
    pub fn poll_forward(&mut self) -> Option<(usize, OutFrame)> {
        let mut forwards = self.forwards.iter_mut();
        forwards.find_map(|one| Some((one.number, one.poll_transmit()?)))
    }
}

/// Commands and sticks: a slow link always has room for them. A command that only asks can wait: its answer takes the room of what
/// commands.
fn is_urgent(frame: &FrameView<'_>) -> bool {
    let commands = [MANUAL_CONTROL, COMMAND_INT, COMMAND_LONG];
    commands.contains(&frame.header().message_id) && !only_asks(frame)
}

const MANUAL_CONTROL: u32 = 69;
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;

fn situation(one: &Aircraft) -> Situation {
    let live = one.vehicle.live();
    Situation {
        px4: Px4Now {
            disarmed: live && one.vehicle.telemetry.armed == Some(false),
            zeroizing: one.zeroizing,
        },
        limited: one.config.rate_bps.is_some(),
        controlled: one.authority.controller().is_some() || one.flight.view().commands_by_itself,
    }
}
