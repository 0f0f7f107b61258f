//! `[http] listen`: the status page, /status.json and /metrics. Nothing can be commanded here, only read.

use std::convert::Infallible;
use std::fmt::Write as _;
use std::panic::resume_unwind;
use std::rc::Rc;
use std::time::Duration;

use bytes::Bytes;
use http_body_util::Full;
use hyper::body::Incoming;
use hyper::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::tasks::Beat;
use super::test_fault;
use crate::session::Status;

/// Serves until it is dropped; `status` gives a picture of now.
///
/// # Panics
/// Where a connection has panicked: this task ends by it, and with it the program.
pub async fn serve(listener: TcpListener, beat: Rc<Beat>, status: impl Fn() -> Status + 'static) {
    let status = Rc::new(status);
    let mut connections = JoinSet::new();
    loop {
        let accepted = beat.during(async {
            tokio::select! {
                // Whoever opens connections and says nothing uses up these places, and nothing else.
                accepted = listener.accept(), if connections.len() < MAX_CONNECTIONS => Some(accepted),
                Some(ended) = connections.join_next() => {
                    if let Err(cause) = ended {
                        resume_unwind(cause.into_panic());
                    }
                    None
                }
            }
        });
        match accepted.await {
            None => {}
            Some(Ok((stream, _))) => {
                let connection = connection(stream, status.clone());
                connections.spawn_local(test_fault::broken("page connection", connection));
            }
            Some(Err(cause)) => {
                tracing::warn!("the status page: {cause}");
                tokio::time::sleep(HEADER_WITHIN).await;
            }
        }
    }
}

async fn connection(stream: TcpStream, status: Rc<impl Fn() -> Status + 'static>) {
    let answer = service_fn(move |request| {
        let answered = answer(&request, &*status);
        async move { Ok::<_, Infallible>(answered) }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_WITHIN)
        // One answer a connection: a client that stays connected would hold one of the few places.
        .keep_alive(false)
        .serve_connection(TokioIo::new(stream), answer);
    if let Ok(Err(cause)) = tokio::time::timeout(ANSWER_WITHIN, served).await {
        tracing::debug!("a connection to the status page: {cause}");
    }
}

fn answer(request: &Request<Incoming>, status: &dyn Fn() -> Status) -> Response<Full<Bytes>> {
    // Commands go through the DLI alone, where the level of interoperability is checked.
    if request.method() != Method::GET {
        return text(
            StatusCode::METHOD_NOT_ALLOWED,
            "text/plain",
            "only GET: nothing is commanded here\n".to_owned(),
        );
    }
    match request.uri().path() {
        "/" => text(StatusCode::OK, "text/html; charset=utf-8", PAGE.to_owned()),
        "/status.json" => {
            let json = serde_json::to_string(&status()).unwrap_or_default();
            text(StatusCode::OK, "application/json", json)
        }
        "/metrics" => text(
            StatusCode::OK,
            "text/plain; version=0.0.4",
            metrics(&status()),
        ),
        _ => text(
            StatusCode::NOT_FOUND,
            "text/plain",
            "there are /, /status.json and /metrics\n".to_owned(),
        ),
    }
}

fn text(code: StatusCode, kind: &'static str, body: String) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(body)));
    *response.status_mut() = code;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static(kind));
    headers.insert(
        CACHE_CONTROL,
        hyper::header::HeaderValue::from_static("no-store"),
    );
    // The page holds its script and style itself, and fetches nothing but /status.json.
    let policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'";
    headers.insert(
        CONTENT_SECURITY_POLICY,
        hyper::header::HeaderValue::from_static(policy),
    );
    response
}

/// The counters in the text format of Prometheus.
fn metrics(status: &Status) -> String {
    let mut text = String::from("# TYPE vsm_uptime_seconds gauge\n");
    let _ = writeln!(text, "vsm_uptime_seconds {}", status.uptime_s);
    text.push_str("# TYPE vsm_dli_received_total counter\n");
    for (kind, count) in status.received.iter() {
        let _ = writeln!(text, "vsm_dli_received_total{{type=\"{kind}\"}} {count}");
    }
    text.push_str("# TYPE vsm_dli_sent_total counter\n");
    for (kind, count) in status.sent.iter() {
        let _ = writeln!(text, "vsm_dli_sent_total{{type=\"{kind}\"}} {count}");
    }
    text.push_str("# TYPE vsm_dli_refused_total counter\n");
    for (reason, count) in status.refused.iter() {
        let _ = writeln!(text, "vsm_dli_refused_total{{reason=\"{reason}\"}} {count}");
    }
    text.push_str("# TYPE vsm_vehicle_live gauge\n");
    for vehicle in &status.vehicles {
        let _ = writeln!(
            text,
            "vsm_vehicle_live{{vehicle=\"{}\"}} {}",
            vehicle.id,
            u8::from(vehicle.live)
        );
    }
    text.push_str("# TYPE vsm_mavlink_frames_total counter\n");
    for vehicle in &status.vehicles {
        for (what, count) in &vehicle.link.frames {
            let _ = writeln!(
                text,
                "vsm_mavlink_frames_total{{vehicle=\"{}\",what=\"{what}\"}} {count}",
                vehicle.id
            );
        }
    }
    text
}

const PAGE: &str = include_str!("status.html");
const MAX_CONNECTIONS: usize = 16;
const HEADER_WITHIN: Duration = Duration::from_secs(2);
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
