//! `vsm replay`: recordings as files, read into a time line, and the operator's page for them.
//!
//! `files` finds and reads them. A file that is cut off, as after a power cut, is shown up to there, with a note; a damaged
//! file is an error with its place. Nothing is written, and no vehicle is reached.

mod files;

use std::rc::Rc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::task::LocalSet;

pub use self::files::{ReplayError, read};
use super::web::{self, Event, Page, PageInfo, Source, Span, Tiles};
use crate::session::replay::{Timeline, TrackPoint};
use crate::session::{Status, VehicleMap};

/// Serves the page of a recording until `stop` is done.
pub async fn serve(
    listener: TcpListener,
    timeline: Timeline,
    tiles: Option<Tiles>,
    stop: impl Future<Output = ()>,
) {
    let local = LocalSet::new();
    let page = Page {
        tiles,
        ..Page::default()
    };
    let page = web::serve(listener, page, Rc::default(), Rc::new(Replay(timeline)));
    local
        .run_until(async {
            tokio::select! {
                () = page => {}
                () = stop => {}
            }
        })
        .await;
}

#[derive(Debug)]
struct Replay(Timeline);

impl Replay {
    /// The given moment, or the first one.
    fn moment(&self, moment: Option<Duration>) -> Duration {
        let first = self.0.span().map(|(first, _)| first);
        moment.or(first).unwrap_or_default()
    }
}

impl Source for Rc<Replay> {
    fn page(&self) -> PageInfo {
        PageInfo {
            replay: self.0.span().map(|(from, to)| Span {
                from_ms: ms(from),
                to_ms: ms(to),
            }),
            ..PageInfo::default()
        }
    }

    fn status(&self, moment: Option<Duration>) -> Status {
        self.0.status(self.moment(moment))
    }

    fn map(&self, moment: Option<Duration>) -> Vec<VehicleMap> {
        self.0.map(self.moment(moment))
    }

    fn events(&self, moment: Option<Duration>) -> Vec<Event> {
        let moment = self.moment(moment);
        let events = self.0.events();
        let until = events.partition_point(|(at, _)| *at <= moment);
        // Event numbers are places in the list, so the page can continue where it stopped.
        let from = until.saturating_sub(MAX_EVENTS);
        let shown = events.get(from..until).unwrap_or_default().iter();
        let numbered = (from as u64..).zip(shown);
        let numbered = numbered.filter_map(|(number, (at, entry))| Event::of(number, *at, entry));
        numbered.collect()
    }

    fn tracks(&self) -> Vec<(String, Vec<TrackPoint>)> {
        self.0.tracks(MAX_TRACK_POINTS)
    }
}

fn ms(at: Duration) -> u64 {
    u64::try_from(at.as_millis()).unwrap_or(u64::MAX)
}

/// The page shows no more events.
const MAX_EVENTS: usize = 400;
const MAX_TRACK_POINTS: usize = 5_000;
