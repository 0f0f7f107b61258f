//! `[http] listen`: the operator's page, /status.json, /map.json, /events.json and /metrics, which are read; and /control, where
//! `[web] control` allows it: a WebSocket by which ground stations come (`control`).
//!
//! `source` is what the page asks of the bridge, `routes` what is answered to which request, `events` what the bridge has logged of late, `metrics` the format of
//! Prometheus, `tiles` the pictures under the map; `page` holds the page itself: HTML, style, ES modules, and Leaflet for the map. All of it is in the
//! program: no other host is asked for anything.
//!
//! Only requests by address or by a configured name are answered. A web page that has its own name point to this computer
//! (DNS rebinding) sends that name as Host, and is refused.
//!
//! A connection has one answer. When all places are taken one makes room for the next: of the host that has most of them, the one
//! that has sent no request for longest (`makes_room`). However many send nothing a request is answered, and one host takes no
//! place of another.

pub mod control;
mod events;
mod metrics;
mod places;
mod routes;
mod source;
mod tiles;

use std::cell::Cell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};
use std::panic::resume_unwind;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::http::header::{CONNECTION, HOST, HeaderValue, ORIGIN};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Request, StatusCode};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinError, JoinSet};

use self::control::Door;
pub use self::events::{Event, Events};
use self::places::makes_room;
use self::routes::{Kept, Query};
pub use self::source::{PageInfo, Source, Span};
pub use self::tiles::{Tiles, TilesError, TilesInfo};
use super::tasks::Beat;
use super::test_fault;
use crate::session::computer_of;
use crate::session::web::WebRefusal;

/// What the page is served with, beside what it shows.
#[derive(Debug, Default)]
pub struct Page {
    /// Names that it may be asked by, beside `localhost` and its addresses.
    pub hosts: Vec<String>,
    /// Where ground stations come in by the WebSocket.
    pub door: Option<Door>,
    /// Pictures under the map.
    pub tiles: Option<Tiles>,
}

/// Serves until it is dropped.
///
/// # Panics
/// Where a connection has panicked: this task ends by it, and with it the program.
pub async fn serve(listener: TcpListener, page: Page, beat: Rc<Beat>, source: impl Source) {
    let Page { hosts, door, tiles } = page;
    let hosts: Rc<[String]> = hosts.into();
    // Handlers of axum may run on any thread, the bridge is of this one: they ask, and it is answered here.
    let (queries, mut asked) = mpsc::channel(MAX_CONNECTIONS);
    let mut kept = Kept::default();
    kept.tiles = tiles.as_ref().map(|tiles| tiles.info().clone());
    let routes = routes::all(queries, tiles.map(Arc::new));
    let routes = routes.merge(control::routes(door.clone()));
    let mut connections = JoinSet::new();
    let mut open: VecDeque<Connection> = VecDeque::new();
    loop {
        let accepted = beat.during(async {
            tokio::select! {
                accepted = listener.accept() => Some(accepted),
                Some(query) = asked.recv() => {
                    Query::answer(query, &source, &mut kept);
                    None
                }
                Some(ended) = connections.join_next() => {
                    // One that was dropped to make room has not panicked.
                    if let Some(Ok(cause)) = ended.err().map(JoinError::try_into_panic) {
                        resume_unwind(cause);
                    }
                    None
                }
            }
        });
        match accepted.await {
            None => open.retain(|connection| !connection.task.is_finished()),
            Some(Ok((stream, from))) => {
                let from = SocketAddr::new(from.ip().to_canonical(), from.port());
                let host = computer_of(from.ip());
                if open.len() >= MAX_CONNECTIONS {
                    let held: Vec<_> = open.iter().map(|one| (one.host, !one.sent.get())).collect();
                    let least = makes_room(&held, host);
                    if let Some(connection) = least.and_then(|at| open.remove(at)) {
                        connection.task.abort();
                    }
                }
                let sent = Rc::new(Cell::new(false));
                let of_one = (stream, from, door.clone());
                let served = answer_one(of_one, hosts.clone(), routes.clone(), sent.clone());
                let task = connections.spawn_local(test_fault::broken("page connection", served));
                open.push_back(Connection { host, sent, task });
            }
            Some(Err(cause)) => {
                tracing::warn!("the status page: {cause}");
                tokio::time::sleep(HEADER_WITHIN).await;
            }
        }
    }
}

/// An open connection, and whether its request is there.
struct Connection {
    host: u64,
    sent: Rc<Cell<bool>>,
    task: AbortHandle,
}

async fn answer_one(
    (stream, from, door): (TcpStream, SocketAddr, Option<Door>),
    hosts: Rc<[String]>,
    routes: Router,
    sent: Rc<Cell<bool>>,
) {
    let Ok(here) = stream.local_addr() else {
        return;
    };
    let answer = service_fn(move |mut request: Request<Incoming>| {
        sent.set(true);
        let checked = check_source(&request, here, &hosts);
        if let (Err((code, _)), Some(door)) = (&checked, &door)
            && request.uri().path() == control::PATH
        {
            let why = match *code {
                StatusCode::FORBIDDEN => WebRefusal::Origin,
                _ => WebRefusal::Host,
            };
            door.refuse(from, why);
        }
        request.extensions_mut().insert(control::From(from));
        let routes = TowerToHyperService::new(routes.clone());
        async move {
            let mut response = match checked {
                Ok(()) => routes.call(request).await?,
                Err((code, why)) => routes::text(code, why),
            };
            // One answer a connection: a client that stays connected would hold one of the few places. Not by hyper's own
            // keep_alive(false), which adds this beside the "upgrade" of a WebSocket, where clients take it for a refusal.
            if response.status() != StatusCode::SWITCHING_PROTOCOLS {
                let close = HeaderValue::from_static("close");
                response.headers_mut().insert(CONNECTION, close);
            }
            Ok::<_, Infallible>(response)
        }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_WITHIN)
        .max_buf_size(MAX_HEADER_BYTES)
        .serve_connection(TokioIo::new(stream), answer)
        .with_upgrades();
    // The whole of it has a time-out too: a client that reads its answer byte by byte is not waited for. A body is
    // not read at all.
    if let Ok(Err(cause)) = tokio::time::timeout(ANSWER_WITHIN, served).await {
        tracing::debug!("a connection to the status page: {cause}");
    }
}

/// Whether a request was made by the name or the address of this page, and by no other page.
fn check_source<T>(
    request: &Request<T>,
    here: SocketAddr,
    hosts: &[String],
) -> Result<(), (StatusCode, &'static str)> {
    let host = host_of(request).ok_or((StatusCode::BAD_REQUEST, "one Host is expected\n"))?;
    if !is_ours(host.host(), here, hosts) {
        return Err((StatusCode::MISDIRECTED_REQUEST, NOT_OURS));
    }
    // An image or a script of another page names no Origin; browsers say so here.
    let mut sites = request.headers().get_all("sec-fetch-site").iter();
    if sites.any(|site| site == "cross-site") {
        return Err((StatusCode::FORBIDDEN, "another page may not read this\n"));
    }
    let mut origins = request.headers().get_all(ORIGIN).iter();
    let same = |origin: &HeaderValue| {
        let origin = origin.to_str().unwrap_or_default();
        let rest = (origin.strip_prefix("http://")).or_else(|| origin.strip_prefix("https://"));
        rest.is_some_and(|rest| rest.eq_ignore_ascii_case(host.as_str()))
    };
    if origins.all(same) {
        Ok(())
    } else {
        Err((StatusCode::FORBIDDEN, "another page may not read this\n"))
    }
}

/// The host that the request names: in its target if that is an absolute URL, otherwise in its only Host header.
fn host_of<T>(request: &Request<T>) -> Option<Authority> {
    fn only(headers: &HeaderMap) -> Option<Authority> {
        let mut all = headers.get_all(HOST).iter();
        let (Some(host), None) = (all.next(), all.next()) else {
            return None;
        };
        Authority::try_from(host.as_bytes()).ok()
    }
    let header = only(request.headers())?;
    match request.uri().authority() {
        // The two differ only where somebody wants them to.
        Some(target) if *target != header => None,
        _ => Some(header),
    }
}

fn is_ours(host: &str, here: SocketAddr, hosts: &[String]) -> bool {
    let literal = host.trim_start_matches('[').trim_end_matches(']');
    match literal.parse::<IpAddr>() {
        Ok(ip) => {
            let (ip, here) = (ip.to_canonical(), here.ip().to_canonical());
            ip == here || ip.is_loopback()
        }
        Err(_) => {
            host.eq_ignore_ascii_case("localhost")
                || hosts.iter().any(|name| name.eq_ignore_ascii_case(host))
        }
    }
}

const NOT_OURS: &str =
    "this page is read by its address, by localhost or by a name of [http] hosts\n";
const MAX_CONNECTIONS: usize = 64;
/// A request of a browser has some 500 bytes; hyper takes no less.
const MAX_HEADER_BYTES: usize = 8_192;
const HEADER_WITHIN: Duration = Duration::from_secs(2);
const ANSWER_WITHIN: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpSocket;
    use tokio::task::LocalSet;

    use super::*;
    use crate::session::{Status, VehicleMap};

    struct Nothing;

    impl Source for Nothing {
        fn page(&self) -> PageInfo {
            PageInfo::default()
        }

        fn status(&self, _moment: Option<Duration>) -> Status {
            Status {
                vsm: "1b:00:00:01".to_owned(),
                uptime_s: 1.0,
                warnings: Vec::new(),
                findings: Vec::new(),
                logged: Vec::new(),
                refused: Default::default(),
                set_aside: Default::default(),
                received: Default::default(),
                sent: Default::default(),
                message_names: Default::default(),
                stations: Vec::new(),
                rights: Vec::new(),
                access: None,
                vehicles: Vec::new(),
                forwards: Vec::new(),
                recordings: Default::default(),
                held: Default::default(),
                memory_locked: false,
            }
        }

        fn map(&self, _moment: Option<Duration>) -> Vec<VehicleMap> {
            Vec::new()
        }

        fn events(&self, _moment: Option<Duration>) -> Vec<Event> {
            Vec::new()
        }
    }

    async fn page() -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("its address");
        let page = Page {
            hosts: vec!["vsm.example".to_owned()],
            ..Page::default()
        };
        tokio::task::spawn_local(serve(listener, page, Rc::default(), Nothing));
        address
    }

    async fn get(address: SocketAddr, target: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(address).await.expect("it accepts");
        let request = format!("GET {target} HTTP/1.1\r\n{headers}\r\n");
        stream
            .write_all(request.as_bytes())
            .await
            .expect("it reads");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer).await;
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// The status code alone.
    async fn code(address: SocketAddr, target: &str, headers: &str) -> String {
        let answer = get(address, target, headers).await;
        answer.get(9..12).unwrap_or(&answer).to_owned()
    }

    fn run<T>(test: impl Future<Output = T>) -> T {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build();
        LocalSet::new().block_on(&runtime.expect("a runtime"), test)
    }

    #[test]
    fn only_who_asks_by_an_own_name_is_answered() {
        run(async {
            let address = page().await;
            let port = address.port();
            let mut codes = BTreeMap::new();
            for (host, expected) in [
                (format!("127.0.0.1:{port}"), "200"),
                (format!("localhost:{port}"), "200"),
                ("LOCALHOST".to_owned(), "200"),
                (format!("[::1]:{port}"), "200"),
                ("vsm.example".to_owned(), "200"),
                ("attacker.example".to_owned(), "421"),
                (format!("attacker.example:{port}"), "421"),
                ("localhost.attacker.example".to_owned(), "421"),
                ("127.0.0.1.attacker.example".to_owned(), "421"),
                ("192.0.2.1".to_owned(), "421"),
                ("0.0.0.0".to_owned(), "421"),
                ("user@127.0.0.1@attacker.example".to_owned(), "421"),
                (String::new(), "400"),
            ] {
                let code = code(address, "/status.json", &format!("Host: {host}\r\n")).await;
                codes.insert(host, (code, expected.to_owned()));
            }
            assert!(
                codes.values().all(|(is, expected)| is == expected),
                "{codes:?}"
            );
            assert_eq!(code(address, "/", "").await, "400", "no Host");
            let two = "Host: localhost\r\nHost: attacker.example\r\n";
            assert_eq!(code(address, "/", two).await, "400", "two of them");
            let url = "http://attacker.example/status.json";
            assert_eq!(code(address, url, "Host: localhost\r\n").await, "400");
            assert_eq!(
                code(address, url, "Host: attacker.example\r\n").await,
                "421"
            );
        });
    }

    /// A computer may have every address of its network.
    #[test]
    fn one_network_of_ipv6_takes_no_place_of_another() {
        let of = |text: &str| computer_of(text.parse().expect("an address"));
        let held = [
            "2001:db8::5",
            "2001:db8:1::1",
            "2001:db8:1::2",
            "2001:db8:1::4",
        ];
        let held = held.map(|text| (of(text), true));
        for newcomer in ["2001:db8:1::3", "2001:db8::6", "192.0.2.1"] {
            assert_eq!(makes_room(&held, of(newcomer)), Some(1), "{newcomer}");
        }
        // One after the other, each by an address of its own.
        assert_eq!(makes_room(&held[..2], of("2001:db8:1::9")), Some(1));
    }

    #[test]
    fn one_host_takes_no_place_of_another() {
        run(async {
            let address = page().await;
            let mut slow = TcpStream::connect(address).await.expect("it accepts");
            let mut others = Vec::new();
            for _ in 0..3 * MAX_CONNECTIONS {
                let socket = TcpSocket::new_v4().expect("a socket");
                let from = "127.0.0.2:0".parse().expect("an address");
                socket.bind(from).expect("it is this computer's");
                others.push(socket.connect(address).await.expect("it accepts"));
            }
            let host = format!("Host: {address}\r\n");
            // Accepted after all of them.
            assert_eq!(code(address, "/status.json", &host).await, "200");
            let request = format!("GET /status.json HTTP/1.1\r\n{host}\r\n");
            slow.write_all(request.as_bytes())
                .await
                .expect("it is open");
            let mut answer = String::new();
            slow.read_to_string(&mut answer).await.expect("an answer");
            assert!(answer.starts_with("HTTP/1.1 200"), "{answer:.80}");
        });
    }

    #[test]
    fn every_file_of_the_page_is_served_and_names_no_other_host() {
        run(async {
            let address = page().await;
            let host = format!("Host: {address}\r\n");
            let mut open = vec!["/".to_owned()];
            let mut seen = Vec::new();
            while let Some(target) = open.pop() {
                let answer = get(address, &target, &host).await;
                assert!(answer.starts_with("HTTP/1.1 200"), "{target}: {answer:.80}");
                assert!(
                    answer.contains("script-src 'self'"),
                    "{target} has the policy"
                );
                // What the page loads: of an attribute, an import, or fetched.
                let quoted = answer
                    .split(['"', '\''])
                    .filter(|_| !target.contains("leaflet"));
                for name in
                    quoted.filter(|name| name.starts_with("page/") || name.starts_with("./"))
                {
                    let name = format!(
                        "/page/{}",
                        name.trim_start_matches("page/").trim_start_matches("./")
                    );
                    if !seen.contains(&name) {
                        seen.push(name.clone());
                        open.push(name);
                    }
                }
                if !target.contains("leaflet") {
                    // The name of SVG is one, and no address.
                    let others = answer.replace("http://www.w3.org/2000/svg", "");
                    assert!(!others.contains("://"), "{target} names another host");
                }
            }
            assert!(seen.len() >= 7, "{seen:?}");
            assert_eq!(code(address, "/page/../mod.rs", &host).await, "404");
            assert_eq!(code(address, "/events.json?from=x", &host).await, "400");
            assert_eq!(code(address, "/events.json?from=7", &host).await, "200");
            assert_eq!(code(address, "/status.json?at=7", &host).await, "200");
            assert_eq!(code(address, "/status.json?at=7&at=8", &host).await, "400");
            assert_eq!(code(address, "/map.json?from=7", &host).await, "400");
            let many = format!("/status.json?details={}", "a,".repeat(17));
            for (target, expected) in [
                (many.as_str(), "400"),
                ("/status.json?details=", "200"),
                ("/status.json?details=1b:00:00:02,UAV-1*&at=7", "200"),
                ("/status.json?details=a&details=b", "400"),
                ("/map.json?details=a", "400"),
                ("/events.json?details=a", "400"),
            ] {
                assert_eq!(code(address, target, &host).await, expected, "{target}");
            }
            assert_eq!(code(address, "/page.json", &host).await, "200");
            assert_eq!(code(address, "/map.json", &host).await, "200");
            let metrics = get(address, "/metrics", &host).await;
            assert!(metrics.contains("# HELP vsm_uptime_seconds"), "{metrics}");
        });
    }

    #[test]
    fn each_metric_has_its_help_and_type_and_the_dashboard_names_no_other() {
        let text = metrics::text(&Nothing.status(None));
        let named = |word: &str| {
            let lines = text.lines().filter_map(|line| line.strip_prefix(word));
            let names = lines.filter_map(|line| line.split(' ').next());
            names.collect::<BTreeSet<&str>>()
        };
        let families = named("# HELP ");
        assert_eq!(families, named("# TYPE "));
        for sample in text.lines().filter(|line| !line.starts_with('#')) {
            let name = sample.split(['{', ' ']).next().unwrap_or_default();
            assert!(families.contains(name), "{sample}");
        }
        let dashboard = include_str!("../../../../packaging/grafana/vsm.json");
        let words = dashboard.split(|one: char| one != '_' && !one.is_ascii_alphanumeric());
        let shown: BTreeSet<&str> = words.filter(|word| word.starts_with("vsm_")).collect();
        assert!(shown.contains("vsm_vehicle_controller"), "{shown:?}");
        assert!(shown.is_subset(&families), "{shown:?} of {families:?}");
    }

    #[test]
    fn no_other_page_reads_it() {
        run(async {
            let address = page().await;
            let with = |origin: &str| format!("Host: {address}\r\nOrigin: {origin}\r\n");
            let own = with(&format!("http://{address}"));
            assert_eq!(code(address, "/status.json", &own).await, "200");
            for (site, expected) in [
                ("cross-site", "403"),
                ("same-origin", "200"),
                ("none", "200"),
            ] {
                let headers = format!("Host: {address}\r\nSec-Fetch-Site: {site}\r\n");
                assert_eq!(
                    code(address, "/status.json", &headers).await,
                    expected,
                    "{site}"
                );
            }
            for other in ["http://attacker.example", "null", "http://127.0.0.1:1", ""] {
                assert_eq!(
                    code(address, "/status.json", &with(other)).await,
                    "403",
                    "{other}"
                );
            }
        });
    }

    #[test]
    fn without_tiles_none_are_named_and_none_are_served() {
        run(async {
            let address = page().await;
            let host = format!("Host: {address}\r\n");
            let answer = get(address, "/page.json", &host).await;
            assert!(answer.contains("\"tiles\":null"), "{answer}");
            assert_eq!(code(address, "/tiles/0/0/0", &host).await, "404");
        });
    }

    #[test]
    fn however_many_ask_it_is_composed_five_times_a_second() {
        let asked = Cell::new(0);
        struct Counted<'a>(&'a Cell<u32>);
        impl Source for Counted<'_> {
            fn page(&self) -> PageInfo {
                PageInfo::default()
            }

            fn status(&self, moment: Option<Duration>) -> Status {
                self.0.set(self.0.get() + 1);
                Nothing.status(moment)
            }

            fn map(&self, _moment: Option<Duration>) -> Vec<VehicleMap> {
                Vec::new()
            }

            fn events(&self, _moment: Option<Duration>) -> Vec<Event> {
                self.0.set(self.0.get() + 1);
                let event = |number| Event {
                    number,
                    at_ms: 1,
                    level: "info",
                    about: "1b:00:00:01".to_owned(),
                    text: "a text".to_owned(),
                };
                (7..10).map(event).collect()
            }
        }
        let mut kept = Kept::default();
        for _ in 0..20 {
            let (to, mut answer) = tokio::sync::oneshot::channel();
            Query::Status(None, None, to).answer(&Counted(&asked), &mut kept);
            assert!(answer.try_recv().is_ok_and(|body| !body.is_empty()));
        }
        assert!(asked.get() <= 2, "{}", asked.get());
        // Nor does it help to ask for other moments, of which there is none but now, or for other vehicles.
        let mut bodies = std::collections::BTreeSet::new();
        for number in 0..100 {
            let (to, mut answer) = tokio::sync::oneshot::channel();
            let at = Some(Duration::from_secs(number));
            let chosen = format!("{number:02}").parse().expect("a pattern");
            Query::Status(at, Some(vec![chosen]), to).answer(&Counted(&asked), &mut kept);
            bodies.insert(answer.try_recv().expect("it is answered").as_ptr());
        }
        assert!(asked.get() <= 4, "{}", asked.get());
        assert!(bodies.len() < 99, "{}", bodies.len());
        std::thread::sleep(Duration::from_millis(210));
        let (to, _answer) = tokio::sync::oneshot::channel();
        let before = asked.get();
        Query::Status(None, None, to).answer(&Counted(&asked), &mut kept);
        assert_eq!(asked.get(), before + 1);

        // Of events each client gets those that it has not been sent, of one list.
        let before = asked.get();
        for (from, numbers) in [
            (0, &[7_u64, 8, 9][..]),
            (9, &[9]),
            (10, &[]),
            (u64::MAX, &[]),
        ] {
            let (to, mut answer) = tokio::sync::oneshot::channel();
            Query::Events(from, None, to).answer(&Counted(&asked), &mut kept);
            let body = answer.try_recv().expect("it is answered");
            let all: serde_json::Value = serde_json::from_slice(&body).expect("JSON");
            let each = all.as_array().expect("a list").iter();
            let found: Vec<u64> = each.filter_map(|one| one["number"].as_u64()).collect();
            assert_eq!(found, numbers, "from {from}");
        }
        assert!(asked.get() <= before + 2, "{}", asked.get());
    }

    /// Nobody keeps one of the few places by a header that never ends, however busily it is written.
    #[test]
    fn a_header_that_does_not_end_is_not_waited_for() {
        run(async {
            let address = page().await;
            let begun = tokio::time::Instant::now();
            let slow = async {
                let mut stream = TcpStream::connect(address).await.expect("it accepts");
                let (mut reads, mut writes) = stream.split();
                let drip = async {
                    for byte in b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "
                        .iter()
                        .chain([b'x'; 99].iter())
                    {
                        if writes.write_all(&[*byte]).await.is_err() {
                            break;
                        }
                        tokio::time::sleep(Duration::from_millis(100)).await;
                    }
                };
                let mut answer = Vec::new();
                tokio::select! {
                    _ = reads.read_to_end(&mut answer) => {}
                    () = drip => {}
                }
                assert!(!answer.starts_with(b"HTTP/1.1 200"), "it was no request");
            };
            let silent = async {
                let mut stream = TcpStream::connect(address).await.expect("it accepts");
                stream.write_all(b"GET / HT").await.expect("it reads");
                let mut answer = Vec::new();
                let _ = stream.read_to_end(&mut answer).await;
            };
            tokio::join!(slow, silent);
            let took = begun.elapsed();
            let least = HEADER_WITHIN.mul_f64(0.9);
            assert!(took > least && took < 2 * HEADER_WITHIN, "{took:?}");
        });
    }

    #[test]
    fn who_asks_is_answered_beside_300_connections_that_say_nothing_or_little() {
        run(async {
            let address = page().await;
            let mut slow = Vec::new();
            for number in 0..300 {
                let mut stream = TcpStream::connect(address).await.expect("it accepts");
                match number % 3 {
                    0 => {}
                    1 => stream.write_all(b"GET / HT").await.expect("it reads"),
                    // A whole request, whose answer is not read.
                    _ => {
                        let request = format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n");
                        stream
                            .write_all(request.as_bytes())
                            .await
                            .expect("it reads");
                    }
                }
                slow.push(stream);
                if number % 50 == 0 {
                    let host = format!("Host: {address}\r\n");
                    assert_eq!(
                        code(address, "/status.json", &host).await,
                        "200",
                        "{number}"
                    );
                }
            }
            let host = format!("Host: {address}\r\n");
            let answered = tokio::time::timeout(Duration::from_secs(10), code(address, "/", &host));
            assert_eq!(answered.await.expect("in time"), "200");
            drop(slow);
        });
    }
}
