//! Discovery of the subject: the survey at the beginning of a run, whether the subject is still alive, and for how long it
//! was silent.
//!
//! Where the profile names no ids, the ids of this project's examples are tried. A subject that answers but knows
//! none of them is reported as such, and not as a subject that does not answer.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::context::Bench;
use super::net::Datagram;
use super::station::{Access, Station, loi};
use super::survey::{CucsFound, Survey, VehicleFound, bits};
use crate::verdict::Judged;
use crate::wire::{Direction, Seen};

/// Ids that are tried where the profile names none.
const USUAL_IDS: [u32; 4] = [0x1b00_00a0, 0x1b00_00a1, 0x1b00_00a2, 0x1b00_00a3];

/// Asks the subject.
///
/// # Errors
/// The operator stopped the run, or there is no socket.
pub fn survey(bench: &Arc<Bench>) -> Judged<Survey> {
    let mut survey = Survey::default();
    let claims = &bench.profile.cucs;
    let mut candidates: Vec<CucsFound> = claims
        .iter()
        .map(|claim| CucsFound {
            id: claim.id.parse().unwrap_or(Id::NULL),
            authorised: 0,
            overrides: claim.overrides,
            claimed: claim.loi.as_deref().map(bits),
        })
        .collect();
    if candidates.is_empty() {
        candidates = USUAL_IDS
            .map(|id| CucsFound {
                id: Id(id),
                authorised: 0,
                overrides: false,
                claimed: None,
            })
            .to_vec();
    }
    for claim in &bench.profile.vehicle {
        if let Ok(id) = claim.id.parse() {
            let stations = claim.stations.iter().flatten().fold(0, |bits, &station| {
                bits | 1_i64 << (station.clamp(1, 16) - 1)
            });
            survey.vehicles.push(VehicleFound {
                id,
                kind: 0,
                subtype: 0,
                stations,
            });
        }
    }
    let mut silent = 0;
    for mut candidate in candidates {
        // After two ids without any answer the others are not tried: a dead subject would cost the full timeout for
        // each.
        if silent >= 2 && !survey.answered {
            break;
        }
        let station = Station::new(bench, candidate.id, Id::BROADCAST)?;
        let mut answers = station.discover()?;
        survey.broadcast |= !answers.is_empty();
        if answers.is_empty() && !survey.vehicles.is_empty() && !survey.broadcast {
            // Without answers to broadcasts other rules can still be judged. A subject that answered another id's
            // broadcast is different: it does not know this id.
            let directed = Station::new(bench, candidate.id, survey.vehicles[0].id)?;
            answers.extend(directed.request(0, Access::Release).ok());
        }
        silent += usize::from(answers.is_empty());
        survey.answered |= !answers.is_empty();
        for answer in &answers {
            candidate.authorised |= answer.raw("LOI Authorized").unwrap_or_default();
            add_vehicle(&mut survey, answer);
            if let Some(vsm) = answer.raw("VSM ID") {
                bench.vsm.get_or_init(|| Id(vsm as u32));
            }
        }
        // An id that the profile names is known to the subject, whatever levels the answer offers.
        let named = !claims.is_empty() && candidate.claimed != Some(0) && !answers.is_empty();
        if candidate.authorised != 0
            || candidate.claimed.is_some_and(|claimed| claimed != 0)
            || named
        {
            survey.cucs.push(candidate);
        }
    }
    if !survey.answered {
        return Ok(survey);
    }
    look_at_vehicles(&mut survey, bench)?;
    Ok(survey)
}

fn add_vehicle(survey: &mut Survey, answer: &Seen) {
    let field = |name: &str| answer.raw(name).unwrap_or_default();
    let id = answer.piece.source;
    // A response by a VSM for a vehicle that is not there has the null or the VSM's id as its source.
    let known = survey.vehicles.iter_mut().find(|vehicle| vehicle.id == id);
    match known {
        Some(vehicle) => {
            vehicle.kind = field("Vehicle Type");
            vehicle.subtype = field("Vehicle Subtype");
            vehicle.stations |= field("Controlled Station 1-16");
        }
        None => survey.vehicles.push(VehicleFound {
            id,
            kind: field("Vehicle Type"),
            subtype: field("Vehicle Subtype"),
            stations: field("Controlled Station 1-16"),
        }),
    }
}

fn look_at_vehicles(survey: &mut Survey, bench: &Arc<Bench>) -> Judged {
    // The same CUCS that scenes call A, so that rights which the subject fails to release stay with a station that
    // may use them.
    let first = survey
        .with(loi::LOI4)
        .first()
        .map(|cucs| (*cucs).clone())
        .or(survey.cucs.first().cloned());
    let (Some(vehicle), Some(first)) = (survey.vehicles.first_mut(), first) else {
        return Ok(());
    };
    let station = Station::new(bench, first.id, vehicle.id)?;
    // The network first: a lost datagram must not look like a fault of the subject.
    survey.loss = round_trip_loss(&station)?;
    if first.authorised & loi::LOI4 != 0 {
        let answer = station.request(loi::LOI2 | loi::LOI4, Access::Request);
        if let Ok(answer) = answer {
            let granted = answer.raw("LOI Granted").unwrap_or_default();
            // Any number of CUCSs may monitor: a denial of LOI 2 too does not show that another CUCS holds LOI 4.
            let released = bench
                .flight_released
                .load(std::sync::atomic::Ordering::SeqCst);
            let obeyed =
                released && granted & loi::LOI4 == 0 && station.commands_work().unwrap_or(false);
            if granted & loi::LOI4 == 0 && granted & loi::LOI2 != 0 && !obeyed {
                survey.occupied = Some(format!(
                    "{} may have LOI 4 of {} and was denied it: another CUCS is in control",
                    first.id, vehicle.id
                ));
                let _ = station.request(0x0F, Access::Release);
                return Ok(());
            }
        }
    } else {
        let _ = station.request(loi::LOI2, Access::Request);
    }
    let mark = bench.net.mark();
    station.send(super::station::information_request(21000));
    station.send(
        crate::wire::Draft::new(28000)
            .to(Id::BROADCAST)
            .id("VSM ID", Id::BROADCAST)
            .id("Data Link ID", Id::BROADCAST)
            .raw("Control Assignment Request", 0),
    );
    if let Some(found) = station.wait(mark, bench.timers.answer / 2, |seen| seen.kind() == 21000) {
        vehicle.stations |= found
            .raw("Payload Stations Available 1-16")
            .unwrap_or_default();
    }
    survey.data_links = station
        .wait(mark, bench.timers.answer / 4, |seen| seen.kind() == 28001)
        .is_some();
    survey.links_available = !station
        .received(mark, |seen| {
            seen.kind() == 28001 && seen.raw("Data Link Control Availability") != Some(1)
        })
        .is_empty();
    let _ = station.request(0x0F, Access::Release);
    Ok(())
}

/// Discoveries by which loss is measured: one that is lost is 2 % of them.
pub(crate) const TRIPS: usize = 50;
/// How often further answers are waited for.
const MAX_WAITS: usize = 5;

/// How many come of those that are expected, by `count`. As long as `wait` brings more they are late, and not lost: a slow
/// link or a busy computer loses nothing.
fn all_that_come(
    expected: usize,
    count: impl Fn() -> usize,
    mut wait: impl FnMut() -> Judged,
) -> Judged<usize> {
    let mut came = count();
    for _ in 0..MAX_WAITS {
        let before = came;
        if came < expected {
            wait()?;
            came = count();
        }
        if came == before {
            break;
        }
    }
    Ok(came)
}

/// The share, 0 to 1, of discoveries without an answer, not even a late one. The subject answers the others, so what is
/// missing is the network's loss.
fn round_trip_loss(station: &Station) -> Judged<f64> {
    let bench = station.bench().clone();
    let mark = bench.net.mark();
    for _ in 0..TRIPS {
        station.send(super::station::authorisation(0, Access::Release).to(Id::BROADCAST));
        station.pause(std::time::Duration::from_millis(10))?;
    }
    station.pause(std::time::Duration::from_millis(900))?;
    let vehicle = station.vehicle;
    let answers = || {
        station.received(mark, |seen| {
            seen.kind() == 2 && seen.piece.source == vehicle
        })
    };
    all_that_come(
        TRIPS,
        || answers().len(),
        || station.pause(bench.timers.answer),
    )?;
    let answers = answers();
    // A subject may answer twice, or late: the last answer counts, since the first may belong to an earlier request.
    let last_sent = bench.net.recording().datagrams[mark..]
        .iter()
        .rev()
        .find(|datagram| datagram.direction == Direction::Sent)
        .map(|datagram| datagram.at);
    let late = answers
        .last()
        .zip(last_sent)
        .is_some_and(|(answer, sent)| answer.at > sent + std::time::Duration::from_millis(200));
    if late || answers.len() > TRIPS + TRIPS / 10 {
        bench
            .settle_ms
            .store(800, std::sync::atomic::Ordering::SeqCst);
    }
    let answered = answers.len().min(TRIPS);
    Ok((TRIPS - answered) as f64 / TRIPS as f64)
}

/// Whether a discovery is answered.
#[must_use]
pub fn alive(bench: &Arc<Bench>) -> bool {
    let Some(survey) = bench.survey.get() else {
        return false;
    };
    let Some(cucs) = survey.cucs.first() else {
        return false;
    };
    let vehicle = survey.vehicle().map_or(Id::BROADCAST, |vehicle| vehicle.id);
    let Ok(station) = Station::new(bench, cucs.id, vehicle) else {
        return false;
    };
    if survey.broadcast && station.discover().is_ok_and(|found| !found.is_empty()) {
        return true;
    }
    // A subject that does not answer broadcasts is not dead.
    station.request(0, Access::Release).is_ok()
}

/// The longest time since `mark` in which the subject sent nothing at all although something was sent to it repeatedly,
/// where it is at least the time of an answer. A subject that restarts is silent like that, and one that is not on the
/// network; one that leaves out a single answer is not, while it reports its status.
#[must_use]
pub fn silence(bench: &Bench, mark: usize) -> Option<Duration> {
    let recording = bench.net.recording();
    let since = recording.datagrams.get(mark..)?;
    longest_silence(since, bench.net.now()).filter(|silence| *silence >= bench.timers.answer)
}

fn longest_silence(datagrams: &[Datagram], now: Duration) -> Option<Duration> {
    let mut begin = 0;
    let mut longest: Option<Duration> = None;
    for unanswered in datagrams.split(|datagram| datagram.direction == Direction::Received) {
        let end = datagrams
            .get(begin + unanswered.len())
            .map_or(now, |answer| answer.at);
        begin += unanswered.len() + 1;
        let mut contents = BTreeSet::new();
        let repeated = unanswered.iter().any(|sent| !contents.insert(&sent.bytes));
        if let Some(first) = unanswered.first().filter(|_| repeated) {
            longest = longest.max(Some(end.saturating_sub(first.at)));
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn datagram(at_ms: u64, direction: Direction, content: u8) -> Datagram {
        let at = Duration::from_millis(at_ms);
        let address = "127.0.0.1:1".parse().unwrap();
        let ends = (address, address);
        Datagram::new((at, at), direction, 0, ends, vec![content], None)
    }

    #[test]
    fn what_comes_late_is_not_lost() {
        // How many have come at each look; the last one for good.
        let all = |looks: &[usize]| {
            let look = std::cell::Cell::new(0);
            let came = all_that_come(
                50,
                || looks[look.get().min(looks.len() - 1)],
                || {
                    look.set(look.get() + 1);
                    Ok(())
                },
            );
            (came, look.get())
        };
        assert_eq!(all(&[50]), (Ok(50), 0));
        // 550 ms each way, and a computer that is busy.
        assert_eq!(all(&[0, 50]), (Ok(50), 1));
        assert_eq!(all(&[10, 30, 50]), (Ok(50), 2));
        // Lost: nothing more comes.
        assert_eq!(all(&[45, 45, 50]), (Ok(45), 1));
        assert_eq!(all(&[0, 0]), (Ok(0), 1));
    }

    #[test]
    fn a_silence_lasts_from_the_first_request_to_the_next_answer() {
        let sent = |at_ms, content| datagram(at_ms, Direction::Sent, content);
        let received = |at_ms| datagram(at_ms, Direction::Received, 0);
        let longest = |datagrams: &[Datagram]| {
            longest_silence(datagrams, Duration::from_millis(900)).map(|time| time.as_millis())
        };
        assert_eq!(longest(&[]), None);
        // Each is answered, or waited for in vain but once.
        let answered = [sent(0, 1), received(300), sent(310, 1), received(600)];
        assert_eq!(longest(&answered), None);
        assert_eq!(longest(&[sent(0, 1), sent(100, 2), received(800)]), None);
        // A repetition that is answered, and one that is not answered yet.
        let lost = [
            sent(0, 1),
            received(5),
            sent(10, 2),
            sent(210, 2),
            received(230),
        ];
        assert_eq!(longest(&lost), Some(220));
        let open = [
            sent(0, 1),
            sent(10, 2),
            received(20),
            sent(40, 3),
            sent(50, 2),
            sent(60, 3),
        ];
        assert_eq!(longest(&open), Some(860));
    }
}
