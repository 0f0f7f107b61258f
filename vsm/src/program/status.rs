//! `vsm status`.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::config::Config;
use crate::session::VehiclePattern;
use crate::shell::guard_agreed::AgreedFiles;
use crate::shell::memory::CURE;
use crate::shell::status_socket;
use anyhow::Context as _;
use serde_json::{Value, json};
use stanag_msgs::enums::LoiBitmap;

use super::process::{
    Failure, act_for, escaped, failed, load, named_store, print, report_line, waiting,
};
use super::status_vehicles::{self as vehicles, list};
pub(super) use super::status_vehicles::{counts, encryption, plain};

/// `only`: of which vehicles; all where there is none.
pub(crate) fn show(path: &Path, json: bool, only: Option<&VehiclePattern>) -> Result<(), Failure> {
    let store = match Config::load(path) {
        Ok(_) => load(path)?.store.dir,
        Err(fault) => running_store(path, fault.into())?,
    };
    let Some(only) = only else {
        return report("vsm", &store, json, |status| {
            readable(status, vehicles::are_many(status))
        });
    };
    let mut status = parsed("vsm", &asked("vsm", &store)?)?;
    vehicles::narrow(&mut status, only).map_err(failed)?;
    if json {
        return print(&format!("{status}\n"));
    }
    print(&readable(&visible(status), false))
}

/// The store of the bridge that runs with a configuration whose file is wrong by now, such as after a reload that was refused: what
/// it reports is needed then more than ever. The fault is a line of standard error.
fn running_store(path: &Path, fault: anyhow::Error) -> Result<PathBuf, Failure> {
    let answers = |store: &PathBuf| {
        let text = status_socket::ask(store, status_socket::STATUS, ANSWER_WITHIN);
        // No agent, whose file was given by mistake.
        let status = text.ok().and_then(|text| parsed("vsm", &text).ok());
        status.is_some_and(|status| status["vsm"].is_string())
    };
    let named = named_store(path);
    if let Some(store) = &named {
        act_for(store, &[])?;
    }
    let Some(store) = named.filter(answers) else {
        return Err(Failure::Bad(fault));
    };
    report_line(&format!("vsm: {fault:#}"));
    report_line(RUNS_ON);
    Ok(store)
}

/// Beside the fault of a file that is wrong by now.
pub(super) const RUNS_ON: &str =
    "vsm: shown is the running bridge, which keeps the configuration that it has";

/// Prints what the program that runs on a store reports of its state.
pub(super) fn report(
    who: &str,
    store: &Path,
    json: bool,
    readable: impl Fn(&Value) -> String,
) -> Result<(), Failure> {
    let text = asked(who, store)?;
    if json {
        return print(&(text + "\n"));
    }
    print(&readable(&visible(parsed(who, &text)?)))
}

fn asked(who: &str, store: &Path) -> Result<String, Failure> {
    let _waiting = waiting(&format!("the answer of the {who}"), ANSWER_WITHIN);
    let answer = status_socket::ask(store, status_socket::STATUS, ANSWER_WITHIN);
    answer.map_err(|cause| failed(no_answer(who, store, cause)))
}

fn parsed(who: &str, text: &str) -> Result<Value, Failure> {
    serde_json::from_str(text)
        .with_context(|| format!("the running {who} answers with something else"))
        .map_err(failed)
}

/// The same with the control characters of its texts escaped: some come from stations and vehicles, and none may end a line or
/// command the terminal.
fn visible(value: Value) -> Value {
    match value {
        Value::String(text) => Value::String(escaped(&text, &[]).into_owned()),
        Value::Array(all) => all.into_iter().map(visible).collect(),
        Value::Object(all) => all
            .into_iter()
            .map(|(name, value)| (escaped(&name, &[]).into_owned(), visible(value)))
            .collect(),
        other => other,
    }
}

const ANSWER_WITHIN: Duration = Duration::from_secs(3);

/// Why nobody answers on a socket of the store, and what to do.
pub(super) fn no_answer(who: &str, store: &Path, cause: io::Error) -> anyhow::Error {
    let store = store.display();
    let text = match cause.kind() {
        io::ErrorKind::PermissionDenied => {
            format!("the store {store} is another user's: run this as that user, or as root")
        }
        io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused => {
            let start = if who == "vsm" {
                "vsm run"
            } else {
                "vsm airside"
            };
            format!("no {who} answers for the store {store}: is it running? `{start}` starts it")
        }
        _ => format!("no {who} answers for the store {store}: is it running?"),
    };
    anyhow::Error::new(cause).context(text)
}

/// `many`: a line of each vehicle; otherwise everything.
fn readable(status: &Value, many: bool) -> String {
    let mut text = format!(
        "VSM {}, up {:.0} s\n",
        plain(&status["vsm"]),
        status["uptime_s"].as_f64().unwrap_or(0.0)
    );
    if many {
        text += &vehicles::summary(status);
    }
    for warning in list(&status["warnings"]) {
        text += &format!("WARNING: {}\n", plain(warning));
    }
    text += &memory("", status);
    for finding in list(&status["findings"]) {
        let (cause, cure) = (plain(&finding["cause"]), plain(&finding["cure"]));
        text += &format!("FINDING: {cause}; {cure} [{}]\n", plain(&finding["code"]));
    }
    for station in list(&status["stations"]) {
        let address = station["address"]
            .as_str()
            .unwrap_or("no data received yet");
        let proof = match station["proof"].as_str() {
            Some("none") if station["address"].is_string() => {
                ", address not proven: sent three times what it sends at most"
            }
            _ => "",
        };
        text += &format!("CUCS {} at {address}{proof}\n", plain(&station["id"]));
        text += &web(&station["web"]);
        text += &guard(&station["guard"]);
    }
    if many {
        text += "one of the following in full, and the rights over it: vsm status --vehicle ID\n";
        text.extend(list(&status["vehicles"]).map(vehicles::line));
    } else {
        text += &rights(status);
        text.extend(list(&status["vehicles"]).map(vehicles::whole));
    }
    let names = &status["message_names"];
    text += &by_type("DLI received by type:\n", &status["received"], names);
    text += &by_type("DLI sent by type:\n", &status["sent"], names);
    let mut refused = status["refused"].clone();
    for (name, _) in status["set_aside"].as_object().into_iter().flatten() {
        refused[name] = Value::from(0);
    }
    text += &counts("DLI refused: ", &refused);
    text += &counts("DLI set aside: ", &status["set_aside"]);
    text += &counts("recordings: ", &status["recordings"]);
    text
}

/// Of bridge and agent: what is true where the memory is locked needs no line.
pub(super) fn memory(indent: &str, status: &Value) -> String {
    match status["memory_locked"] {
        Value::Bool(false) => format!("{indent}memory is not locked: {CURE}\n"),
        _ => String::new(),
    }
}

/// `vsm guard status`: what of each ground station verifies, and what was refused.
pub(super) fn show_guards(path: &Path, json: bool) -> Result<(), Failure> {
    let (store, paired) = match load(path) {
        Ok(config) => (config.store.dir.clone(), Some(pairings(&config))),
        Err(Failure::Bad(fault)) => (running_store(path, fault)?, None),
        Err(other) => return Err(other),
    };
    let shown = if json { guards_json } else { guards };
    report("vsm", &store, false, |status| {
        shown(status, paired.as_ref())
    })
}

/// The fingerprints of the guards that stations are paired with, by the ids of these. A key that was copied by hand has none.
fn pairings(config: &Config) -> BTreeMap<String, String> {
    let paired = config.stations().filter_map(|station| {
        let peer = AgreedFiles::new(&station.guard.as_ref()?.key_file).peer()?;
        Some((station.id.to_string(), peer.fingerprint().to_string()))
    });
    paired.collect()
}

/// `paired`: none where the configuration cannot be read.
fn guards_json(status: &Value, paired: Option<&BTreeMap<String, String>>) -> String {
    let of = |one: &Value| {
        let with = paired.and_then(|all| all.get(one["id"].as_str().unwrap_or_default()));
        json!({ "id": one["id"], "address": one["address"], "guard": one["guard"], "paired_with": with })
    };
    let stations: Vec<Value> = list(&status["stations"]).map(of).collect();
    let refused = refused_by_guards(&status["refused"]);
    json!({ "stations": stations, "refused": refused }).to_string() + "\n"
}

fn guards(status: &Value, paired: Option<&BTreeMap<String, String>>) -> String {
    let mut text = String::new();
    for station in list(&status["stations"]) {
        let address = station["address"].as_str();
        let address = address.unwrap_or("no data received yet");
        text += &format!("CUCS {} at {address}\n", plain(&station["id"]));
        let one = &station["guard"];
        text += &match one["verified"].as_u64() {
            Some(count) => {
                let id = station["id"].as_str().unwrap_or_default();
                let with = match paired.map(|all| all.get(id)) {
                    Some(Some(print)) => {
                        format!("  paired with the guard of fingerprint {print}\n")
                    }
                    Some(None) => "  not paired: its key was copied by hand\n".to_owned(),
                    None => String::new(),
                };
                guard(one) + &format!("{with}  verified datagrams: {count}\n")
            }
            None => "  NO GUARD: it is whoever writes its id\n".to_owned(),
        };
    }
    text + &counts("refused of all: ", &refused_by_guards(&status["refused"]))
}

/// Refusals whose sender is not known too: without a trailer, or of nobody who has a key.
fn refused_by_guards(refused: &Value) -> Value {
    let refused = refused.as_object().into_iter().flatten();
    let by_guards =
        refused.filter(|(name, _)| ["guard: ", "web: "].iter().any(|of| name.starts_with(of)));
    by_guards
        .map(|(name, count)| (name.clone(), count.clone()))
        .collect()
}

/// The access list, and who may hold and holds what of which vehicle, as a table.
fn rights(status: &Value) -> String {
    let levels = |bits: &Value| {
        let bits = bits.as_u64().and_then(|bits| u8::try_from(bits).ok());
        LoiBitmap::from_raw(bits.unwrap_or(0)).in_words()
    };
    let access = &status["access"];
    let mut text = match access["version"].as_u64() {
        None => String::new(),
        Some(version) => {
            let (key, time) = (plain(&access["key_id"]), access["time"].as_str());
            let time = time.unwrap_or("NOT KNOWN: entries that have an end are ended");
            format!("access list version {version}, signed by key {key}, its time {time}\n")
        }
    };
    if let Some(why) = access["refused"].as_str() {
        text += &format!("  THE FILE IS NOT IN FORCE: {why}\n");
    }
    let mut rows = list(&status["rights"]).peekable();
    if rows.peek().is_some() {
        text += &format!(
            "rights:\n  CUCS         vehicle      {:44}  holds LOI\n",
            "may hold LOI"
        );
    }
    for row in rows {
        let (cucs, vehicle) = (plain(&row["cucs"]), plain(&row["vehicle"]));
        let (may, holds) = (levels(&row["may_hold"]), levels(&row["holds"]));
        text += &format!("  {cucs}  {vehicle}  {may:44}  {holds}\n");
        for entry in list(&row["entries"]) {
            let (group, until) = (plain(&entry["group"]), entry["until"].as_str());
            let (until, key) = (until.unwrap_or("never"), plain(&entry["key_id"]));
            let state = plain(&entry["state"]);
            text += &format!("    {group:9}  until {until:20}  key {key}  {state}\n");
        }
    }
    text
}

/// The line of a web client; none of any other station.
fn web(web: &Value) -> String {
    match (web["connected"].as_bool(), web["connected_s"].as_f64()) {
        (Some(true), Some(since_s)) => format!("  a web client, connected for {since_s:.0} s\n"),
        (Some(_), _) => "  a web client, not connected\n".to_owned(),
        (None, _) => String::new(),
    }
}

/// The lines of a station's guard; none where it has none.
fn guard(guard: &Value) -> String {
    if guard.is_null() {
        return String::new();
    }
    let key = guard["key_id"].as_str().unwrap_or("none");
    let last = match guard["verified_s"].as_f64() {
        Some(age) => format!("last verified datagram {age:.1} s ago"),
        None => "nothing has verified yet".to_owned(),
    };
    let previous = match guard["previous_key_id"].as_str() {
        Some(id) if guard["uses_previous"] == true => format!(", STILL SENDS under key {id}"),
        Some(id) => format!(", key {id} is accepted too"),
        None => String::new(),
    };
    let refused = counts("  refused in its name: ", &guard["refused"]);
    format!("  guarded with key {key}, {last}{previous}\n{refused}")
}

/// A line a Message Type, with its name.
fn by_type(title: &str, counts: &Value, names: &Value) -> String {
    let counts = counts.as_object().into_iter().flatten();
    let lines = counts.map(|(id, count)| {
        let name = names[id.as_str()].as_str().unwrap_or("unknown");
        format!("  {id} {name}: {count}\n")
    });
    let lines: String = lines.collect();
    if lines.is_empty() {
        lines
    } else {
        format!("{title}{lines}")
    }
}
