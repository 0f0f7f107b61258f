//! The operator's cards as a local web page: `/` is the page, `/card` the current card, `/reply` accepts the reply to
//! it.
//!
//! Only this computer may use it, under a name of the loopback. A web page whose own name points here (DNS rebinding)
//! sends that name as Host and is refused; a reply sent by another page's script is refused by its Origin.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderValue, ORIGIN,
};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde::Deserialize;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

use super::board::{Board, Reply};

const PAGE: &str = include_str!("page.html");
/// Longest body of a reply, bytes.
const MAX_REPLY_BYTES: usize = 4_096;
/// Connections served at once.
const MAX_CONNECTIONS: usize = 32;
/// How long a client may take for its request: an idle one would hold its place otherwise.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);

/// Serves the board on its own thread until the program ends; returns the address.
///
/// # Errors
/// The address is not one of the loopback, or cannot be bound; in a sentence.
pub fn serve(address: SocketAddr, board: &Arc<Board>) -> Result<SocketAddr, String> {
    if !address.ip().is_loopback() {
        return Err(format!(
            "--page is {address}, expected an address of the loopback, such as 127.0.0.1:8080: whoever reads the page can answer for the operator"
        ));
    }
    let failed = |error: std::io::Error| format!("--page {address}: {error}");
    let listener = std::net::TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let here = listener.local_addr().map_err(failed)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(failed)?;
    let board = board.clone();
    std::thread::spawn(move || {
        runtime.block_on(async {
            let Ok(listener) = TcpListener::from_std(listener) else {
                return;
            };
            let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
            loop {
                let Ok(place) = places.clone().acquire_owned().await else {
                    return;
                };
                let Ok((stream, _)) = listener.accept().await else {
                    continue;
                };
                let board = board.clone();
                tokio::spawn(async move {
                    let answer = service_fn(move |request| {
                        let board = board.clone();
                        async move { Ok::<_, Infallible>(answer(request, here, &board).await) }
                    });
                    let served = hyper::server::conn::http1::Builder::new()
                        .timer(TokioTimer::new())
                        .header_read_timeout(ANSWER_WITHIN)
                        .keep_alive(false)
                        .serve_connection(TokioIo::new(stream), answer);
                    let _ = tokio::time::timeout(ANSWER_WITHIN, served).await;
                    drop(place);
                });
            }
        });
    });
    Ok(here)
}

/// A reply as the page sends it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Given {
    number: usize,
    reply: Reply,
    #[serde(default)]
    name: String,
}

async fn answer(
    request: Request<Incoming>,
    here: SocketAddr,
    board: &Board,
) -> Response<Full<Bytes>> {
    if let Err((code, why)) = check_source(&request, here) {
        return text(code, "text/plain", why.into());
    }
    match (request.method(), request.uri().path()) {
        (&Method::GET, "/") => text(StatusCode::OK, "text/html; charset=utf-8", PAGE.into()),
        (&Method::GET, "/card") => {
            let card = serde_json::to_string(&board.card()).unwrap_or_default();
            text(StatusCode::OK, "application/json", card)
        }
        (&Method::POST, "/reply") => {
            let Ok(body) = Limited::new(request.into_body(), MAX_REPLY_BYTES)
                .collect()
                .await
            else {
                return text(
                    StatusCode::PAYLOAD_TOO_LARGE,
                    "text/plain",
                    format!("expected at most {MAX_REPLY_BYTES} bytes\n"),
                );
            };
            match serde_json::from_slice::<Given>(&body.to_bytes()) {
                Err(error) => text(
                    StatusCode::BAD_REQUEST,
                    "text/plain",
                    format!(
                        "{error}; expected {{\"number\": 1, \"reply\": \"yes\", \"name\": \"...\"}}\n"
                    ),
                ),
                Ok(given) => match board.reply(given.number, given.reply, &given.name) {
                    Ok(()) => text(StatusCode::OK, "text/plain", "taken\n".into()),
                    Err(error) => text(StatusCode::CONFLICT, "text/plain", format!("{error}\n")),
                },
            }
        }
        _ => text(
            StatusCode::NOT_FOUND,
            "text/plain",
            "there are GET /, GET /card and POST /reply\n".into(),
        ),
    }
}

/// Whether the request names this page by the loopback, and comes from no other page. A request that changes
/// something must carry Origin: a browser sends it with every POST.
fn check_source<T>(
    request: &Request<T>,
    here: SocketAddr,
) -> Result<(), (StatusCode, &'static str)> {
    let mut hosts = request.headers().get_all(HOST).iter();
    let host = match (hosts.next().map(HeaderValue::to_str), hosts.next()) {
        (Some(Ok(host)), None) => host.to_owned(),
        _ => return Err((StatusCode::BAD_REQUEST, "one Host is expected\n")),
    };
    let ours = [here.to_string(), format!("localhost:{}", here.port())];
    if !ours.contains(&host) {
        return Err((
            StatusCode::MISDIRECTED_REQUEST,
            "this page is read by its address or by localhost\n",
        ));
    }
    let mut origins = request.headers().get_all(ORIGIN).iter().peekable();
    let writes = request.method() != Method::GET;
    if writes && origins.peek().is_none()
        || !origins.all(|origin| origin.as_bytes() == format!("http://{host}").as_bytes())
    {
        return Err((StatusCode::FORBIDDEN, "another page may not use this one\n"));
    }
    Ok(())
}

fn text(code: StatusCode, kind: &'static str, body: String) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(body)));
    *response.status_mut() = code;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'";
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy));
    response
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};

    use super::*;
    use crate::scripted::Scenario;

    fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = std::net::TcpStream::connect(address).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    }

    fn post(address: SocketAddr, headers: &str, body: &str) -> String {
        let length = body.len();
        ask(
            address,
            &format!("POST /reply HTTP/1.1\r\n{headers}Content-Length: {length}\r\n\r\n{body}"),
        )
    }

    #[test]
    fn the_page_is_for_this_computer_and_for_no_other_page() {
        let board = Arc::new(Board::new("Operator"));
        let scenario = Scenario::named("normal").unwrap();
        let step = scenario
            .step
            .iter()
            .find(|step| step.question.is_some())
            .unwrap();
        board.show(&scenario, step, (6, 20));
        let here = serve("127.0.0.1:0".parse().unwrap(), &board).unwrap();
        let own = format!("Host: {here}\r\n");
        assert!(ask(here, &format!("GET / HTTP/1.1\r\n{own}\r\n")).contains("200 OK"));
        assert!(ask(here, "GET /card HTTP/1.1\r\nHost: attacker.example\r\n\r\n").contains("421"));
        assert!(ask(here, "GET /card HTTP/1.1\r\n\r\n").contains("400"));
        let card = ask(here, &format!("GET /card HTTP/1.1\r\n{own}\r\n"));
        assert!(card.contains("\"number\":6"), "{card}");
        let origin = format!("{own}Origin: http://{here}\r\n");
        let reply = r#"{"number": 6, "reply": "no", "name": "A. Tester"}"#;
        assert!(post(here, &own, reply).contains("403"), "without Origin");
        let foreign = format!("{own}Origin: http://attacker.example\r\n");
        assert!(post(here, &foreign, reply).contains("403"));
        assert_eq!(board.take_reply(), None);
        assert!(post(here, &origin, "{}").contains("400"));
        assert!(post(here, &origin, &"x".repeat(5_000)).contains("413"));
        assert!(post(here, &origin, r#"{"number": 5, "reply": "no"}"#).contains("409"));
        assert!(post(here, &origin, reply).contains("200 OK"));
        assert_eq!(board.take_reply(), Some((Reply::No, "A. Tester".into())));
    }

    #[test]
    fn it_is_served_on_the_loopback_only() {
        let board = Arc::new(Board::new("Operator"));
        let error = serve("0.0.0.0:0".parse().unwrap(), &board).unwrap_err();
        assert!(
            error.contains("0.0.0.0:0") && error.contains("loopback"),
            "{error}"
        );
    }
}
