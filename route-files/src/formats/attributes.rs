//! What is done at a point, as pairs of a key and a text: how the formats that have no words of their own for speeds,
//! loiters, turns and loops carry them. A column of CSV, an extension of GPX, a property of GeoJSON, an entry of
//! KML's ExtendedData have the same keys and the words of a route file.

use stanag_msgs::enums::{LimitType, LoiterDirection};

use super::draft::{Conduct, LoiterExit, Repeat, TakeOff};
use crate::route::form::{DIRECTIONS, LIMITS, LOITERS, Names, SPEED_TYPES, TURNS};
use crate::route::model::{Loiter, LoiterSpan};

/// Every key.
pub(super) const KEYS: [&str; 15] = [
    "speed_m_s",
    "speed_type",
    "turn",
    "loiter",
    "loiter_radius_m",
    "loiter_length_m",
    "loiter_bearing_deg",
    "loiter_direction",
    "loiter_speed_m_s",
    "loiter_s",
    "loiter_turns",
    "loop_to",
    "loop_limit",
    "take_off",
    "loiter_exit",
];

/// The pairs of a point.
pub(super) fn of(conduct: &Conduct) -> Vec<(&'static str, String)> {
    let mut out = Vec::new();
    let mut put = |key, text: Option<String>| out.extend(text.map(|text| (key, text)));
    let number = |x: Option<f64>| x.map(|x| x.to_string());
    let word = |word: Option<&'static str>| word.map(str::to_owned);
    put("speed_m_s", number(conduct.speed_m_s));
    put(
        "speed_type",
        word(conduct.speed_type.and_then(|t| SPEED_TYPES.word(t))),
    );
    put("turn", word(conduct.turn.and_then(|t| TURNS.word(t))));
    if let Some(loiter) = &conduct.loiter {
        let pattern = loiter.pattern.and_then(|p| LOITERS.word(p));
        put("loiter", word(pattern.or(Some(ANY))));
        put("loiter_radius_m", number(loiter.radius_m));
        put("loiter_length_m", number(loiter.length_m));
        put("loiter_bearing_deg", number(loiter.bearing_deg));
        let direction = loiter.direction.and_then(|d| DIRECTIONS.word(d));
        put("loiter_direction", word(direction));
        put("loiter_speed_m_s", number(loiter.speed_m_s));
        match loiter.span {
            Some(LoiterSpan::Seconds(s)) => put("loiter_s", Some(s.to_string())),
            Some(LoiterSpan::Turns(n)) => put("loiter_turns", Some(n.to_string())),
            None => {}
        }
    }
    if let Some(repeat) = conduct.repeat {
        put("loop_to", Some((repeat.to + 1).to_string()));
        let kind = LIMITS.word(repeat.limit_type).unwrap_or("none");
        put("loop_limit", Some(format!("{} {kind}", repeat.limit)));
    }
    put(
        "take_off",
        conduct.take_off.map(|kind| {
            let plain = kind == TakeOff::Plain;
            if plain { "plain" } else { "vtol" }.to_owned()
        }),
    );
    let exit = conduct.exit;
    put(
        "loiter_exit",
        exit.map(|exit| format!("{} {}", exit.heading, exit.tangent)),
    );
    out
}

/// Reads one pair; `false` where the key is none of these.
pub(super) fn set(conduct: &mut Conduct, key: &str, text: &str) -> Result<bool, String> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(KEYS.contains(&key));
    }
    match key {
        "speed_m_s" => conduct.speed_m_s = Some(number(text)?),
        "speed_type" => conduct.speed_type = Some(named(text, &SPEED_TYPES)?),
        "turn" => conduct.turn = Some(named(text, &TURNS)?),
        "loiter" if text == ANY => {
            loiter(conduct);
        }
        "loiter" => loiter(conduct).pattern = Some(named(text, &LOITERS)?),
        "loiter_radius_m" => loiter(conduct).radius_m = Some(number(text)?),
        "loiter_length_m" => loiter(conduct).length_m = Some(number(text)?),
        "loiter_bearing_deg" => loiter(conduct).bearing_deg = Some(number(text)?),
        "loiter_direction" => loiter(conduct).direction = Some(direction(text)?),
        "loiter_speed_m_s" => loiter(conduct).speed_m_s = Some(number(text)?),
        "loiter_s" => loiter(conduct).span = Some(LoiterSpan::Seconds(count(text)?)),
        "loiter_turns" => loiter(conduct).span = Some(LoiterSpan::Turns(count(text)?)),
        "loop_to" => {
            let to = usize::from(count(text)?).checked_sub(1);
            let to = to.ok_or("0, expected the number of a point, from 1")?;
            let limit = conduct
                .repeat
                .map_or((LimitType::None, 0), |r| (r.limit_type, r.limit));
            conduct.repeat = Some(Repeat {
                to,
                limit_type: limit.0,
                limit: limit.1,
            });
        }
        "loop_limit" => {
            let (limit, kind) = text.split_once(' ').unwrap_or((text, "count"));
            conduct.repeat = Some(Repeat {
                to: conduct.repeat.map_or(0, |r| r.to),
                limit_type: named(kind.trim(), &LIMITS)?,
                limit: count(limit)?,
            });
        }
        "take_off" => {
            conduct.take_off = Some(match text {
                "plain" => TakeOff::Plain,
                "vtol" => TakeOff::Vtol,
                _ => return Err(format!("{text:?}, expected plain or vtol")),
            });
        }
        "loiter_exit" => {
            let pair = text.split_once(' ');
            let (heading, tangent) =
                pair.ok_or_else(|| format!("{text:?}, expected two numbers such as 1 1"))?;
            conduct.exit = LoiterExit::of(number(heading)?, number(tangent.trim())?);
        }
        _ => return Ok(false),
    }
    Ok(true)
}

fn loiter(conduct: &mut Conduct) -> &mut Loiter {
    conduct.loiter.get_or_insert_with(Loiter::default)
}

fn direction(text: &str) -> Result<LoiterDirection, String> {
    named(text, &DIRECTIONS)
}

fn named<T: Copy + PartialEq>(text: &str, names: &Names<T>) -> Result<T, String> {
    let value = names.value(text);
    value.ok_or_else(|| format!("{text:?}, expected one of {}", names.expected()))
}

/// A finite number. A table turns its decimal commas into points before: elsewhere a comma may as well divide thousands.
pub(super) fn number(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| format!("{text:?}, expected a number"))
}

fn count(text: &str) -> Result<u16, String> {
    text.parse()
        .map_err(|_| format!("{text:?}, expected a whole number of 0 to 65535"))
}

/// A loiter whose pattern is not stated.
const ANY: &str = "any";
