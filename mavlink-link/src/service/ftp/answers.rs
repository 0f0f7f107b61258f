//! What follows from an answer, to a request or to the pieces of a file that are in flight.

use std::time::Duration;

use super::checksum::crc32;
use super::client::Client;
use super::failure::{Failure, Lie, name};
use super::listing;
use super::operation::{Active, Done, Event, Job, Next, Phase};
use super::payload::{FtpError, Opcode, Payload};
use super::read::Reading;

impl Client {
    pub(super) fn handle_answer(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
    ) -> Option<Next> {
        let accepted = match payload.opcode() {
            Some(Opcode::MAV_FTP_OPCODE_ACK) => true,
            Some(Opcode::MAV_FTP_OPCODE_NAK) => false,
            // A request of another station, or one of the vehicle's own.
            _ => return None,
        };
        match &mut active.phase {
            Phase::Asking(pending) => {
                // PX4 numbers an answer one above its request; others belong to an earlier request, or to a burst.
                if payload.seq != pending.payload.seq.wrapping_add(1) {
                    return None;
                }
                if payload.requested != pending.payload.opcode {
                    // PX4 compares only number and sender before it answers from memory, so this is its reply to an earlier
                    // request of the same number. A new number avoids that.
                    let mut again = pending.payload.clone();
                    again.seq = self.number();
                    return Some(Next::Ask(again));
                }
                active.since = now;
                let repeated = pending.repeats > 0;
                if accepted {
                    self.accepted(active, payload)
                } else {
                    self.refused(now, active, payload, repeated)
                }
            }
            Phase::Transferring => self.transferred(now, active, payload, accepted),
            Phase::Waiting { .. } => None,
        }
    }

    /// Handles the ACK of the pending request.
    fn accepted(&mut self, active: &mut Active, payload: &Payload) -> Option<Next> {
        use Opcode as O;
        let Phase::Asking(pending) = &active.phase else {
            return None;
        };
        let opcode = pending.payload.opcode()?;
        if opcode == O::MAV_FTP_OPCODE_TERMINATESESSION {
            return Some(self.closed(active));
        }
        Some(match (opcode, &mut active.job) {
            (O::MAV_FTP_OPCODE_NONE | O::MAV_FTP_OPCODE_RESETSESSION, job) => {
                self.synchronised = true;
                // ResetSessions closed every session; None did not.
                self.left_open &= opcode == O::MAV_FTP_OPCODE_NONE;
                Next::Ask(self.opening(job))
            }
            (O::MAV_FTP_OPCODE_LISTDIRECTORY, Job::List { path, entries, at }) => {
                match listing::append(entries, payload.data()) {
                    Err(lie) => Next::End(Err(lie.into())),
                    Ok(0) => Next::End(Err(Lie::EmptyListing(*at).into())),
                    // Both bounds: a peer may send skipped entries only, which advance `at` and add none.
                    Ok(_) if entries.len() > MAX_ENTRIES || *at as usize > MAX_ENTRIES => {
                        Next::End(Err(Lie::Endless(MAX_ENTRIES).into()))
                    }
                    Ok(count) => {
                        *at += count;
                        let (at, path) = (*at, path.clone());
                        let request = self.request(opcode).with_data(path.as_str().as_bytes());
                        Next::Ask(Payload {
                            offset: at,
                            ..request
                        })
                    }
                }
            }
            (
                O::MAV_FTP_OPCODE_OPENFILERO,
                Job::Read {
                    resume, reading, ..
                },
            ) => {
                self.left_open = true;
                active.session = payload.session;
                let Some(size) = payload.number() else {
                    let lie = Lie::Number("OpenFileRO", payload.size);
                    return Some(Next::End(Err(lie.into())));
                };
                // The file was opened before, and the session was lost: another size now means another file.
                let before = reading
                    .as_ref()
                    .map(|one| one.size)
                    .filter(|was| *was != size);
                // More bytes than the file has were read before: it is another file.
                let beyond = resume.map(|one| one.offset).filter(|had| *had > size);
                if let Some(was) = before.or(beyond) {
                    return Some(Next::End(Err(Failure::Changed { was, is: size })));
                }
                // The vehicle may have restarted between two sessions. What was delivered stays; the CRC32 at the end shows
                // whether it fits.
                match reading {
                    Some(reading) => reading.begin_again(),
                    None => {
                        let (from, crc) = resume.map_or((0, 0), |one| (one.offset, one.crc));
                        *reading = Some(Reading::new(size, from, crc));
                        self.events.push_back(Event::Opened { size });
                    }
                }
                Next::Transfer
            }
            (O::MAV_FTP_OPCODE_CREATEFILE, Job::Write { writing, .. }) => {
                self.left_open = true;
                active.session = payload.session;
                // CreateFile truncates, so everything is sent again.
                writing.begin_again();
                Next::Transfer
            }
            (O::MAV_FTP_OPCODE_CALCFILECRC, job) => {
                let Some(vehicle) = payload.number() else {
                    let lie = Lie::Number("CalcFileCRC32", payload.size);
                    return Some(Next::End(Err(lie.into())));
                };
                let (size, ours, read) = match job {
                    Job::Read {
                        reading: Some(reading),
                        ..
                    } => (reading.size, reading.crc, true),
                    Job::Write { writing, .. } => {
                        let content = &writing.content;
                        (content.len() as u32, crc32(0, content), false)
                    }
                    _ => return None,
                };
                Next::End(match (ours == vehicle, read) {
                    (false, _) => Err(Failure::Checksum { ours, vehicle }),
                    (true, true) => Ok(Done::Read { size, crc: ours }),
                    (true, false) => Ok(Done::Written { size, crc: ours }),
                })
            }
            (O::MAV_FTP_OPCODE_CREATEDIRECTORY, _) => Next::End(Ok(Done::Created)),
            (_, Job::Once { .. }) => Next::End(Ok(Done::Removed)),
            _ => return None,
        })
    }

    /// Handles the NAK of the pending request.
    fn refused(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
        repeated: bool,
    ) -> Option<Next> {
        use FtpError as E;
        use Opcode as O;
        let Phase::Asking(pending) = &active.phase else {
            return None;
        };
        let opcode = pending.payload.opcode()?;
        let (error, errno) = payload.error();
        // PX4 has one session and returns "no sessions available" for a second one. Its errno of an earlier request can
        // turn that into "file exists".
        let opens = matches!(
            opcode,
            O::MAV_FTP_OPCODE_OPENFILERO | O::MAV_FTP_OPCODE_CREATEFILE
        );
        let in_use = error == E::MAV_FTP_ERR_NOSESSIONSAVAILABLE
            || opens && error == E::MAV_FTP_ERR_FILEEXISTS;
        Some(match (opcode, error) {
            // ArduPilot refuses it. The refusal proves as well that the vehicle's memory is of this client.
            (O::MAV_FTP_OPCODE_NONE, _) => {
                self.synchronised = true;
                Next::Ask(self.opening(&active.job))
            }
            (O::MAV_FTP_OPCODE_TERMINATESESSION, _) => self.closed(active),
            // PX4 reports the end of a listing as EOF.
            (O::MAV_FTP_OPCODE_LISTDIRECTORY, E::MAV_FTP_ERR_EOF) => {
                let Job::List { entries, .. } = &mut active.job else {
                    return None;
                };
                Next::End(Ok(Done::Listing(std::mem::take(entries))))
            }
            // Reset only a session that may be ours: the transfer of another station would break off.
            _ if opens && in_use && self.left_open => {
                Next::Ask(self.request(O::MAV_FTP_OPCODE_RESETSESSION))
            }
            _ if opens && in_use => {
                let since = *active.busy_since.get_or_insert(now);
                let waited = now.saturating_sub(since);
                if waited >= self.timing.busy_total {
                    let seconds = waited.as_secs();
                    return Some(Next::End(Err(Failure::Busy { seconds })));
                }
                let until = now + self.timing.busy;
                active.phase = Phase::Waiting { until };
                return None;
            }
            // The answer to the first attempt was lost, and PX4's memory had moved to another request: the repeat met its
            // own effect.
            (
                O::MAV_FTP_OPCODE_REMOVEFILE | O::MAV_FTP_OPCODE_REMOVEDIRECTORY,
                E::MAV_FTP_ERR_FILENOTFOUND,
            ) if repeated => Next::End(Ok(Done::Removed)),
            (O::MAV_FTP_OPCODE_CREATEDIRECTORY, E::MAV_FTP_ERR_FILEEXISTS) if repeated => {
                Next::End(Ok(Done::Created))
            }
            _ => {
                let request = name(opcode);
                Next::End(Err(Failure::Refused {
                    request,
                    error,
                    errno,
                }))
            }
        })
    }

    /// Handles an answer while pieces are in flight.
    fn transferred(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
        accepted: bool,
    ) -> Option<Next> {
        use Opcode as O;
        const READ: u8 = O::MAV_FTP_OPCODE_READFILE as u8;
        const BURST: u8 = O::MAV_FTP_OPCODE_BURSTREADFILE as u8;
        const WRITE: u8 = O::MAV_FTP_OPCODE_WRITEFILE as u8;
        let (error, errno) = payload.error();
        let before = active.job.progress();
        let outcome = match (&mut active.job, payload.requested) {
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                READ,
            ) => {
                let piece = reading.answered(payload)?;
                let (offset, expected) = (piece.payload.offset, usize::from(piece.payload.size));
                let length = payload.data().len();
                if !accepted && error == FtpError::MAV_FTP_ERR_EOF {
                    Err(Lie::EarlyEnd {
                        at: offset,
                        size: reading.size,
                    }
                    .into())
                } else if !accepted {
                    Err(refusal(O::MAV_FTP_OPCODE_READFILE, error, errno))
                } else if length == 0 || length > expected || payload.offset != offset {
                    Err(Lie::Length {
                        offset,
                        expected,
                        length,
                    }
                    .into())
                } else {
                    reading
                        .take(offset, payload.data(), &mut self.unread)
                        .map_err(Failure::Lie)
                }
            }
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                BURST,
            ) if accepted => {
                if !reading.burst_packet(now, &self.timing, payload) {
                    return None;
                }
                self.seen(payload.seq);
                let taken = reading.take(payload.offset, payload.data(), &mut self.unread);
                taken.map_err(Failure::Lie)
            }
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                BURST,
            ) => {
                // A NAK of an earlier burst is late news.
                if !reading.is_burst_answer(payload.seq) {
                    return None;
                }
                self.seen(payload.seq);
                if error == FtpError::MAV_FTP_ERR_EOF {
                    reading.burst_at_end(payload);
                    Ok(())
                } else {
                    Err(refusal(O::MAV_FTP_OPCODE_BURSTREADFILE, error, errno))
                }
            }
            (Job::Write { writing, .. }, WRITE) if accepted => match writing.confirm(payload) {
                Ok(false) => return None,
                Ok(true) => {
                    let (bytes, of) = (writing.confirmed as u32, writing.content.len() as u32);
                    let written = Event::Written { bytes, of };
                    // Unread progress is replaced, so that a slow reader cannot fill the queue.
                    match self.events.back_mut() {
                        Some(last @ Event::Written { .. }) => *last = written,
                        _ => self.events.push_back(written),
                    }
                    Ok(())
                }
                Err(lie) => Err(lie.into()),
            },
            (Job::Write { writing, .. }, WRITE) => {
                if !writing.is_waiting_for(payload) {
                    return None;
                }
                // PX4 clears the path of the open file 2 s after the last request; it then refuses a write as if the path
                // were protected.
                let forgotten =
                    error == FtpError::MAV_FTP_ERR_FILEPROTECTED && writing.confirmed > 0;
                let error = if forgotten {
                    FtpError::MAV_FTP_ERR_INVALIDSESSION
                } else {
                    error
                };
                Err(refusal(O::MAV_FTP_OPCODE_WRITEFILE, error, errno))
            }
            // The answer to a keep-alive.
            _ => return None,
        };
        // Only new bytes count as an answer: a peer that repeats itself forever is as silent as one that sends nothing.
        if active.job.progress() > before {
            active.since = now;
        }
        match outcome {
            Ok(()) => None,
            Err(Failure::Refused {
                error: FtpError::MAV_FTP_ERR_INVALIDSESSION,
                ..
            }) => {
                active.lost_sessions += 1;
                if active.lost_sessions > MAX_LOST_SESSIONS {
                    return Some(Next::End(Err(Failure::Unstable(active.lost_sessions))));
                }
                // The vehicle has restarted, or another station has reset its sessions. A session that PX4 refused as
                // protected is still open, and ours.
                Some(Next::Ask(self.opening(&active.job)))
            }
            Err(failure) => Some(Next::End(Err(failure))),
        }
    }

    /// The session is closed, or as good as closed: what is left is the checksum.
    pub(super) fn closed(&mut self, active: &Active) -> Next {
        let Phase::Asking(pending) = &active.phase else {
            return Next::Transfer;
        };
        // A session whose close got no answer closes by itself after 10 s.
        self.left_open = pending.repeats > 0;
        let path = active.job.path().as_str().as_bytes();
        Next::Ask(
            self.request(Opcode::MAV_FTP_OPCODE_CALCFILECRC)
                .with_data(path),
        )
    }
}

fn refusal(opcode: Opcode, error: FtpError, errno: Option<u8>) -> Failure {
    let request = name(opcode);
    Failure::Refused {
        request,
        error,
        errno,
    }
}

/// Entries of one folder: far more than a card has logs.
const MAX_ENTRIES: usize = 10_000;
/// How often a session may end in one operation.
const MAX_LOST_SESSIONS: u8 = 8;
