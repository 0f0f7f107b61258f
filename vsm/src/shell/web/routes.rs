//! What is answered to which request.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, RawQuery, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName, HeaderValue, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{Response, StatusCode};
use axum::routing::get;
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

use super::events::Event;
use super::metrics;
use super::source::{PageInfo, Source};
use super::tiles::{Tiles, TilesInfo};
use crate::session::{Status, VehiclePattern};

/// A question to the bridge, and where its answer goes: JSON, or the text of /metrics.
#[derive(Debug)]
pub(super) enum Query {
    Page(oneshot::Sender<Bytes>),
    Status(Moment, Details, oneshot::Sender<Bytes>),
    Map(Moment, oneshot::Sender<Bytes>),
    Events(u64, Moment, oneshot::Sender<Bytes>),
    Tracks(oneshot::Sender<Bytes>),
    Metrics(oneshot::Sender<Bytes>),
}

/// Of a recording, since 1970; none is now.
type Moment = Option<Duration>;

/// Of which vehicles everything is given; none is of all.
type Details = Option<Vec<VehiclePattern>>;

impl Query {
    /// Answers it; the client may be gone.
    pub(super) fn answer(self, source: &impl Source, kept: &mut Kept) {
        // Without a recording each moment is now: whatever a client writes there is the same question.
        let moment = |at: Moment| at.filter(|_| source.page().replay.is_some());
        let _ = match self {
            Query::Page(to) => {
                let tiles = kept.tiles.clone();
                let page = PageInfo {
                    tiles,
                    ..source.page()
                };
                to.send(json(&page).into())
            }
            Query::Status(at, details, to) => {
                let at = moment(at);
                to.send(kept.status.get(at, details, || source.status(at)))
            }
            Query::Map(at, to) => {
                let compose = |at: &Moment| json(&source.map(*at));
                to.send(kept.map.get(moment(at), compose))
            }
            Query::Events(from, at, to) => {
                let at = moment(at);
                to.send(kept.events.get(at, from, || source.events(at)))
            }
            Query::Tracks(to) => {
                let compose = |(): &()| json(&source.tracks());
                to.send(kept.tracks.get((), compose))
            }
            Query::Metrics(to) => {
                let compose = |(): &()| metrics::text(&source.status(None));
                to.send(kept.metrics.get((), compose))
            }
        };
    }
}

/// What was answered last: however many ask the same, the thread that flies composes it a few times a second.
#[derive(Debug, Default)]
pub(super) struct Kept {
    pub(super) tiles: Option<TilesInfo>,
    status: Documents,
    map: Answer<Moment>,
    events: EventLists,
    tracks: Answer<()>,
    metrics: Answer<()>,
}

/// The status that was composed last, and the documents that were made of it: what composing and writing them took bounds how
/// soon it is composed again, whatever vehicles clients choose.
#[derive(Debug, Default)]
struct Documents(Option<ComposedStatus>);

#[derive(Debug)]
struct ComposedStatus {
    of: Moment,
    status: Status,
    bodies: Vec<(Details, Bytes)>,
    began: Instant,
    took: Duration,
}

impl Documents {
    fn get(&mut self, at: Moment, details: Details, compose: impl FnOnce() -> Status) -> Bytes {
        let began = Instant::now();
        let kept = self.0.take();
        let kept = kept.filter(|kept| kept.of == at && began < kept.until());
        let kept = kept.unwrap_or_else(|| ComposedStatus {
            of: at,
            status: compose(),
            bodies: Vec::new(),
            began,
            took: began.elapsed(),
        });
        self.0.insert(kept).document(details)
    }
}

impl ComposedStatus {
    fn until(&self) -> Instant {
        self.began + KEPT.max(self.took * ONE_PART_IN)
    }

    fn document(&mut self, details: Details) -> Bytes {
        let known = |details: &Details| {
            let mut bodies = self.bodies.iter();
            let body = bodies.find(|(of, _)| of == details);
            body.map(|(_, body)| body.clone())
        };
        // Clients that choose ever other vehicles get the rows of the list: each choice costs the thread that flies a document.
        let details = match known(&details) {
            Some(body) => return body,
            None if self.bodies.len() < MAX_CHOICES => details,
            None => Some(Vec::new()),
        };
        if let Some(body) = known(&details) {
            return body;
        }
        let began = Instant::now();
        let body = match &details {
            None => json(&self.status),
            Some(of) => {
                let mut status = self.status.clone();
                status.keep_details(of);
                json(&status)
            }
        };
        self.took += began.elapsed();
        let body = Bytes::from(body);
        self.bodies.push((details, body.clone()));
        body
    }
}

/// The events that were composed last, each with its number: from whichever a client continues, its answer is a part of them.
#[derive(Debug, Default)]
struct EventLists(Option<ComposedEvents>);

#[derive(Debug)]
struct ComposedEvents {
    of: Moment,
    each: Vec<(u64, String)>,
    until: Instant,
}

impl EventLists {
    fn get(&mut self, at: Moment, from: u64, compose: impl FnOnce() -> Vec<Event>) -> Bytes {
        let began = Instant::now();
        let kept = self.0.take();
        let kept = kept.filter(|kept| kept.of == at && began < kept.until);
        let kept = kept.unwrap_or_else(|| {
            let all = compose();
            ComposedEvents {
                of: at,
                each: all.iter().map(|one| (one.number, json(one))).collect(),
                until: began + KEPT.max(began.elapsed() * ONE_PART_IN),
            }
        });
        self.0.insert(kept).since(from)
    }
}

impl ComposedEvents {
    fn since(&self, number: u64) -> Bytes {
        let shown = self.each.iter().filter(|(one, _)| *one >= number);
        let shown: Vec<&str> = shown.map(|(_, text)| text.as_str()).collect();
        format!("[{}]", shown.join(",")).into()
    }
}

#[derive(Debug, Default)]
struct Answer<Q>(Option<Composed<Q>>);

#[derive(Debug)]
struct Composed<Q> {
    of: Q,
    body: Bytes,
    until: Instant,
}

impl<Q: PartialEq> Answer<Q> {
    fn get(&mut self, of: Q, compose: impl FnOnce(&Q) -> String) -> Bytes {
        let began = Instant::now();
        match &self.0 {
            Some(kept) if kept.of == of && began < kept.until => kept.body.clone(),
            _ => {
                let body = Bytes::from(compose(&of));
                let took = began.elapsed();
                let until = began + KEPT.max(took * ONE_PART_IN);
                let kept = Composed {
                    of,
                    body: body.clone(),
                    until,
                };
                self.0 = Some(kept);
                body
            }
        }
    }
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

type Queries = mpsc::Sender<Query>;

/// All routes.
pub(super) fn all(queries: Queries, tiles: Option<Arc<Tiles>>) -> Router {
    Router::new()
        .route("/", get(|| async { asset("index.html") }))
        .route(
            "/page/{*name}",
            get(|Path(name): Path<String>| async move { asset(&name) }),
        )
        .route("/page.json", get(|State(to)| ask(to, Query::Page, JSON)))
        .route("/status.json", get(status))
        .route("/map.json", get(map))
        .route("/events.json", get(events))
        .route(
            "/tracks.json",
            get(|State(to)| ask(to, Query::Tracks, JSON)),
        )
        .route(
            "/metrics",
            get(|State(to)| ask(to, Query::Metrics, PROMETHEUS)),
        )
        .route(
            "/tiles/{zoom}/{x}/{y}",
            get(|Path(place): Path<(u8, u32, u32)>| tile(tiles, place)),
        )
        .fallback(async || text(StatusCode::NOT_FOUND, THERE_ARE))
        // Commands go through the DLI alone, where the level of interoperability is checked: web clients' too (`control`).
        .method_not_allowed_fallback(async || text(StatusCode::METHOD_NOT_ALLOWED, ONLY_GET))
        .with_state(queries)
}

async fn status(State(to): State<Queries>, RawQuery(query): RawQuery) -> Response<Body> {
    match asked(query) {
        Some(Asked {
            from: None,
            at,
            details,
        }) => ask(to, |answer| Query::Status(at, details, answer), JSON).await,
        _ => text(StatusCode::BAD_REQUEST, EXPECTED),
    }
}

async fn map(State(to): State<Queries>, RawQuery(query): RawQuery) -> Response<Body> {
    match asked(query) {
        Some(Asked {
            from: None,
            at,
            details: None,
        }) => ask(to, |answer| Query::Map(at, answer), JSON).await,
        _ => text(StatusCode::BAD_REQUEST, EXPECTED),
    }
}

async fn events(State(to): State<Queries>, RawQuery(query): RawQuery) -> Response<Body> {
    match asked(query) {
        Some(Asked {
            from,
            at,
            details: None,
        }) => {
            let from = from.unwrap_or(0);
            ask(to, |answer| Query::Events(from, at, answer), JSON).await
        }
        _ => text(StatusCode::BAD_REQUEST, EXPECTED),
    }
}

/// What the part of an address behind `?` asks for.
#[derive(Debug, Default)]
struct Asked {
    from: Option<u64>,
    at: Moment,
    details: Details,
}

/// from=NUMBER, at=MILLISECONDS and details=PATTERN,.., each at most once; `None` of anything else.
fn asked(query: Option<String>) -> Option<Asked> {
    let Asked {
        mut from,
        mut at,
        mut details,
    } = Asked::default();
    let query = query.unwrap_or_default();
    for pair in query.split('&').filter(|pair| !pair.is_empty()) {
        match pair.split_once('=')? {
            ("from", number) if from.is_none() => from = Some(number.parse().ok()?),
            ("at", ms) if at.is_none() => at = Some(Duration::from_millis(ms.parse().ok()?)),
            ("details", of) if details.is_none() => {
                let each = of.split(',').filter(|pattern| !pattern.is_empty());
                let each: Vec<VehiclePattern> =
                    each.map(str::parse).collect::<Result<_, _>>().ok()?;
                // The thread that flies compares each with every vehicle.
                details = Some(each).filter(|each| each.len() <= MAX_DETAILS);
                details.as_ref()?;
            }
            _ => return None,
        }
    }
    Some(Asked { from, at, details })
}

async fn ask(
    to: Queries,
    query: impl FnOnce(oneshot::Sender<Bytes>) -> Query,
    kind: &'static str,
) -> Response<Body> {
    let (answer, answered) = oneshot::channel();
    let _ = to.send(query(answer)).await;
    match answered.await {
        Ok(body) => response(StatusCode::OK, kind, body.into()),
        Err(_) => text(StatusCode::SERVICE_UNAVAILABLE, "the bridge is ending\n"),
    }
}

/// A map tile; `None` if there is none, where the map shows its grid.
async fn tile(tiles: Option<Arc<Tiles>>, (zoom, x, y): (u8, u32, u32)) -> Response<Body> {
    let Some(tiles) = tiles else {
        return text(StatusCode::NOT_FOUND, THERE_ARE);
    };
    match tiles.get(zoom, x, y).await {
        Ok(Some(picture)) => response(StatusCode::OK, tiles.kind(), picture.into()),
        // Not "not found": browsers name each such picture as an error of the page.
        Ok(None) => text(StatusCode::NO_CONTENT, ""),
        Err(cause) => {
            tracing::debug!("[web] tiles: {zoom}/{x}/{y}: {cause}");
            text(
                StatusCode::INTERNAL_SERVER_ERROR,
                "[web] tiles cannot be read there\n",
            )
        }
    }
}

/// A file of the page.
fn asset(name: &str) -> Response<Body> {
    let found = ASSETS.iter().find(|(known, ..)| *known == name);
    match found {
        Some((_, kind, content)) => response(StatusCode::OK, kind, Body::from(*content)),
        None => text(StatusCode::NOT_FOUND, THERE_ARE),
    }
}

/// Plain text.
pub(super) fn text(code: StatusCode, body: &'static str) -> Response<Body> {
    response(code, "text/plain; charset=utf-8", body.into())
}

fn response(code: StatusCode, kind: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = code;
    let headers: [(HeaderName, &'static str); 5] = [
        (CONTENT_TYPE, kind),
        (CACHE_CONTROL, "no-store"),
        // Scripts and styles are files of the page: what a text of a vehicle or a station says is never code.
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
    ];
    for (name, value) in headers {
        response
            .headers_mut()
            .insert(name, HeaderValue::from_static(value));
    }
    response
}

/// Patterns in one request.
const MAX_DETAILS: usize = 16;
/// Different choices of vehicles that are answered of one composed status.
const MAX_CHOICES: usize = 32;
const KEPT: Duration = Duration::from_millis(200);
/// Of a thousand vehicles an answer takes milliseconds of the thread that flies: that is one part in so many of its time.
const ONE_PART_IN: u32 = 30;
const JSON: &str = "application/json";
const PROMETHEUS: &str = "text/plain; version=0.0.4";
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const THERE_ARE: &str = "expected one of /, /page.json, /status.json, /map.json, /events.json, /tracks.json, /metrics and, with [web] tiles, /tiles/ZOOM/X/Y\n";
const EXPECTED: &str = "expected /events.json?from=NUMBER, the number of the first event to show; of a recording at=MS too, the \
    milliseconds since 1970 of a moment, as /status.json and /map.json take it; or /status.json?details=PATTERN,.., the vehicles to show \
    whole by parts of their ids or tail numbers\n";
const ONLY_GET: &str = "expected GET: this page accepts no commands\n";

macro_rules! assets {
    ($($name:literal $kind:literal,)*) => {
        &[$(($name, $kind, include_bytes!(concat!("page/", $name)))),*]
    };
}

/// Name, content type and content of each file of the page.
const ASSETS: &[(&str, &str, &[u8])] = assets! {
    "index.html" "text/html; charset=utf-8",
    "style.css" "text/css",
    "main.js" "text/javascript",
    "beat.js" "text/javascript",
    "commands.js" "text/javascript",
    "confirm.js" "text/javascript",
    "control.js" "text/javascript",
    "drawing.js" "text/javascript",
    "list.js" "text/javascript",
    "map.js" "text/javascript",
    "next.js" "text/javascript",
    "panel.js" "text/javascript",
    "profile.js" "text/javascript",
    "messages.js" "text/javascript",
    "replay.js" "text/javascript",
    "socket.js" "text/javascript",
    "units.js" "text/javascript",
    "leaflet/leaflet.js" "text/javascript",
    "leaflet/leaflet.css" "text/css",
    "leaflet/LICENSE" "text/plain; charset=utf-8",
};
