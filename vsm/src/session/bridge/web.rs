//! Web clients: CUCSs that come by a WebSocket. Theirs are the key, the rights, the duplicates, the rates and the refusals of any
//! CUCS with a guard; what differs is the way.
//!
//! A client is where its connection is: the connection is its address, proven by a challenge that its key has answered, and
//! it ends with it. What is left of it then is what is left of any silent CUCS, its rights until silence costs them.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::guard::ConnectionKey;

use super::Bridge;
use crate::session::findings::dli::Fault;
use crate::session::limits::WEB_REFUSALS;
use crate::session::log::{LogEntry, LogLevel};
use crate::session::station::GroundStation;
use crate::session::web::{Body, Hello, WebLink, WebRefusal, WebStatus};

/// Where what is for a station goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WebWay {
    /// It is no web client: a socket.
    Datagrams,
    /// Into this connection.
    Connection(u64),
    /// It is a web client, and is not connected.
    Nowhere,
}

/// A connection that a client has opened.
#[derive(Debug)]
pub struct WebOpened {
    /// The keys of its frames.
    pub key: ConnectionKey,
    /// What the client is sent first.
    pub welcome: Body<'static>,
    /// A connection that the client had before, which ends.
    pub replaces: Option<u64>,
}

impl Bridge {
    /// Opens the connection of a web client; `number` is no other's.
    ///
    /// # Errors
    /// It is not who it says.
    pub fn open_web(
        &mut self,
        now: Now,
        (number, from): (u64, SocketAddr),
        hello: &Hello<'_>,
        disk: &mut dyn Disk,
    ) -> Result<WebOpened, WebRefusal> {
        let cucs = hello.cucs();
        let opened = self.verify_web(now.mono, (number, from), hello);
        let (index, opened) = match opened {
            Ok(opened) => opened,
            Err(why) => {
                self.note_web(now.mono, from, Some(cucs), why);
                return Err(why);
            }
        };
        if opened.replaces.is_some() {
            self.counters.count(WebRefusal::Replaced.name());
        }
        self.paths.connect(now.mono, index, from);
        self.note_path(index);
        self.end_cut_off(now, index, disk);
        self.welcome(now, index, false, disk);
        Ok(opened)
    }

    fn verify_web(
        &mut self,
        now: Duration,
        (number, from): (u64, SocketAddr),
        hello: &Hello<'_>,
    ) -> Result<(usize, WebOpened), WebRefusal> {
        let (vsm, cucs) = (self.vsm, hello.cucs());
        let mut stations = self.stations.iter_mut().enumerate();
        let (index, station) = stations
            .find(|(_, one)| one.id() == cucs && is_web(one))
            .ok_or(WebRefusal::Unlisted)?;
        let end = station.guard.as_mut().ok_or(WebRefusal::Key)?;
        let (key_id, key) = end.open_connection(now, hello).ok_or(WebRefusal::Key)?;
        // Checked after the key, so that a client without a key learns nothing about addresses.
        if station.config.address.is_some_and(|one| one != from.ip()) {
            return Err(WebRefusal::Address);
        }
        let link = WebLink {
            number,
            key: key_id,
            from,
            opened: now,
        };
        let replaces = station.web.replace(link).map(|before| before.number);
        let welcome = Body::Welcome {
            vsm: vsm.to_string(),
            cucs: cucs.to_string(),
            key_id: key_id.to_string(),
            loi: levels(station.config.loi.0),
        };
        let opened = WebOpened {
            key,
            welcome,
            replaces,
        };
        Ok((index, opened))
    }

    /// Takes what a frame of this connection asks for, as a datagram of its station that its guard has sealed.
    pub fn handle_web(&mut self, now: Now, number: u64, datagram: &[u8], disk: &mut dyn Disk) {
        let mut stations = self.stations.iter_mut().enumerate();
        let found = stations.find_map(|(index, one)| {
            let link = one.web.filter(|link| link.number == number)?;
            Some((index, one, link))
        });
        // Of a connection that has ended meanwhile.
        let Some((index, station, WebLink { key, from, .. })) = found else {
            return self.counters.count("web: connection has ended");
        };
        let takes = is_web(station)
            && (station.guard.as_mut()).is_some_and(|end| end.takes_frame(now.mono, key));
        if !takes {
            return self.end_web(index, WebRefusal::KeyGone);
        }
        station.sealed_under = Some(key);
        self.take_verified(now, from, (datagram, index), disk);
    }

    /// A connection has ended. `why`: for which it was refused.
    pub fn close_web(&mut self, now: Duration, number: u64, why: Option<WebRefusal>) {
        let of_it = |one: &GroundStation| one.web.is_some_and(|link| link.number == number);
        let Some(index) = self.stations.iter().position(of_it) else {
            // Its place is another's already.
            return;
        };
        let station = &self.stations[index];
        let (cucs, from) = (station.id(), station.web.map(|link| link.from));
        if let (Some(why), Some(from)) = (why, from) {
            self.note_web(now, from, Some(cucs), why);
        }
        self.leave_web(index);
    }

    fn leave_web(&mut self, index: usize) {
        self.stations[index].web = None;
        self.paths.disconnect(index);
        self.note_path(index);
    }

    fn end_web(&mut self, index: usize, why: WebRefusal) {
        if let Some(link) = self.stations[index].web {
            self.counters.count(why.name());
            self.web.ends.push((link.number, why));
            self.leave_web(index);
        }
    }

    /// A client that was refused, in whose name and why.
    pub fn note_web(&mut self, now: Duration, from: SocketAddr, cucs: Option<Id>, why: WebRefusal) {
        if why.is_usual() {
            return;
        }
        self.counters.count(why.name());
        // Ids that nobody has are as many as somebody invents.
        let listed = |id: &Id| self.stations.iter().any(|one| one.id() == *id);
        let cucs = cucs.filter(listed);
        // Who has shown the key is nobody else: a slow network, or a browser that slept.
        if let Some(cucs) = cucs.filter(|_| !why.is_of_verified()) {
            self.checks
                .evidence
                .note(now, from, Fault::Web(cucs, why.name()));
        }
        if self.web.logged.take(now, WEB_REFUSALS) {
            let reason = why.name().trim_start_matches("web: ");
            let became = if why.is_of_verified() {
                "disconnected"
            } else {
                "refused"
            };
            self.records.log.push_back(LogEntry {
                level: LogLevel::Warning,
                about: cucs.unwrap_or(self.vsm),
                text: format!("web client {became}: {reason}, from {from}"),
            });
        }
    }

    /// A connection that the shell is to end, and why.
    pub fn poll_web_end(&mut self) -> Option<(u64, WebRefusal)> {
        self.web.ends.pop()
    }

    /// Where what is for this station goes.
    #[must_use]
    pub fn web_way(&self, id: Id) -> WebWay {
        let station = self.stations.iter().find(|one| one.id() == id);
        match station.filter(|one| one.config.web) {
            None => WebWay::Datagrams,
            Some(station) => match station.web {
                Some(link) => WebWay::Connection(link.number),
                None => WebWay::Nowhere,
            },
        }
    }

    /// Ends connections whose key is no longer accepted, or whose station was removed from the configuration.
    pub(super) fn watch_web(&mut self, now: Duration) {
        for index in 0..self.stations.len() {
            let station = &self.stations[index];
            let Some(link) = station.web else { continue };
            let end = station.guard.as_ref();
            if !is_web(station) || !end.is_some_and(|end| end.accepts(now, link.key)) {
                self.end_web(index, WebRefusal::KeyGone);
            }
        }
    }

    /// How a web client stands; `None` for any other station.
    pub(super) fn web_status(&self, index: usize, now: Duration) -> Option<WebStatus> {
        let station = self.stations.get(index)?;
        let web = station.config.web;
        web.then(|| WebStatus::of(station.web.as_ref(), now))
    }
}

fn is_web(station: &GroundStation) -> bool {
    station.config.web && !station.removed
}

fn levels(loi: LoiBitmap) -> Vec<u8> {
    let all = [
        (2, LoiBitmap::LOI2),
        (3, LoiBitmap::LOI3),
        (4, LoiBitmap::LOI4),
        (5, LoiBitmap::LOI5),
    ];
    let held = all.into_iter().filter(|(_, level)| loi.intersects(*level));
    held.map(|(number, _)| number).collect()
}
