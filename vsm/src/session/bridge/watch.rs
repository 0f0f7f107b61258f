//! Checks for faults once a second. Each finding is reported once: by a log line, and by an alert to the listening stations
//! that is active until the fault is gone.

use std::collections::BTreeSet;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::Bridge;
use crate::session::aircraft::Aircraft;
use crate::session::alerts::{Cause, Raised};
use crate::session::findings::host::{KeyFault, StoreFact};
use crate::session::findings::vehicle::EncryptedArrivals;
use crate::session::findings::{self, Code, Finding, dli, vehicle};
use crate::session::log::{LogEntry, LogLevel};

impl Bridge {
    /// Before anything is decided at this time. If the bridge was last here much longer ago than it waits at most, it did not run:
    /// its process was stopped, the computer slept, or others had the processor. What was sent meanwhile is still in the
    /// sockets, so none of them was silent for that time, as after a restart; no address could be asked for a proof; and what is read
    /// next is not of now.
    pub(super) fn note_time(&mut self, mono: Duration) {
        let before = std::mem::replace(&mut self.checks.ran_at, mono);
        let stopped = mono.saturating_sub(before);
        if stopped < UNREAD {
            return;
        }
        if stopped < STOPPED {
            for one in self.aircraft.iter_mut() {
                one.note_unread(before, mono);
            }
            return;
        }
        for received in self
            .stations
            .iter_mut()
            .filter_map(|one| one.received.as_mut())
        {
            *received = (*received + stopped).min(mono);
        }
        self.paths.extend_proofs(mono, stopped);
        for one in self.aircraft.iter_mut() {
            one.note_stop(before, mono);
        }
        self.records.log.push_back(LogEntry {
            level: LogLevel::Warning,
            about: self.vsm,
            text: format!(
                "did not run for {:.1} s: a process that was stopped, or a computer that slept or had too much to do; no station counts \
                 as silent for that time",
                stopped.as_secs_f64()
            ),
        });
    }

    /// The group's datagrams arrive from there on an interface that has not joined it.
    pub fn note_group_elsewhere(
        &mut self,
        mono: Duration,
        interface: std::net::IpAddr,
        from: std::net::SocketAddr,
    ) {
        self.checks.evidence.note_elsewhere(mono, interface, from);
    }

    /// The shell has looked at the key files, beside which the bridge has its keys in memory: those that the next start could
    /// not use, and those that hold another key than the one in force. Returns whether one of them is new: it counts once the next
    /// look finds it too.
    pub fn note_key_files(&mut self, faults: Vec<KeyFault>) -> bool {
        self.checks.key_files.note(faults)
    }

    /// The shell has looked at the folder of the store and the room on its disk, and what it has found wrong.
    pub fn note_store(&mut self, fault: Option<&StoreFact>) {
        self.checks.store = fault.map(StoreFact::finding);
    }

    /// What the encrypted link of a vehicle has counted of what arrives on it: the bridge is given what is inside.
    pub fn note_packets(&mut self, index: usize, packets: EncryptedArrivals) {
        if let Some(one) = self.aircraft.get_mut(index) {
            one.link.note_packets(packets);
        }
    }

    /// The configuration was to be applied: why it was not, or `None` where it is in force.
    pub fn note_reload(&mut self, refused: Option<&str>) {
        self.checks.reload = refused.map(findings::reload);
        self.checks.key_files.read_again();
        // The status names nothing that is over until the next look: a script asks for it right after the reload.
        let files = self.checks.key_files.standing();
        self.checks.found.retain(|one| match one.code {
            Code::Reload => false,
            Code::KeyFile => files.contains(one),
            _ => true,
        });
        self.checks.found.extend(self.checks.reload.clone());
    }

    /// Findings that concern no single vehicle.
    fn own_findings(&self, mono: Duration, wall: Duration) -> Vec<Finding> {
        let mut found = Vec::new();
        let mut links = self.aircraft.iter().map(|one| &one.link);
        let far_ahead = links.any(|link| link.wall_is_far_ahead(mono));
        let before = self.checks.not_before.as_secs();
        found.extend(findings::clock(wall.as_secs(), before, far_ahead));
        self.checks
            .evidence
            .judge(mono, self.setup.group, &mut found);
        found.extend_from_slice(self.checks.key_files.standing());
        found.extend(self.checks.store.clone());
        found.extend(self.checks.reload.clone());
        found.extend(self.access_findings());
        let listed = self.stations.iter().enumerate();
        for (index, station) in listed.filter(|(_, one)| !one.removed) {
            // A paused bridge asks nobody for a proof.
            if !self.outbox.is_paused()
                && let Some((at, current)) = self.paths.unproven(mono, index)
            {
                found.push(dli::unproven(station.id(), at, current));
            }
            if !station.proven {
                continue;
            }
            let speaks = |at| mono.saturating_sub(at) < SPEAKS;
            if let Some(ahead) = station.clock.off_ms()
                && station.received.is_some_and(speaks)
            {
                found.push(dli::station_clock(station.id(), ahead));
            }
        }
        found
    }

    fn vehicle_finding(&self, mono: Duration, index: usize) -> Option<Finding> {
        let one = self.aircraft.get(index)?;
        vehicle::judge(&self.evidence_of(mono, one))
    }

    /// The present findings.
    pub(super) fn findings(&self, mono: Duration) -> Vec<Finding> {
        let mut found = self.checks.found.clone();
        // Not an alert: a paused bridge sends none, and a lease that is late by a moment is no news later.
        if self.outbox.is_paused() {
            found.push(findings::lease());
        }
        // What anybody can send does not take the place of the reason.
        let reasons = self.checks.found.iter().filter(|one| !is_quiet(one));
        let explained: BTreeSet<&str> = reasons.map(|one| one.about.as_str()).collect();
        let fallen = |one: &&Aircraft| one.vehicle.was_live() && !one.vehicle.live();
        for one in self.aircraft.iter().filter(fallen) {
            if !explained.contains(one.id().to_string().as_str()) {
                found.extend(vehicle::silent(&self.evidence_of(mono, one)));
            }
        }
        found
    }

    fn evidence_of<'a>(&self, mono: Duration, one: &'a Aircraft) -> vehicle::Evidence<'a> {
        // The system in place of the vehicle sends the most frames; the others are forwarded by it.
        let others = self.others_on_link(one);
        let others = others.filter(|(system, _)| one.link.is_sending(*system, mono));
        let other = others.max_by_key(|(_, frames)| *frames);
        let shares = self.aircraft.on_port(one.port).len() > 1;
        let beside = (other.map(|(system, _)| system), shares);
        one.link.evidence(mono, &one.config, beside)
    }

    pub(super) fn watch_findings(&mut self, now: Now, disk: &mut dyn Disk) {
        if now.mono < self.checks.look_at {
            return;
        }
        self.checks.look_at = now.mono + LOOK_EVERY;
        self.name_others(now, disk);
        let mut found = self.own_findings(now.mono, now.wall);
        self.report_own(now, &found, disk);
        let before = self.checks.found.iter().filter(|one| is_quiet(one));
        let noted: BTreeSet<String> = before.map(|one| one.about.clone()).collect();
        for index in 0..self.aircraft.len() {
            let one = self.vehicle_finding(now.mono, index);
            self.report_of(now, index, one.as_ref(), &noted, disk);
            found.extend(one);
        }
        self.checks.found = found;
    }

    /// Reports the findings of a vehicle to its listeners. `noted`: the vehicles whose quiet one is in the log already.
    fn report_of(
        &mut self,
        now: Now,
        index: usize,
        found: Option<&Finding>,
        noted: &BTreeSet<String>,
        disk: &mut dyn Disk,
    ) {
        let (mut dli, aircraft) = self.effects(now, disk);
        let Some(one) = aircraft.get_mut(index) else {
            return;
        };
        let is_quiet = found.is_some_and(is_quiet);
        let standing = found.filter(|_| !is_quiet).map(|one| (one.code, one.key));
        let mut effects = one.effects(&mut dli);
        while let Some((cause, text)) = effects.alerts.ended_finding(standing.as_slice()) {
            effects.clear(cause, &cleared(&text));
        }
        if let Some(finding) = found {
            // Log and 16000 already name the vehicle.
            let text = finding.to_string();
            let text = text.strip_prefix(&format!("vehicle {}: ", finding.about));
            let text = text.map_or_else(|| finding.to_string(), str::to_owned);
            if !is_quiet {
                let cause = cause(finding);
                effects.raise(cause, AlertPriority::Warning, SubsystemId::Comms, text);
            } else if !noted.contains(&finding.about) {
                effects.note(LogLevel::Warning, text);
            }
        }
    }

    /// Every station that listens to vehicles, each with the first of them.
    pub(super) fn all_listeners(&self) -> Vec<(usize, Id)> {
        let mut listeners: Vec<(usize, Id)> = Vec::new();
        for one in self.aircraft.iter() {
            for station in one.listeners() {
                if !listeners.iter().any(|(known, _)| known == station) {
                    listeners.push((*station, one.id()));
                }
            }
        }
        listeners
    }

    /// A station that no longer listens is treated as new when it returns, however soon.
    pub(super) fn forget_who_left(&mut self) {
        let listens = |station: &usize| {
            let mut all = self.aircraft.iter();
            all.any(|one| one.listeners().contains(station))
        };
        self.checks.notified.retain(listens);
    }

    /// Reports findings that concern no vehicle to all listeners, in the name of the first vehicle they listen to: every
    /// message of the DLI comes from a vehicle, and a CUCS may drop any other.
    fn report_own(&mut self, now: Now, found: &[Finding], disk: &mut dyn Disk) {
        // The usual case, once a second: nothing is allocated.
        if found.is_empty() && self.alerts.standing().next().is_none() {
            return self.checks.notified.clear();
        }
        let listeners = self.all_listeners();
        let before = std::mem::take(&mut self.checks.notified);
        let (mut dli, _) = self.effects(now, disk);
        let standing: Vec<_> = found.iter().map(|one| (one.code, one.key)).collect();
        while let Some((cause, text)) = dli.alerts.ended_finding(&standing) {
            let raised = dli.alerts.clear(cause, &cleared(&text));
            dli.alert_each(&listeners, raised);
        }
        for (station, vehicle) in listeners.iter().filter(|(one, _)| !before.contains(one)) {
            for alert in dli.alerts.standing().cloned().collect::<Vec<_>>() {
                // For this station it is the first message of the alert, however long the alert has been active.
                dli.show(*vehicle, &[*station], &Raised { alert, first: true });
            }
        }
        // Data to an unproven address is limited: such an alert would use up the credit that it needs for other messages.
        for finding in found.iter().filter(|one| one.code != Code::CucsUnproven) {
            let text = finding.to_string();
            let (priority, subsystem) = (AlertPriority::Warning, SubsystemId::VsmStatus);
            let raised = dli.alerts.raise(cause(finding), priority, subsystem, text);
            dli.alert_each(&listeners, raised);
        }
        self.checks.notified = listeners.into_iter().map(|(station, _)| station).collect();
    }
}

/// Whether it is one line in the log, and no alert: anybody can send what leads to it.
fn is_quiet(finding: &Finding) -> bool {
    finding.code == Code::MavlinkUnsignedBeside
}

fn cause(finding: &Finding) -> Cause {
    Cause::Finding(finding.code, finding.key)
}

fn cleared(text: &str) -> String {
    // What to do about it is not repeated.
    let cause = text.split("; ").next().unwrap_or(text);
    format!("cleared: {cause}")
}

const LOOK_EVERY: Duration = Duration::from_secs(1);
/// A station's clock matters only while it sends.
const SPEAKS: Duration = Duration::from_secs(60);
/// Longer than the bridge waits where nothing is due, and than PX4 does without a set point before it takes them as lost
/// (COM_OF_LOSS_T, default 1 s).
const UNREAD: Duration = Duration::from_millis(1_200);
/// Twice as long as the bridge waits where nothing is due: a computer that is merely busy is not taken for one that stood still.
const STOPPED: Duration = Duration::from_secs(2);
