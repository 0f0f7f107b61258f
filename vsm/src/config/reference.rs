//! Every key of `vsm.toml`, for people: the source of `docs/reference/configuration.md`, held to the parser by the tests below.

/// One key.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Its name with its table, as `vehicle.limits.leg_m`.
    pub name: &'static str,
    /// What stands where it is left out.
    pub default: WhenAbsent,
    /// What it means, and what it may be.
    pub meaning: &'static str,
}

/// What stands where a key is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenAbsent {
    /// It must be there.
    Required,
    /// This value, as it would stand in the file.
    Value(&'static str),
    /// Nothing: what it is for is not done, or is done as this says.
    Nothing(&'static str),
}

use WhenAbsent::{Nothing, Required, Value};

/// Every key, in the order of the file.
pub static KEYS: &[Key] = &[
    Key {
        name: "dli.vsm_id",
        default: Required,
        meaning: "identification number of the VSM: four bytes in hex, the owning nation first; not `ff:..`",
    },
    Key {
        name: "dli.listen",
        default: Required,
        meaning: "UDP address for CUCSs; answers go to the address that a CUCS sends from",
    },
    Key {
        name: "dli.multicast",
        default: Nothing("none"),
        meaning: "group and port that status also goes to, and that is listened to",
    },
    Key {
        name: "dli.interface",
        default: Nothing("the system's"),
        meaning: "local address of the interface of the group",
    },
    Key {
        name: "dli.provisional",
        default: Value("\"status\""),
        meaning: "use of layouts derived from Edition 2: `\"off\"`, `\"status\"` (answers and reports), `\"all\"` (commands too)",
    },
    Key {
        name: "dli.disputed.NAME",
        default: Nothing("this project's"),
        meaning: "how peers read what the sources leave open: names and choices in [dli/disputed.md](dli/disputed.md), listed by `vsm check-config`",
    },
    Key {
        name: "cucs.id",
        default: Required,
        meaning: "a `[[cucs]]`: a ground station that may connect; none listed, none may",
    },
    Key {
        name: "cucs.loi",
        default: Required,
        meaning: "levels of interoperability that it may hold, from 2, 3, 4, 5",
    },
    Key {
        name: "cucs.address",
        default: Nothing("any"),
        meaning: "where it must send from",
    },
    Key {
        name: "cucs.override",
        default: Value("false"),
        meaning: "whether it may take control from another",
    },
    Key {
        name: "cucs.rank",
        default: Value("0"),
        meaning: "0 to 255: an override takes control from holders of this rank and below",
    },
    Key {
        name: "vehicle.id",
        default: Required,
        meaning: "identification number of the vehicle",
    },
    Key {
        name: "vehicle.link",
        default: Required,
        meaning: "`udpin:ADDRESS:PORT` bind and wait, `udpout:HOST:PORT`, `serial:DEVICE:BAUD`",
    },
    Key {
        name: "vehicle.system_id",
        default: Required,
        meaning: "its MAVLink system id, 1 to 255",
    },
    Key {
        name: "vehicle.tail_number",
        default: Value("\"\""),
        meaning: "at most 15 characters, for message 3",
    },
    Key {
        name: "vehicle.signing",
        default: Required,
        meaning: "`{ key_file = \"FILE\" }`, or `\"off\"`, which is said aloud",
    },
    Key {
        name: "vehicle.signing.exchange",
        default: Value("\"off\""),
        meaning: "keys agreed over the air (KEY_EXCHANGE 229): `\"off\"`, `\"on\"` with an air-side agent that has been paired by `vsm pair`, or `\"legacy\"`, the bare public keys of old, which anyone in the middle can replace: warned of in the log and in 16000",
    },
    Key {
        name: "vehicle.signing.agent",
        default: Value("191"),
        meaning: "component id of the air-side agent, 2 to 255; its system id is the vehicle's",
    },
    Key {
        name: "vehicle.signing.rotate_days",
        default: Value("30.0"),
        meaning: "age at which a key in use is replaced by a new one, 0.0001 to 3650 days; it stays in use until the new one is",
    },
    Key {
        name: "vehicle.link_id",
        default: Value("0"),
        meaning: "MAVLink signing link id of the VSM on this link",
    },
    Key {
        name: "vehicle.vehicle_link_id",
        default: Nothing("learned, and kept in the store"),
        meaning: "MAVLink signing link id, 0 to 255, that the vehicle's autopilot uses on this link (PX4: the number of its MAVLink instance); given here, no other is ever taken",
    },
    Key {
        name: "vehicle.agl",
        default: Value("\"home\""),
        meaning: "how altitude type 2 (AGL) is flown: as height above home, or `\"refuse\"`",
    },
    Key {
        name: "vehicle.curve.tolerance_m",
        default: Value("1.0"),
        meaning: "largest planned deviation from a curve, 0.1 to 100 m",
    },
    Key {
        name: "vehicle.curve.max_items",
        default: Value("500"),
        meaning: "most mission items of a route, 2 to 10000; where its curves need more, they are flown within the smallest tolerance that these allow, said by 16000",
    },
    Key {
        name: "vehicle.curve.policy",
        default: Value("\"slow\""),
        meaning: "where a curve is too tight for the speed: `\"slow\"` or `\"refuse\"`",
    },
    Key {
        name: "vehicle.curve.vertices",
        default: Value("\"on\""),
        meaning: "vertices of the straight legs `\"on\"` the curve, or `\"free\"`: off it by up to the tolerance, about a quarter fewer items, proven all the same",
    },
    Key {
        name: "vehicle.stall_s",
        default: Value("30.0"),
        meaning: "longest time, s, that a mission may get no nearer to its waypoint before the vehicle is told to hold, 10 to 3600; `0` for no watch ([px4.md](../guide/px4.md))",
    },
    Key {
        name: "vehicle.limits.first_m",
        default: Value("5000.0"),
        meaning: "farthest first waypoint from home, m",
    },
    Key {
        name: "vehicle.limits.leg_m",
        default: Value("50000.0"),
        meaning: "longest leg, m",
    },
    Key {
        name: "vehicle.limits.lowest_m",
        default: Value("-500.0"),
        meaning: "lowest waypoint, m above home",
    },
    Key {
        name: "vehicle.limits.highest_m",
        default: Value("5000.0"),
        meaning: "highest waypoint, m above home",
    },
    Key {
        name: "vehicle.limits.speed_m_s",
        default: Value("100.0"),
        meaning: "fastest commanded speed, m/s; the vehicle's own (MPC_XY_VEL_MAX, FW_AIRSPD_MAX) counts where it is lower",
    },
    Key {
        name: "vehicle.area.keep",
        default: Required,
        meaning: "a `[[vehicle.area]]` of the geofence, always aboard: `\"in\"` the vehicle stays inside, `\"out\"` outside",
    },
    Key {
        name: "vehicle.area.vertices",
        default: Nothing("none"),
        meaning: "corners of a polygon in turn, degrees north and east, 3 to 64; or a circle:",
    },
    Key {
        name: "vehicle.area.centre",
        default: Nothing("none"),
        meaning: "centre of a circle: degrees north and east",
    },
    Key {
        name: "vehicle.area.radius_m",
        default: Nothing("none"),
        meaning: "radius of the circle, above 0 to 100000 m",
    },
    Key {
        name: "store.dir",
        default: Required,
        meaning: "folder of signing clocks, plans and authority; made with mode 0700, refused when open to others",
    },
    Key {
        name: "http.listen",
        default: Nothing("none"),
        meaning: "TCP address of the status page",
    },
    Key {
        name: "authority.warn_s",
        default: Value("3.0"),
        meaning: "silence of the controlling CUCS before operators are warned, s; counts once it has sent heartbeats (16002)",
    },
    Key {
        name: "authority.offer_s",
        default: Value("5.0"),
        meaning: "silence before another may take control, s",
    },
    Key {
        name: "authority.act_s",
        default: Value("10.0"),
        meaning: "silence before control is taken away and `on_loss` is done, s",
    },
    Key {
        name: "authority.on_loss",
        default: Value("\"continue\""),
        meaning: "`\"continue\"`, `\"hold\"`, `\"contingency\"`, `\"rtl\"`",
    },
    Key {
        name: "mavlink.system_id",
        default: Value("245"),
        meaning: "MAVLink system id of the VSM",
    },
    Key {
        name: "mavlink.component_id",
        default: Value("190"),
        meaning: "its component id",
    },
    Key {
        name: "record.dir",
        default: Nothing("none"),
        meaning: "folder of MAVLink recordings (.tlog, keys blanked, signatures stripped)",
    },
];

/// `docs/reference/configuration.md`.
#[must_use]
pub fn markdown() -> String {
    let mut page = String::from(HEAD);
    for key in KEYS {
        let default = match key.default {
            Required => String::new(),
            Value("\"\"") => "empty".to_owned(),
            Value(value) => format!("`{value}`"),
            Nothing(otherwise) => otherwise.to_owned(),
        };
        page += &format!("| `{}` | {default} | {} |\n", key.name, key.meaning);
    }
    page + FOOT
}

const HEAD: &str = "# Configuration

Generated by `cargo xtask gen` from the table beside the parser (`vsm/src/config/reference.rs`); changes here are lost.

One TOML file. Relative paths are relative to it. Unknown keys are refused; `vsm check-config FILE` says what is wrong
with line, key and expectation, or what each value means. Keys without a default must be there.

| key | default | meaning, range |
|---|---|---|
";

const FOOT: &str = "
Examples that a test reads: [one vehicle](../../examples/vsm.toml), [a radio](../../examples/radio.toml),
[two vehicles](../../examples/two-vehicles.toml), [keys agreed over the air](../../examples/agreed-keys.toml).
";

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::config::Config;

    /// Every table of the file, each with what must be there.
    const WHOLE: &str = "
[dli]
vsm_id = \"1b:00:00:01\"
listen = \"127.0.0.1:4586\"
#dli
[[cucs]]
id = \"1b:00:00:a0\"
loi = [2]
#cucs
[[vehicle]]
id = \"1b:00:01:01\"
link = \"udpin:127.0.0.1:14550\"
system_id = 1
signing = { key_file = \"k\"#signing }
#vehicle
[vehicle.curve]
#vehicle.curve
[vehicle.limits]
#vehicle.limits
[[vehicle.area]]
keep = \"out\"
centre = [47.0, 8.0]
radius_m = 10.0
#vehicle.area
[store]
dir = \"state\"
#store
[http]
listen = \"127.0.0.1:0\"
#http
[authority]
#authority
[mavlink]
#mavlink
[record]
dir = \"record\"
#record
";

    /// The file with a line more in a table.
    fn with(table: &str, line: &str) -> String {
        match table {
            "vehicle.signing" => WHOLE.replace("#signing", &format!(", {line}")),
            table => WHOLE.replace(&format!("#{table}\n"), &format!("{line}\n")),
        }
        .replace("#signing", "")
    }

    fn parsed(text: &str) -> Result<String, String> {
        Config::parse(text, Path::new("/"))
            .map(|config| format!("{config:?}"))
            .map_err(|fault| fault.to_string())
    }

    fn split(name: &str) -> (&str, &str) {
        name.rsplit_once('.').expect("a key in a table")
    }

    #[test]
    fn the_parser_knows_these_keys_and_no_others() {
        let tables: BTreeSet<&str> = KEYS.iter().map(|key| split(key.name).0).collect();
        for table in tables {
            if table == "dli.disputed" {
                continue;
            }
            let fault = parsed(&with(table, "no_such_key = 1")).expect_err(table);
            let listed: BTreeSet<String> = fault
                .split_once("expected")
                .map_or("", |(_, list)| list)
                .split('`')
                .skip(1)
                .step_by(2)
                .map(str::to_owned)
                .collect();
            assert!(!listed.is_empty(), "{table}: {fault}");
            let here = KEYS
                .iter()
                .map(|key| split(key.name))
                .filter(|(of, _)| *of == table);
            let mut known: BTreeSet<String> = here.map(|(_, key)| key.to_owned()).collect();
            // Tables within it are listed by their own keys.
            for key in KEYS {
                let inner = key
                    .name
                    .strip_prefix(table)
                    .and_then(|rest| rest.strip_prefix('.'));
                if let Some((inner, _)) = inner.and_then(|rest| rest.split_once('.')) {
                    known.insert(inner.to_owned());
                }
            }
            if table == "vehicle.signing" {
                known.insert("key_file".to_owned());
            }
            assert_eq!(listed, known, "{table}");
        }
    }

    #[test]
    fn a_default_is_what_the_parser_takes_where_a_key_is_left_out() {
        // Places in the file differ; what is read must not.
        let read = |text: &str| {
            let told = parsed(text).unwrap_or_else(|fault| panic!("{fault}\n{text}"));
            let mut out = String::new();
            let mut rest = told.as_str();
            while let Some((before, after)) = rest.split_once("span: ") {
                out += before;
                rest = after
                    .split_once(|c: char| !c.is_ascii_digit() && c != '.')
                    .map_or("", |(_, r)| r);
            }
            out + rest
        };
        let plain = read(&WHOLE.replace("#signing", ""));
        let mut checked = 0;
        for key in KEYS {
            let Value(value) = key.default else { continue };
            let (table, name) = split(key.name);
            assert_eq!(
                read(&with(table, &format!("{name} = {value}"))),
                plain,
                "{}",
                key.name
            );
            checked += 1;
        }
        assert!(checked > 15);
    }
}
