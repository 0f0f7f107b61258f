//! What must be so after a kill, by what was acknowledged before it.
//!
//! Nothing here knows how the bridge works. A thing that was acknowledged has one value; one that was under way when a
//! process was killed has two, and the first look after the restart decides which of them counts from then on.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use kit::bridge::Ticket;
use stanag_msgs::Bam32;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::UaPositionWaypoint;

use super::tap::Command;

/// One of several values, until somebody has looked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OneOf<T>(Vec<T>);

impl<T: Clone + PartialEq + core::fmt::Debug> OneOf<T> {
    pub(super) fn just(value: T) -> OneOf<T> {
        OneOf(vec![value])
    }

    /// Something is under way that leads to `value`.
    pub(super) fn or(&mut self, value: T) {
        if !self.0.contains(&value) {
            self.0.push(value);
        }
    }

    /// It may be what something else may be.
    pub(super) fn or_all(&mut self, other: &OneOf<T>) {
        for value in &other.0 {
            self.or(value.clone());
        }
    }

    /// It was seen to be `value`: whether it may be.
    pub(super) fn is(&mut self, value: T) -> bool {
        let may = self.0.contains(&value);
        self.0 = vec![value];
        may
    }

    /// How something under way, from `before` to `after`, was answered. A refusal in the run of the bridge in which
    /// it was given means that nothing has happened; after a kill it means that the order was cut off somewhere.
    pub(super) fn answered(&mut self, answer: Option<AckType>, cut_off: bool, before: T, after: T) {
        match answer {
            Some(AckType::CarriedOut) => self.0 = vec![after],
            Some(AckType::Refused) if !cut_off => self.0 = vec![before],
            _ => self.0 = vec![before, after],
        }
    }

    /// It was seen to be one of those that `holds` for: whether there is one.
    pub(super) fn is_one_that(&mut self, holds: impl FnMut(&T) -> bool) -> bool {
        match self.0.iter().position(holds) {
            Some(index) => {
                self.0 = vec![self.0.swap_remove(index)];
                true
            }
            None => false,
        }
    }

    /// Whether nobody has looked yet.
    pub(super) fn is_one_of_several(&self) -> bool {
        self.0.len() > 1
    }

    pub(super) fn first(&self) -> &T {
        &self.0[0]
    }
}

/// Degrees north and east, as sent.
pub(super) type Place = (Option<Bam32>, Option<Bam32>);

pub(super) fn place_of(waypoint: &UaPositionWaypoint) -> Place {
    (
        waypoint.waypoint_to_latitude_or_relative_y,
        waypoint.waypoint_to_longitude_or_relative_x,
    )
}

/// The plan by the number of its waypoints.
pub(super) type Plan = BTreeMap<u16, OneOf<Place>>;

/// An order to an altitude that no other of the latest orders has, so that the vehicle's commands show which order they
/// came of.
#[derive(Debug, Clone)]
pub(super) struct Order {
    pub(super) station: usize,
    pub(super) ticket: Ticket,
    pub(super) amsl_m: f64,
    /// Given by a station without the right to.
    pub(super) forbidden: bool,
    /// Its final answer, and when it came.
    pub(super) ended: Option<(AckType, Instant)>,
    /// In which run of the bridge the vehicle was commanded.
    commanded_in: Option<usize>,
}

/// All orders, and the runs of the bridge.
#[derive(Debug, Default)]
pub(super) struct Orders {
    pub(super) given: Vec<Order>,
    /// When each run began.
    runs: Vec<Instant>,
    /// An upload may be under way until then; none while there is no end yet.
    uploading: Option<Option<Instant>>,
    /// SETUP_SIGNING seen.
    pub(super) keys: usize,
}

impl Orders {
    pub(super) fn run_begins(&mut self) {
        self.runs.push(Instant::now());
    }

    pub(super) fn run(&self) -> usize {
        self.runs.len()
    }

    /// An altitude above home that the next order is to have, m.
    pub(super) fn next_height_m(&self) -> f64 {
        10.0 + 0.5 * (self.given.len() % LATEST) as f64
    }

    pub(super) fn give(&mut self, station: usize, ticket: Ticket, height_m: f64, forbidden: bool) {
        self.given.push(Order {
            station,
            ticket,
            amsl_m: HOME_AMSL_M + height_m,
            forbidden,
            ended: None,
            commanded_in: None,
        });
    }

    /// A load begins.
    pub(super) fn load_begins(&mut self) {
        self.uploading = Some(None);
    }

    /// It was answered.
    pub(super) fn load_ends(&mut self) {
        self.uploading = Some(Some(Instant::now()));
    }

    /// Judges what the vehicle was commanded; what is wrong with it.
    pub(super) fn judge(&mut self, commands: Vec<(Instant, Command)>) -> Vec<String> {
        let mut faults = Vec::new();
        for (at, command) in commands {
            match command {
                Command::Key => self.keys += 1,
                Command::Upload => match self.uploading {
                    Some(None) => {}
                    Some(Some(end)) if at < end + LATE => {}
                    _ => faults.push("a mission is uploaded that no order is for".to_owned()),
                },
                Command::Altitude(amsl_m) => faults.extend(self.judge_altitude(at, amsl_m)),
            }
        }
        faults
    }

    fn judge_altitude(&mut self, at: Instant, amsl_m: f64) -> Option<String> {
        let run = self.runs.iter().filter(|begin| **begin <= at).count();
        let mut latest = self.given.iter_mut().rev().take(LATEST);
        let order = latest.find(|order| (order.amsl_m - amsl_m).abs() < 0.2)?;
        if order.forbidden {
            return Some(format!("flown without the right to: {order:?}"));
        }
        if let Some((answer, ended)) = order.ended
            && at > ended + LATE
        {
            let late = (at - ended).as_secs_f64();
            return Some(format!(
                "flown {late:.1} s after {answer:?} was answered: {order:?}"
            ));
        }
        let first = *order.commanded_in.get_or_insert(run);
        (first != run).then(|| format!("flown in run {first} and again in run {run}: {order:?}"))
    }

    /// Orders that were answered as carried out though the vehicle was never commanded.
    pub(super) fn lost(&self) -> impl Iterator<Item = &Order> {
        self.given.iter().filter(|order| {
            let done = matches!(order.ended, Some((AckType::CarriedOut, _)));
            done && order.commanded_in.is_none()
        })
    }
}

/// The simulated home.
const HOME_AMSL_M: f64 = 488.0;
/// After so many orders their altitudes begin again.
const LATEST: usize = 60;
/// Less than the time after which a command is repeated to the vehicle thrice; a datagram of a busy machine may be so late.
const LATE: Duration = Duration::from_millis(1_500);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_cut_off_has_two_values_until_somebody_looks() {
        let mut owner = OneOf::just(1);
        owner.or(2);
        owner.answered(Some(AckType::Refused), true, 1, 2);
        assert!(owner.clone().is(1) && owner.is(2));
        assert!(!owner.is(1), "it was 2");
        owner.answered(Some(AckType::Refused), false, 2, 3);
        assert!(!owner.clone().is(3));
        owner.answered(Some(AckType::CarriedOut), true, 2, 3);
        assert!(!owner.is(2));
    }
}
