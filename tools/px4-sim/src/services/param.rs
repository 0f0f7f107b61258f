//! The vehicle's end of the parameter protocol, as PX4 v1.18 answers.

use std::time::Duration;

use crc::{CRC_32_JAMCRC, Crc};
use mavlink::Message as _;
use mavlink::dialects::development::{
    MavMessage, MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_REQUEST_READ_DATA,
    PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use mavlink_link::service::param::{HASH_CHECK, NO_INDEX, Name, Value};
use mavlink_link::service::{Bounded, Node};

/// One parameter of the vehicle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: Name,
    /// Its value, whose type never changes.
    pub value: Value,
    /// Whether some part of the vehicle uses it. An unused parameter has no place in the list; its first read is
    /// answered with index 65535 and makes it used.
    pub used: bool,
    /// Whether PARAM_SET is refused.
    pub read_only: bool,
}

/// What happened to the parameters.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum ServerEvent {
    /// PARAM_SET stored a value, in range or not.
    Set {
        /// Which parameter.
        name: Name,
        /// Its value now.
        value: Value,
    },
}

/// The parameters of a simulated PX4.
#[derive(Debug)]
pub struct Server {
    us: Node,
    /// By name, as PX4 orders them.
    table: Vec<Parameter>,
    /// The next index of the list to send, and when.
    listing: Option<(usize, Duration)>,
    out: Bounded<MavMessage>,
    events: Bounded<ServerEvent>,
}

impl Server {
    /// A vehicle with these parameters; of two with the same name the first counts.
    pub fn new(us: Node, parameters: impl IntoIterator<Item = Parameter>) -> Self {
        let mut table: Vec<_> = parameters.into_iter().collect();
        table.sort_by_key(|parameter| parameter.name);
        table.dedup_by_key(|parameter| parameter.name);
        Self {
            us,
            table,
            listing: None,
            out: Bounded::new(MAX_OUT),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// The value of a parameter.
    pub fn value(&self, name: Name) -> Option<Value> {
        self.place(name).map(|place| self.table[place].value)
    }

    /// Handles a message of `from`; returns whether it was for this service.
    pub fn handle_message(&mut self, now: Duration, from: Node, message: &MavMessage) -> bool {
        let (Some(system), Some(component)) =
            (message.target_system_id(), message.target_component_id())
        else {
            return false;
        };
        if !self.us.is_target(system, component) {
            return false;
        }
        match message {
            MavMessage::PARAM_REQUEST_LIST(_) => {
                if self.listing.is_none() {
                    self.send_hash();
                }
                self.listing = Some((0, now));
            }
            MavMessage::PARAM_REQUEST_READ(m) => self.handle_read(from, m),
            MavMessage::PARAM_SET(m) => self.handle_set(from, m),
            _ => return false,
        }
        true
    }

    /// Sends part of the list, if it was requested.
    pub fn handle_timeout(&mut self, now: Duration) {
        let Some((mut place, _)) = self.listing.take_if(|(_, due)| *due <= now) else {
            return;
        };
        for _ in 0..BURST {
            while self.table.get(place).is_some_and(|p| !p.used) {
                place += 1;
            }
            if place >= self.table.len() {
                return;
            }
            if self.out.len() >= MAX_OUT / 2 {
                break;
            }
            self.send_value(place);
            place += 1;
        }
        self.listing = Some((place, now + BURST_PAUSE));
    }

    /// When [`Server::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.listing.map(|(_, due)| due)
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<ServerEvent> {
        self.events.pop()
    }

    fn handle_read(&mut self, from: Node, request: &PARAM_REQUEST_READ_DATA) {
        if let Ok(index) = usize::try_from(request.param_index) {
            let mut used = (0..self.table.len()).filter(|&place| self.table[place].used);
            match used.nth(index) {
                Some(place) => self.send_value(place),
                None => self.send_error(
                    from,
                    MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST,
                    [0; 16],
                    request.param_index,
                ),
            }
            return;
        }
        let name = Name::from_wire(&request.param_id);
        if name.is_some_and(|name| name.as_str() == HASH_CHECK) {
            self.send_hash();
            return;
        }
        match name.and_then(|name| self.place(name)) {
            Some(place) => {
                self.send_value(place);
                self.table[place].used = true;
            }
            None => self.send_error(
                from,
                MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST,
                *request.param_id,
                -1,
            ),
        }
    }

    fn handle_set(&mut self, from: Node, request: &PARAM_SET_DATA) {
        use MavParamError as E;
        let name = Name::from_wire(&request.param_id);
        if name.is_some_and(|name| name.as_str() == HASH_CHECK) {
            // PX4's sign for "the list is already known": setting the hash check ends the listing.
            self.listing = None;
            self.send_error(from, E::MAV_PARAM_ERROR_READ_ONLY, *request.param_id, -1);
            return;
        }
        let two_types = matches!(
            request.param_type,
            MavParamType::MAV_PARAM_TYPE_INT32 | MavParamType::MAV_PARAM_TYPE_REAL32
        );
        let error = match name.and_then(|name| self.place(name)) {
            None => E::MAV_PARAM_ERROR_DOES_NOT_EXIST,
            Some(_) if !two_types => E::MAV_PARAM_ERROR_TYPE_UNSUPPORTED,
            Some(place) if self.table[place].value.kind() != request.param_type => {
                E::MAV_PARAM_ERROR_TYPE_MISMATCH
            }
            Some(place) if self.table[place].read_only => E::MAV_PARAM_ERROR_READ_ONLY,
            Some(place) => {
                if let Some(value) = Value::from_wire(request.param_value, request.param_type) {
                    let parameter = &mut self.table[place];
                    parameter.value = value;
                    let name = parameter.name;
                    self.events.push(ServerEvent::Set { name, value });
                }
                self.send_value(place);
                return;
            }
        };
        self.send_error(from, error, *request.param_id, -1);
    }

    fn place(&self, name: Name) -> Option<usize> {
        self.table.binary_search_by_key(&name, |p| p.name).ok()
    }

    fn used_before(&self, place: usize) -> u16 {
        let count = self.table[..place].iter().filter(|p| p.used).count();
        u16::try_from(count).unwrap_or(NO_INDEX)
    }

    fn send_value(&mut self, place: usize) {
        let parameter = self.table[place];
        self.out.push(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: parameter.value.to_wire(),
            param_count: self.used_before(self.table.len()),
            param_index: if parameter.used {
                self.used_before(place)
            } else {
                NO_INDEX
            },
            param_id: parameter.name.to_wire(),
            param_type: parameter.value.kind(),
        }));
    }

    fn send_hash(&mut self) {
        const CRC: Crc<u32> = Crc::<u32>::new(&crc::Algorithm {
            init: 0,
            ..CRC_32_JAMCRC
        });
        let mut hash = CRC.digest();
        for parameter in self.table.iter().filter(|p| p.used) {
            hash.update(parameter.name.as_str().as_bytes());
            hash.update(&parameter.value.to_wire().to_bits().to_le_bytes());
        }
        self.out.push(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: f32::from_bits(hash.finalize()),
            param_count: self.used_before(self.table.len()),
            param_index: NO_INDEX,
            param_id: HASH_CHECK.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_UINT32,
        }));
    }

    fn send_error(&mut self, to: Node, error: MavParamError, id: [u8; 16], param_index: i16) {
        self.out.push(MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
            param_index,
            target_system: to.system,
            target_component: to.component,
            param_id: id.into(),
            error,
        }));
    }
}

/// PX4 sends up to 20 parameters in one burst; 947 of them take 0.85 s.
const BURST: usize = 20;
/// Between two bursts: with it a list takes the time that was measured.
const BURST_PAUSE: Duration = Duration::from_millis(18);
/// Messages and events that wait at most; a test may never poll them.
const MAX_OUT: usize = 64;
const MAX_EVENTS: usize = 64;
