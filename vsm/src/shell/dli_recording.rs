//! The DLI recording: a .pcapng of the datagrams from the configured ground stations, and of all datagrams to them.
//!
//! Datagrams of other senders are not recorded. Anyone can write the id of a ground station into a datagram, so that alone
//! bounds nothing: [`Quota`] does. The DLI carries no key; Wireshark opens the file with
//! `packaging/wireshark/stanag4586.lua`.

use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use stanag_msgs::{Id, frames};

use super::recording::{Quota, RecordFile, Recorder};
use crate::session::Counters;
use stanag_msgs::pcapng;

/// An open recording.
#[derive(Debug)]
pub struct DliRecording {
    file: RecordFile,
    stations: Vec<Id>,
    block: Vec<u8>,
}

impl DliRecording {
    /// Begins a file in `folder`, named by the time, for these ground stations.
    ///
    /// # Errors
    /// The folder or the file cannot be made, the folder is open to others, or there can be no thread.
    pub fn begin(
        folder: &Path,
        stations: Vec<Id>,
        wall: Duration,
        quota: Quota,
        recorder: &Recorder,
    ) -> io::Result<DliRecording> {
        let place = (folder, "dli", "pcapng");
        let file = RecordFile::begin(place, pcapng::header(), wall, quota, recorder)?;
        Ok(DliRecording {
            file,
            stations,
            block: Vec::new(),
        })
    }

    /// The ground stations are these from now on.
    pub fn set_stations(&mut self, stations: Vec<Id>) {
        self.stations = stations;
    }

    /// A datagram that arrived here.
    pub fn received(&mut self, wall: Duration, from: SocketAddr, here: SocketAddr, bytes: &[u8]) {
        let known = frames(bytes)
            .flatten()
            .any(|frame| self.stations.contains(&frame.header.source));
        if known {
            self.write(wall, from, here, bytes);
        }
    }

    /// A datagram that was sent from here.
    pub fn sent(&mut self, wall: Duration, here: SocketAddr, to: SocketAddr, bytes: &[u8]) {
        self.write(wall, here, to, bytes);
    }

    /// Adds the counts of what was not recorded, and of what was removed again.
    pub fn count(&self, counters: &mut Counters) {
        self.file.count(counters);
    }

    /// Passes what is buffered to the thread.
    pub fn flush(&mut self) {
        self.file.flush();
    }

    fn write(&mut self, wall: Duration, from: SocketAddr, to: SocketAddr, bytes: &[u8]) {
        self.block.clear();
        pcapng::datagram(&mut self.block, wall, from, to, bytes);
        self.file.write(wall, &self.block);
    }
}
