//! `vsm demo --web`: the vehicle is whose who opens the page; with a flight of its own the page shows that first. Until Ctrl-C.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use kit::process::{Running, program};
use serde_json::Value;

#[test]
fn the_vehicle_is_left_to_who_opens_the_page() {
    let out = tempfile::tempdir().expect("a folder");
    let folder = out.path().to_str().expect("its name");
    let mut demo = Running::start(&program("vsm"), ["demo", "--web", "0", "--out", folder]);
    demo.wait_for("stays until Ctrl-C", LIMIT);
    let printed = demo.output();
    let page = address(&printed);
    assert_eq!(json(page, "/page.json")["control"], true);
    has_a_key(&printed, page);
    let vehicle = &json(page, "/status.json")["vehicles"][0];
    assert_eq!(vehicle["live"], true, "{vehicle}");
    assert_eq!(vehicle["armed"], false, "{vehicle}");
    assert_eq!(vehicle["controller"], Value::Null, "{vehicle}");
    demo.signal("INT");
    let ended = demo.wait(LIMIT).expect("it ends");
    assert!(ended.success(), "{}", demo.output());
    TcpStream::connect(page).expect_err("the page has ended with it");
}

#[test]
fn the_page_shows_the_flight_and_stays_until_it_is_interrupted() {
    let out = tempfile::tempdir().expect("a folder");
    let folder = out.path().to_str().expect("its name");
    let arguments = [
        "demo", "--wing", "--web", "0", "--speed", "20", "--out", folder,
    ];
    let mut demo = Running::start(&program("vsm"), arguments);
    demo.wait_for("flies the route", LIMIT);
    let printed = demo.output();
    let page = address(&printed);
    assert!(get(page, "/").contains("<title>vsm</title>"));
    assert_eq!(json(page, "/page.json")["control"], true);
    has_a_key(&printed, page);
    let flying = &json(page, "/status.json")["vehicles"][0];
    assert_eq!(flying["armed"], true, "{flying}");
    assert_eq!(flying["controller"], "1b:00:00:a0", "{flying}");
    demo.wait_for("stays until Ctrl-C", LIMIT);
    let waypoints = &json(page, "/map.json")[0]["route"]["waypoints"];
    assert_eq!(waypoints.as_array().map(Vec::len), Some(5), "{waypoints}");
    assert!(
        !out.path().join("flight.svg").exists(),
        "it has not ended yet"
    );
    demo.signal("INT");
    let ended = demo.wait(LIMIT).expect("it ends");
    assert!(ended.success(), "{}", demo.output());
    assert!(out.path().join("flight.svg").exists(), "{}", demo.output());
    TcpStream::connect(page).expect_err("the page has ended with it");
}

#[test]
fn who_has_seen_enough_ends_it_in_flight() {
    let out = tempfile::tempdir().expect("a folder");
    let folder = out.path().to_str().expect("its name");
    let arguments = ["demo", "--wing", "--web=0", "--out", folder];
    let mut demo = Running::start(&program("vsm"), arguments);
    demo.wait_for("flies on its wings", LIMIT);
    demo.signal("INT");
    let ended = demo.wait(LIMIT).expect("it ends");
    assert!(ended.success(), "{}", demo.output());
}

/// Where the page is, as the demo prints it.
pub(super) fn address(printed: &str) -> &str {
    let page = printed.split("http://").nth(1);
    page.and_then(|rest| rest.split('/').next())
        .expect("its address")
}

/// Who opens the link has a ground station of its own.
fn has_a_key(printed: &str, page: &str) {
    let link = format!("http://{page}/#1b:00:00:b0=");
    let key = printed.split(&link).nth(1).expect("the link to fly by");
    let digits = key.chars().take_while(char::is_ascii_hexdigit).count();
    assert_eq!(digits, 64, "{printed}");
}

pub(super) fn json(page: &str, path: &str) -> Value {
    let answer = get(page, path);
    let body = answer.split("\r\n\r\n").nth(1).unwrap_or_default();
    serde_json::from_str(body).unwrap_or_else(|fault| panic!("{fault}: {answer}"))
}

fn get(page: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(page).expect("it accepts");
    let request = format!("GET {path} HTTP/1.1\r\nHost: {page}\r\n\r\n");
    stream
        .write_all(request.as_bytes())
        .expect("it takes the request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("it answers");
    answer
}

const LIMIT: Duration = Duration::from_secs(40);
