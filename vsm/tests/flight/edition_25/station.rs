//! A ground station of Edition 2.5: fields by name in, fields by name out, and nothing that it does by itself.

use std::net::SocketAddr;

use serde_json::{Map, Value, json};
use stanag_msgs::Id;
use stanag_msgs::json::{decode, encode};

use kit::bridge::Rig;

/// A station that sends what a test tells it to, and keeps what it is sent.
#[derive(Debug)]
pub(super) struct StationEd25 {
    /// Its identification number.
    pub(super) id: Id,
    /// Where it sends from.
    pub(super) address: SocketAddr,
    /// By which it calls its edition: `2.5` or `9`.
    pub(super) version: &'static str,
    /// Every message that it was sent, as JSON with raw numbers.
    pub(super) received: Vec<Value>,
    instance: u32,
    taken: usize,
    last_ms: u128,
}

impl StationEd25 {
    /// One that has sent nothing yet.
    pub(super) fn new(id: Id, address: SocketAddr) -> StationEd25 {
        StationEd25 {
            id,
            address,
            version: "2.5",
            received: Vec::new(),
            instance: 100,
            taken: 0,
            last_ms: 0,
        }
    }

    /// Sends a message to a vehicle, stamped now; returns its instance id.
    pub(super) fn send(&mut self, rig: &mut Rig, vehicle: Id, number: u16, fields: &Value) -> u32 {
        let bytes = self.datagram(rig, vehicle, number, fields);
        rig.deliver_from(self.address, &bytes);
        self.instance
    }

    /// The datagram of a message, stamped now.
    pub(super) fn datagram(
        &mut self,
        rig: &Rig,
        vehicle: Id,
        number: u16,
        fields: &Value,
    ) -> Vec<u8> {
        self.instance += 1;
        // Stamps rise, as those of a station do.
        self.last_ms = (rig.station_now().wall.as_millis()).max(self.last_ms + 1);
        let mut all = Map::from_iter([
            ("Time Stamp".to_owned(), json!(self.last_ms as f64 / 1e3)),
            ("Vehicle ID".to_owned(), json!(vehicle.0 as i32)),
        ]);
        let own = if number == 600 {
            "CUCS ID (Controlling)"
        } else {
            "CUCS ID"
        };
        all.insert(own.to_owned(), json!(self.id.0 as i32));
        all.extend(fields.as_object().cloned().unwrap_or_default());
        let message = json!({
            "id": number, "idd": self.version, "instance": self.instance, "fields": all,
        });
        encode(&message, true).expect("a message of Edition 2.5")
    }

    /// Takes what has come for it.
    pub(super) fn receive(&mut self, rig: &Rig) {
        let new = rig.others.get(self.taken..).unwrap_or_default();
        let own = new.iter().filter(|(to, _)| *to == self.address);
        self.received
            .extend(own.flat_map(|(_, bytes)| decode(bytes, true)));
        self.taken = rig.others.len();
    }

    /// The fields of every message of this type since the last call of this.
    pub(super) fn take(&mut self, rig: &Rig, number: u16) -> Vec<Value> {
        self.receive(rig);
        let (of, others) = self.received.drain(..).partition(|one| one["id"] == number);
        self.received = others;
        let of: Vec<Value> = of;
        of.into_iter().map(|one| one["fields"].clone()).collect()
    }

    /// The texts of all alerts so far.
    pub(super) fn alerts(&mut self, rig: &Rig) -> Vec<String> {
        self.receive(rig);
        let all = self.received.iter().filter(|one| one["id"] == 1100);
        all.filter_map(|one| Some(one["fields"]["Text"].as_str()?.to_owned()))
            .collect()
    }
}
