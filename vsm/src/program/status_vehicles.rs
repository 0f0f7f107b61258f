//! Which vehicles `vsm status` shows, what of each, and how many of them are in which state.

use std::collections::BTreeSet;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use crate::session::VehiclePattern;

/// Leaves only the vehicles of a pattern, and the rights over them.
///
/// # Errors
/// There is none.
pub(super) fn narrow(status: &mut Value, to: &VehiclePattern) -> anyhow::Result<()> {
    let ids = |status: &Value| -> Vec<String> {
        let all = list(&status["vehicles"]);
        all.map(|one| plain(&one["id"]).to_owned()).collect()
    };
    let all = ids(status);
    if let Some(vehicles) = status["vehicles"].as_array_mut() {
        vehicles.retain(|one| to.matches(plain(&one["id"]), plain(&one["tail_number"])));
    }
    let kept: BTreeSet<String> = ids(status).into_iter().collect();
    if kept.is_empty() {
        let there_are = match &all[..] {
            [] => "there is none".to_owned(),
            [one] => format!("there is {one}"),
            [first, .., last] => format!("there are {}, {first} to {last}", all.len()),
        };
        anyhow::bail!(
            "no vehicle has {:?} in its id or tail number: {there_are}",
            to.text()
        );
    }
    if let Some(rights) = status["rights"].as_array_mut() {
        rights.retain(|row| row["vehicle"].as_str().is_some_and(|id| kept.contains(id)));
    }
    Ok(())
}

/// Whether there are so many that each has one line, unless they were chosen.
pub(super) fn are_many(status: &Value) -> bool {
    list(&status["vehicles"]).count() >= MANY
}

/// How many vehicles are in which state: the groups of the page (`shell/web/page/list.js`). One may be in several.
pub(super) fn summary(status: &Value) -> String {
    let vehicles: Vec<&Value> = list(&status["vehicles"]).collect();
    let count = |of: fn(&Value) -> bool| vehicles.iter().filter(|one| of(one)).count();
    format!(
        "vehicles: {}; {} live, {} silent{}, {} in the air, {} not signed\n",
        vehicles.len(),
        count(is_live),
        count(|one| !is_live(one)),
        match count(was_never_received) {
            0 => String::new(),
            never => format!(" ({never} not received yet)"),
        },
        // Of a vehicle without data it is not known.
        count(|one| is_live(one) && one["on_ground"] == false),
        count(is_unsigned)
    )
}

fn is_live(vehicle: &Value) -> bool {
    vehicle["live"] == true
}

/// Whether nothing of it was accepted since the bridge was started.
fn was_never_received(vehicle: &Value) -> bool {
    !is_live(vehicle) && vehicle["mode"].is_null() && vehicle["link"]["accepted_s"].is_null()
}

/// What arrives counts, never the setting.
fn is_unsigned(vehicle: &Value) -> bool {
    let link = &vehicle["link"];
    let arrives = link["arrives"].as_str();
    link["signed"] != true || arrives.is_some_and(|what| what != "verified")
}

/// A vehicle in one line.
pub(super) fn line(vehicle: &Value) -> String {
    let unsigned = if is_unsigned(vehicle) {
        ", NOT SIGNED"
    } else {
        ""
    };
    format!("{}{unsigned}\n", heading(vehicle))
}

fn heading(vehicle: &Value) -> String {
    let link = &vehicle["link"];
    let state = match (is_live(vehicle), vehicle["mode"].as_str()) {
        (true, mode) => format!("live, mode {}", mode.unwrap_or("unknown")),
        // Of a silent vehicle the mode is the last that it reported.
        (false, Some(mode)) => format!("SILENT, last mode {mode}"),
        (false, None) if !link["accepted_s"].is_null() => "SILENT, no mode received yet".to_owned(),
        (false, None) if !link["arrives"].is_null() => {
            "SILENT, no frame of it accepted yet".to_owned()
        }
        (false, None) => "SILENT, no data received yet".to_owned(),
    };
    format!(
        "vehicle {} {state}, controlled by {}",
        plain(&vehicle["id"]),
        vehicle["controller"].as_str().unwrap_or("nobody")
    )
}

/// Everything of a vehicle.
pub(super) fn whole(vehicle: &Value) -> String {
    let mut text = heading(vehicle) + "\n";
    match vehicle["operator_control"].as_u64() {
        None => {}
        Some(0) => text += "  operator control of MAVLink: nobody\n",
        Some(system) => text += &format!("  operator control of MAVLink: system {system}\n"),
    }
    for holder in list(&vehicle["holders"]) {
        text += &holding(holder);
    }
    for handover in list(&vehicle["handovers"]) {
        text += &format!(
            "  pending: {} from {} to {}, waits for the {}\n",
            plain(&handover["rights"]),
            handover["from"].as_str().unwrap_or("nobody"),
            plain(&handover["to"]),
            plain(&handover["waits_for"])
        );
    }
    if vehicle["altitude_band"]["outside"] == true {
        let limit = |key| vehicle["altitude_band"][key].as_f64().unwrap_or(f64::NAN);
        let (lowest_m, highest_m) = (limit("lowest_m"), limit("highest_m"));
        let when = if is_live(vehicle) {
            ""
        } else {
            " when last received"
        };
        text += &format!(
            "  OUTSIDE ITS ALTITUDE BAND of {lowest_m:.0} to {highest_m:.0} m above home{when}\n"
        );
    }
    if let Some(count) = vehicle["rally_points"]["count"].as_u64() {
        let aboard = match vehicle["rally_points"]["aboard"] == true {
            true => "aboard",
            false => "NOT ABOARD",
        };
        text += &format!("  rally points: {count}, {aboard}\n");
    }
    let link = &vehicle["link"];
    let signed = signing(link);
    let state = state(link);
    let peer = link["peer"].as_str().unwrap_or("no data received yet");
    let address = plain(&link["address"]);
    text += &format!("  {address} {signed}, {state}, peer {peer}\n");
    if let Some(age) = link["unanswered_s"].as_f64().filter(|age| *age > 5.0) {
        text +=
            &format!("  NO VERIFIED ANSWER to a frame of ours for {age:.0} s: commands are lost\n");
    }
    text += &last_verified(link);
    text += &counts("  verified and refused: ", &link["refused_though_verified"]);
    let exchange = &link["exchange"];
    if exchange.is_object() {
        let peer = exchange["peer"].as_str().unwrap_or("none");
        let (mode, state) = (plain(&exchange["mode"]), plain(&exchange["state"]));
        text += &format!("  key exchange {mode}, paired with {peer}: {state}\n");
    }
    text += &encryption(&link["encryption"]);
    text += &counts("  refused in the vehicle's name: ", &link["refused"]);
    text += &counts("  frames: ", &link["frames"]);
    text
}

/// The state of a link, and for how long it has been live or silent.
fn state(link: &Value) -> String {
    let state = plain(&link["state"]);
    let (key, detail) = match state {
        "live" => ("live_s", ""),
        "silent" => ("accepted_s", ": no frame accepted"),
        _ => return state.to_owned(),
    };
    match link[key].as_f64() {
        Some(span_s) => format!("{state}{detail} for {span_s:.0} s"),
        None => state.to_owned(),
    }
}

/// Whether frames are signed: what was verified, not what is configured.
fn signing(link: &Value) -> String {
    let verified = link["verified_s"].as_f64();
    match (link["signed"] == true, link["key_id"].as_str()) {
        (false, _) => "NOT SIGNED: anyone in range can command it".to_owned(),
        (true, None) => "signed, which key is being found out".to_owned(),
        (true, Some(id)) if verified.is_some_and(|age| age <= VERIFIED_FOR_S) => {
            format!("signed with key {id}")
        }
        (true, Some(id)) => match link["arrives"].as_str() {
            None if verified.is_none() => format!("key {id}, no frame received yet"),
            _ => format!("key {id}, NOT VERIFIED"),
        },
    }
}

/// When a frame last verified and under which key, and what arrives now where none does.
fn last_verified(link: &Value) -> String {
    if link["signed"] != true {
        return String::new();
    }
    let key = link["verified_key_id"].as_str().unwrap_or("?");
    let verified = link["verified_s"].as_f64();
    let last = match verified {
        Some(age) => format!("last verified frame {age:.1} s ago under key {key}"),
        None => "no frame has verified yet".to_owned(),
    };
    let arrives = match (verified, link["arrives"].as_str()) {
        (Some(age), _) if age <= VERIFIED_FOR_S => String::new(),
        (_, arrives) => format!("; what arrives: {}", arrives.unwrap_or("nothing")),
    };
    format!("  {last}{arrives}\n")
}

/// A heartbeat comes each second; some are lost.
const VERIFIED_FOR_S: f64 = 3.5;

/// `  1b:00:00:a0 holds LOI 2, 4, 5 (monitor, control, launch), for 12 s`: what, and since when.
fn holding(holder: &Value) -> String {
    let levels = plain(&holder["levels"]);
    let stations = holder["stations"].as_array().map_or(&[][..], Vec::as_slice);
    let stations = match stations {
        [] => String::new(),
        all if all.len() == 32 => " of every station".to_owned(),
        some => {
            let some: Vec<String> = some.iter().map(Value::to_string).collect();
            format!(" of station {}", some.join(", "))
        }
    };
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    let since = holder["since_ms"].as_u64().map(Duration::from_millis);
    let since = since.map_or(String::new(), |since| {
        format!(", for {} s", now.saturating_sub(since).as_secs())
    });
    let id = plain(&holder["id"]);
    format!("  {id} holds LOI {levels}{stations}{since}\n")
}

/// How an encrypted link stands, where there is one.
pub(super) fn encryption(of: &Value) -> String {
    if !of.is_object() {
        return String::new();
    }
    let epoch = of["epoch"].as_u64();
    let epoch = epoch.map_or(String::new(), |epoch| format!(", epoch {epoch}"));
    let state = plain(&of["state"]);
    format!("  encrypted link: {state}{epoch}\n") + &counts("    packets: ", &of["packets"])
}

pub(super) fn counts(title: &str, counts: &Value) -> String {
    let counts = counts
        .as_object()
        .into_iter()
        .flatten()
        .filter(|(_, count)| **count != 0);
    let counts: Vec<String> = counts
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    if counts.is_empty() {
        String::new()
    } else {
        format!("{title}{}\n", counts.join(", "))
    }
}

pub(super) fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

pub(super) fn plain(value: &Value) -> &str {
    value.as_str().unwrap_or("?")
}

/// The page filters its list from so many on, too.
const MANY: usize = 12;

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn vehicle(n: u8, live: bool, on_ground: Option<bool>, arrives: Option<&str>) -> Value {
        json!({
            "id": format!("1b:00:01:{n:02x}"), "tail_number": format!("UAV-{n:02}"), "live": live, "on_ground": on_ground,
            "link": { "signed": n != 7, "arrives": arrives },
        })
    }

    fn ids(status: &Value) -> Vec<&str> {
        list(&status["vehicles"])
            .map(|one| plain(&one["id"]))
            .collect()
    }

    #[test]
    fn only_the_vehicles_of_a_pattern_and_their_rights_are_left() {
        let rights: Vec<Value> = (1..=3)
            .map(|n| json!({ "cucs": "1b:00:00:a0", "vehicle": format!("1b:00:01:{n:02x}") }))
            .collect();
        let vehicles: Vec<Value> = (1..=3).map(|n| vehicle(n, true, None, None)).collect();
        let all = json!({ "vehicles": vehicles, "rights": rights });
        let mut status = all.clone();
        narrow(&mut status, &"*-02".parse().expect("a pattern")).expect("there is one");
        assert_eq!(ids(&status), ["1b:00:01:02"]);
        let rows: Vec<&Value> = list(&status["rights"]).collect();
        assert_eq!(rows.len(), 1);
        assert_eq!(rows[0]["vehicle"], "1b:00:01:02");
        let refused = narrow(&mut all.clone(), &"uav-9".parse().expect("a pattern"));
        let refused = refused.expect_err("there is none").to_string();
        for part in ["uav-9", "there are 3, 1b:00:01:01 to 1b:00:01:03"] {
            assert!(refused.contains(part), "{refused}");
        }
    }

    #[test]
    fn the_summary_counts_states_by_what_is_known() {
        let vehicles = json!([
            vehicle(1, true, Some(true), Some("verified")),
            vehicle(2, true, Some(false), Some("verified")),
            // Was in the air when it was last received: nobody knows now.
            vehicle(3, false, Some(false), None),
            vehicle(4, true, None, Some("signed with another key")),
            // By its setting.
            vehicle(7, true, Some(true), Some("not verified")),
        ]);
        let mut status = json!({ "vehicles": vehicles });
        status["vehicles"][2]["mode"] = "AUTO.MISSION".into();
        assert_eq!(
            summary(&status),
            "vehicles: 5; 4 live, 1 silent, 1 in the air, 2 not signed\n"
        );
        status["vehicles"][2]["mode"] = Value::Null;
        assert_eq!(
            summary(&status),
            "vehicles: 5; 4 live, 1 silent (1 not received yet), 1 in the air, 2 not signed\n"
        );
        assert!(!are_many(&status));
        assert!(line(&vehicles[3]).ends_with("controlled by nobody, NOT SIGNED\n"));
        assert!(line(&vehicles[0]).ends_with("controlled by nobody\n"));
    }

    #[test]
    fn of_a_vehicle_without_a_mode_is_named_what_was_received_of_it() {
        let mut one = vehicle(1, false, None, None);
        assert!(
            line(&one).contains(" SILENT, no data received yet, controlled"),
            "{one}"
        );
        // Another key, such as before it was given this one.
        one["link"]["arrives"] = "signed with another key".into();
        assert!(
            line(&one).contains(" SILENT, no frame of it accepted yet, controlled"),
            "{one}"
        );
        one["link"]["accepted_s"] = 12.0.into();
        assert!(
            line(&one).contains(" SILENT, no mode received yet, controlled"),
            "{one}"
        );
    }

    #[test]
    fn a_silent_vehicle_is_described_by_its_silence_also_without_signing() {
        let mut one = vehicle(7, true, Some(false), Some("not verified"));
        one["mode"] = "AUTO.MISSION".into();
        one["altitude_band"] = json!({ "outside": true, "lowest_m": 2.0, "highest_m": 120.0 });
        one["link"]["state"] = "live".into();
        one["link"]["live_s"] = 60.0.into();
        let live = whole(&one);
        for part in [
            " live, mode AUTO.MISSION",
            ", live for 60 s, peer",
            "120 m above home\n",
        ] {
            assert!(live.contains(part), "{part}: {live}");
        }
        one["live"] = false.into();
        let link = &mut one["link"];
        (link["state"], link["live_s"]) = ("silent".into(), Value::Null);
        link["accepted_s"] = 12.0.into();
        let silent = whole(&one);
        for part in [
            " SILENT, last mode AUTO.MISSION",
            ", silent: no frame accepted for 12 s, peer",
            "above home when last received\n",
        ] {
            assert!(silent.contains(part), "{part}: {silent}");
        }
        assert!(!silent.contains("live"), "{silent}");
    }
}
