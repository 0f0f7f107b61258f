//! What is answered to which request.

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

use super::metrics;
use super::source::Source;

/// A question to the bridge, and where its answer goes: JSON, or the text of /metrics.
#[derive(Debug)]
pub(super) enum Query {
    Status(oneshot::Sender<Bytes>),
    Map(oneshot::Sender<Bytes>),
    Events(u64, oneshot::Sender<Bytes>),
    Metrics(oneshot::Sender<Bytes>),
}

impl Query {
    /// Answers it; whoever asked may have left.
    pub(super) fn answer(self, source: &impl Source, kept: &mut Kept) {
        let _ = match self {
            Query::Status(to) => to.send(kept.status.get(|| json(&source.status()))),
            Query::Map(to) => to.send(kept.map.get(|| json(&source.map()))),
            Query::Events(from, to) => to.send(json(&source.events(from)).into()),
            Query::Metrics(to) => to.send(kept.metrics.get(|| metrics::text(&source.status()))),
        };
    }
}

/// What was answered last: however many ask, the thread that flies composes it a few times a second.
#[derive(Debug, Default)]
pub(super) struct Kept {
    status: Answer,
    map: Answer,
    metrics: Answer,
}

#[derive(Debug, Default)]
struct Answer(Option<(Instant, Bytes)>);

impl Answer {
    fn get(&mut self, compose: impl FnOnce() -> String) -> Bytes {
        match &self.0 {
            Some((at, body)) if at.elapsed() < KEPT => body.clone(),
            _ => {
                let body = Bytes::from(compose());
                self.0 = Some((Instant::now(), body.clone()));
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
pub(super) fn all(queries: Queries) -> Router {
    Router::new()
        .route("/", get(|| async { asset("index.html") }))
        .route(
            "/page/{*name}",
            get(|Path(name): Path<String>| async move { asset(&name) }),
        )
        .route(
            "/status.json",
            get(|State(to)| ask(to, Query::Status, JSON)),
        )
        .route("/map.json", get(|State(to)| ask(to, Query::Map, JSON)))
        .route("/events.json", get(events))
        .route(
            "/metrics",
            get(|State(to)| ask(to, Query::Metrics, PROMETHEUS)),
        )
        .fallback(async || text(StatusCode::NOT_FOUND, THERE_ARE))
        // Commands go through the DLI alone, where the level of interoperability is checked.
        .method_not_allowed_fallback(async || text(StatusCode::METHOD_NOT_ALLOWED, ONLY_GET))
        .with_state(queries)
}

/// /events.json, or /events.json?from=NUMBER.
async fn events(State(to): State<Queries>, RawQuery(query): RawQuery) -> Response<Body> {
    let from = match query.as_deref() {
        None => Some(0),
        Some(query) => query.strip_prefix("from=").and_then(|n| n.parse().ok()),
    };
    match from {
        Some(from) => ask(to, |answer| Query::Events(from, answer), JSON).await,
        None => text(
            StatusCode::BAD_REQUEST,
            "expected /events.json?from=NUMBER, the number of the first event to show\n",
        ),
    }
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

const KEPT: Duration = Duration::from_millis(200);
const JSON: &str = "application/json";
const PROMETHEUS: &str = "text/plain; version=0.0.4";
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const THERE_ARE: &str = "there are /, /status.json, /map.json, /events.json and /metrics\n";
const ONLY_GET: &str = "only GET: nothing is commanded here\n";

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
    "map.js" "text/javascript",
    "panel.js" "text/javascript",
    "profile.js" "text/javascript",
    "units.js" "text/javascript",
    "leaflet/leaflet.js" "text/javascript",
    "leaflet/leaflet.css" "text/css",
    "leaflet/LICENSE" "text/plain; charset=utf-8",
};
