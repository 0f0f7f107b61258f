//! A configuration is refused with the line, the key, what was found and what was expected; the examples are good.

use std::path::Path;

use vsm::config::airside::AirsideConfig;
use vsm::config::{Config, Exchange, Signing};

const GOOD: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:4586"
multicast = "225.200.1.0:51017"
interface = "127.0.0.1"
provisional = "status"
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
address = "127.0.0.1"
override = false
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:14550"
system_id = 1
tail_number = "PX4-01"
signing = { key_file = "uav1.key" }
curve = { tolerance_m = 1.0, max_items = 500, policy = "slow" }
[store]
dir = "state"
[http]
listen = "127.0.0.1:8586"
"#;

fn refusal(text: &str) -> String {
    Config::parse(text, Path::new(""))
        .expect_err("should be refused")
        .to_string()
}

#[test]
fn every_key_of_the_contract_is_read() {
    let config = Config::parse(GOOD, Path::new("/etc/vsm")).expect("good");
    assert_eq!(config.store.dir, Path::new("/etc/vsm/state"));
    let vehicle = config.vehicles().next().expect("one");
    assert_eq!(
        vehicle.signing,
        Signing::KeyFile("/etc/vsm/uav1.key".into(), Exchange::default())
    );
    assert_eq!(config.stations().count(), 1);
}

#[test]
fn a_station_whose_silence_costs_it_nothing_is_warned_of() {
    let warns = |key: &str| {
        let text = GOOD.replace("override = false", &format!("override = false\n{key}"));
        let config = Config::parse(&text, Path::new("")).expect("good");
        let warnings = config.warnings();
        warnings
            .iter()
            .any(|one| one.contains("1b:00:00:a0: Edition 2.5 has no heartbeat"))
    };
    assert!(warns("edition = \"2.5\""));
    assert!(!warns("edition = \"3\"") && !warns(""));
}

#[test]
fn an_etcd_on_another_computer_is_warned_of() {
    let warns = |endpoints: &str| {
        let store = format!(
            "dir = \"state\"\nkind = \"etcd\"\nendpoints = [{endpoints}]\nnode = \"alpha\"\nkey_file = \"fleet.key\""
        );
        let text = GOOD.replace("dir = \"state\"", &store);
        let config = Config::parse(&text, Path::new("")).expect("good");
        let warnings = config.warnings();
        warnings
            .iter()
            .any(|one| one.contains("neither encrypted nor authenticated"))
    };
    let here = "\"http://127.0.0.1:2379\", \"http://[::1]:2379\", \"http://localhost:2379\"";
    assert!(!warns(here));
    assert!(warns(&format!("{here}, \"http://10.0.0.1:2379\"")));
}

#[test]
fn a_country_may_be_named_in_place_of_its_code() {
    let text = GOOD.replace("id = \"1b:00:00:a0\"", "id = \"deu:00:00:a0\"");
    let config = Config::parse(&text, Path::new("")).expect("good");
    let station = config.stations().next().expect("one");
    assert_eq!(station.id, stanag_msgs::Id(0x0900_00a0));
    assert_eq!(vsm::config::owner_name(station.id), Some("DEU"));
    let fault = refusal(&GOOD.replace("id = \"1b:00:00:a0\"", "id = \"XYZ:00:00:a0\""));
    for part in ["line 9", "XYZ:00:00:a0", "DEU:00:00:01"] {
        assert!(fault.contains(part), "{fault}");
    }
}

#[test]
fn keys_of_groups_and_profiles_are_refused_with_what_they_may_be() {
    let station = "override = false";
    let dli = "interface = \"127.0.0.1\"";
    for (replaced, by, parts) in [
        (dli, "ttl = 300", &["ttl", "300", "0 to 255"][..]),
        (dli, "interface = \"no such one\"", &["interface", "eth0"]),
        (
            dli,
            "sources = [\"fd00::1\"]",
            &["sources", "addresses of IPv4"],
        ),
        (station, "edition = \"5\"", &["edition", "\"2.5\"", "\"4\""]),
        (station, "checksum = \"md5\"", &["checksum", "crc32"]),
        (
            station,
            "edition = \"3\"\nchecksum = \"crc32\"",
            &["checksum", "Edition 3 has no CRC-32"],
        ),
        (station, "presence = \"none\"", &["presence", "partial"]),
        (station, "delivery = \"multicast\"", &["delivery", "group"]),
        (station, "delivry = \"group\"", &["delivry", "delivery"]),
        (
            station,
            "disputed = { ack_typ = \"0,1,2\" }",
            &["ack_typ", "no such entry"],
        ),
        (
            "multicast = \"225.200.1.0:51017\"",
            "multicast = \"10.0.0.1:51017\"",
            &["multicast", "[ff15::4586]:51017"],
        ),
    ] {
        let fault = refusal(&GOOD.replace(replaced, by));
        assert!(fault.contains("line "), "{by}: {fault}");
        for part in parts {
            assert!(fault.contains(part), "{by}: {part}: {fault}");
        }
    }
    let without = GOOD.replace("multicast = \"225.200.1.0:51017\"\n", "");
    let fault = refusal(&without.replace(station, "delivery = \"group\""));
    assert!(fault.contains("group without dli.multicast"), "{fault}");
}

#[test]
fn interface_without_multicast_is_legal() {
    let text = GOOD.replace("multicast = \"225.200.1.0:51017\"\n", "");
    assert!(Config::parse(&text, Path::new("")).is_ok());
}

#[test]
fn nobody_listed_is_legal() {
    let text =
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:4586\"\n[store]\ndir = \"s\"\n";
    assert!(Config::parse(text, Path::new("")).is_ok());
}

#[test]
fn what_is_wrong_is_reported_with_its_place() {
    // (what is replaced, by what, what the message must hold)
    let table: &[(&str, &str, &[&str])] = &[
        (
            "listen = \"127.0.0.1:4586\"",
            "lisen = \"127.0.0.1:4586\"",
            &["line 4", "lisen", "listen"],
        ),
        ("listen = \"127.0.0.1:4586\"", "", &["listen", "missing"]),
        (
            "vsm_id = \"1b:00:00:01\"",
            "vsm_id = \"1b:00:00\"",
            &["line 3", "vsm_id", "four bytes"],
        ),
        (
            "vsm_id = \"1b:00:00:01\"",
            "vsm_id = \"ff:ff:ff:ff\"",
            &["line 3", "ff is reserved"],
        ),
        (
            "225.200.1.0:51017",
            "10.0.0.1:51017",
            &["line 5", "multicast"],
        ),
        (
            "provisional = \"status\"",
            "provisional = \"maybe\"",
            &["line 7", "maybe", "all"],
        ),
        ("loi = [2, 3, 4, 5]", "loi = [1]", &["line 10", "2 to 5"]),
        (
            "id = \"1b:00:00:a0\"",
            "id = \"1b:00:00:01\"",
            &["line 9", "cucs.id", "nothing else"],
        ),
        (
            "id = \"1b:00:01:01\"",
            "id = \"1b:00:00:a0\"",
            &["line 14", "vehicle.id", "nothing else"],
        ),
        (
            "udpin:127.0.0.1:14550",
            "tcp:127.0.0.1:14550",
            &["line 15", "udpin:ADDRESS:PORT"],
        ),
        (
            "udpin:127.0.0.1:14550",
            "udpin:localhost",
            &["line 15", "udpin:ADDRESS:PORT"],
        ),
        (
            "system_id = 1",
            "system_id = 0",
            &["vehicle.system_id", "1 to 255"],
        ),
        (
            "system_id = 1",
            "system_id = 245",
            &["vehicle.system_id", "not the VSM's own"],
        ),
        ("system_id = 1", "system_id = 256", &["line 16", "256"]),
        (
            "system_id = 1",
            "system_id = 1\nstall_s = 5",
            &["line 17", "10 to 3600"],
        ),
        (
            "policy = \"slow\"",
            "policy = \"slow\", vertices = \"off\"",
            &["vertices", "off", "free"],
        ),
        (
            "PX4-01",
            "a tail number that is too long",
            &["vehicle.tail_number", "15"],
        ),
        (
            "signing = { key_file = \"uav1.key\" }",
            "",
            &["signing", "missing"],
        ),
        (
            "signing = { key_file = \"uav1.key\" }",
            "signing = \"on\"",
            &["line 18", "key_file", "off"],
        ),
        (
            "key_file = \"uav1.key\"",
            "pass_phrase = \"secret\"",
            &["line 18", "pass_phrase", "key_file"],
        ),
        (
            "tolerance_m = 1.0",
            "tolerance_m = 0.0",
            &["vehicle.curve.tolerance_m", "0.1 to 100"],
        ),
        (
            "tolerance_m = 1.0",
            "tolerance_m = nan",
            &["vehicle.curve.tolerance_m", "0.1 to 100"],
        ),
        (
            "policy = \"slow\"",
            "policy = \"fast\"",
            &["line 19", "fast", "refuse"],
        ),
        (
            "[http]",
            "[authority]\nwarn_s = 6\noffer_s = 5\n[http]",
            &["authority", "warn_s <= offer_s"],
        ),
        (
            "[http]",
            "[authority]\nact_s = 0\n[http]",
            &["line 23", "0.5 to 3600"],
        ),
        ("[http]", "[https]", &["line 22", "https"]),
        ("[store]\ndir = \"state\"", "", &["store", "missing"]),
    ];
    for (from, to, wanted) in table {
        let text = GOOD.replacen(from, to, 1);
        assert_ne!(text, GOOD, "{from} is not in the sample");
        let message = refusal(&text);
        for part in *wanted {
            assert!(
                message.contains(part),
                "{to:?} is refused without {part:?}:\n{message}"
            );
        }
    }
}

#[test]
fn vehicles_of_one_link_differ_in_their_system_ids() {
    let second = |link: &str, system: u8| {
        let text = format!(
            "[[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"{link}\"\nsystem_id = {system}\n\
             signing = {{ key_file = \"uav2.key\" }}\n[store]"
        );
        GOOD.replacen("[store]", &text, 1)
    };
    let config = Config::parse(&second("udpin:127.0.0.1:14550", 2), Path::new("")).expect("good");
    assert_eq!(config.links().len(), 1);
    let apart = Config::parse(&second("udpin:127.0.0.1:14551", 1), Path::new("")).expect("good");
    assert_eq!(apart.links().len(), 2);
    let message = refusal(&second("udpin:127.0.0.1:14550", 1));
    for part in [
        "line 23",
        "vehicle.system_id",
        "1 twice on udpin:127.0.0.1:14550",
        "MAV_SYS_ID",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let serial = second("serial:/dev/ttyACM0:57600", 2).replacen(
        "udpin:127.0.0.1:14550",
        "serial:/dev/ttyACM0:115200",
        1,
    );
    let message = refusal(&serial);
    for part in ["line 22", "vehicle.link", "serial:/dev/ttyACM0:115200"] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn a_port_is_given_once() {
    let own = "a port that nothing else of this file has: ";
    for (from, to, wanted) in [
        (
            "udpin:127.0.0.1:14550",
            "udpin:0.0.0.0:4586",
            format!(
                "vehicle.link is udpin:0.0.0.0:4586, expected {own}dli.listen is 127.0.0.1:4586"
            ),
        ),
        (
            "listen = \"127.0.0.1:4586\"",
            "listen = \"[::]:14550\"",
            format!(
                "vehicle.link is udpin:127.0.0.1:14550, expected {own}dli.listen is [::]:14550"
            ),
        ),
        (
            "[http]",
            "[[forward]]\nname = \"a\"\nlink = \"tcpin:127.0.0.1:8586\"\n[http]",
            format!(
                "forward.link is tcpin:127.0.0.1:8586, expected {own}http.listen is 127.0.0.1:8586"
            ),
        ),
    ] {
        let fault = refusal(&GOOD.replace(from, to));
        assert!(fault.contains(&wanted), "{fault}");
    }
    // At another address, of another protocol, or one that the system chooses.
    for (from, to) in [
        ("udpin:127.0.0.1:14550", "udpin:127.0.0.2:4586"),
        ("127.0.0.1:8586", "127.0.0.1:4586"),
        ("127.0.0.1:4586", "127.0.0.1:0"),
    ] {
        let text = GOOD
            .replace(from, to)
            .replace("udpin:127.0.0.1:14550", "udpin:127.0.0.1:0");
        Config::parse(&text, Path::new("")).unwrap_or_else(|fault| panic!("{to}: {fault}"));
    }
}

/// Good as a text, and a start would end: `vsm check-config` names the key and its line.
#[test]
fn what_a_start_would_end_with_is_found_with_its_line() {
    use std::os::unix::fs::PermissionsExt as _;

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let station = "override = false";
    let keys = "override = false\nguard = { key_file = \"a0.key\" }";
    let access = "[access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
    let good = GOOD.replace(station, keys) + access;
    let check = |text: &str| {
        std::fs::write(path("vsm.toml"), text).unwrap();
        let mut vsm = std::process::Command::new(kit::process::program("vsm"));
        let output = vsm.arg("check-config").arg(path("vsm.toml")).output();
        let output = output.unwrap();
        let text = [output.stdout, output.stderr].concat();
        (
            output.status.code(),
            String::from_utf8_lossy(&text).into_owned(),
        )
    };
    let refused = |text: &str, words: &[&str]| {
        let (code, printed) = check(text);
        assert_eq!(code, Some(2), "{printed}");
        for word in words {
            assert!(printed.contains(word), "{word}: {printed}");
        }
    };
    for (name, byte) in [("uav1.key", 1), ("a0.key", 2), ("access.key", 3)] {
        kit::process::write_key(&path(name), &[byte; 32]);
    }
    refused(&good, &["access.list: ", "No such file"]);
    let vsm = |words: &[&str]| {
        let mut vsm = std::process::Command::new(kit::process::program("vsm"));
        let done = vsm.args(words).current_dir(folder.path()).output();
        assert!(done.is_ok_and(|done| done.status.success()), "{words:?}");
    };
    let grant = "access grant access.list --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups fly \
                 --guard-key 0011223344556677 --until never";
    vsm(&grant.split_whitespace().collect::<Vec<_>>());
    refused(&good, &["access.list: ", "not signed"]);
    vsm(&["access", "sign", "access.list", "--key-file", "access.key"]);
    let (code, printed) = check(&good);
    assert_eq!(code, Some(0), "{printed}");
    for words in ["guarded with key id", "signed, key id"] {
        assert!(printed.contains(words), "{printed}");
    }

    std::fs::remove_file(path("a0.key")).unwrap();
    std::fs::copy(path("uav1.key"), path("a0.key")).unwrap();
    let of_guard = ["line 13: cucs.guard.key_file: ", "of vehicle 1b:00:01:01"];
    refused(&good, &of_guard);
    std::fs::remove_file(path("a0.key")).unwrap();
    refused(
        &good,
        &["line 13: cucs.guard.key_file: there is no key file"],
    );
    kit::process::write_key(&path("a0.key"), &[2; 32]);

    let open = std::fs::Permissions::from_mode(0o777);
    std::fs::set_permissions(folder.path(), open).unwrap();
    // Root refuses the folder before it reads a file in it.
    let (code, printed) = check(&good);
    assert!(
        [Some(1), Some(2)].contains(&code) && printed.contains("written by others"),
        "{printed}"
    );
    let closed = std::fs::Permissions::from_mode(0o700);
    std::fs::set_permissions(folder.path(), closed).unwrap();

    let terrain = good.replace("system_id = 1\n", "system_id = 1\nterrain = \"tiles\"\n");
    refused(
        &terrain,
        &["line 18: vehicle.terrain: ", "expected a folder"],
    );
    let tiles = good.clone() + "[web]\ntiles = \"map.pmtiles\"\n";
    refused(&tiles, &["web.tiles: ", "map.pmtiles", "No such file"]);
    assert_eq!(check(&good).0, Some(0));
}

#[test]
fn another_ground_station_is_refused_where_it_would_be_open() {
    let with = |keys: &str| GOOD.to_owned() + "[[forward]]\n" + keys;
    let good = [
        "name = \"a\"\nlink = \"udpout:10.0.0.1:14550\"\n",
        "name = \"a\"\nlink = \"udpin:127.0.0.1:14560\"\n",
        "name = \"a\"\nlink = \"udpin:0.0.0.0:14560\"\nkey_file = \"k\"\ncommands = true\n",
        "name = \"a\"\nlink = \"udpout:h:1\"\nkey_file = \"k\"\ncommands = { commands = [176] }\n",
    ];
    for keys in good {
        let config = Config::parse(&with(keys), Path::new("/etc/vsm")).expect(keys);
        let forward = config.forwards().next().expect("one");
        let key = forward.key_file.as_deref();
        assert!(key.is_none_or(|key| key == Path::new("/etc/vsm/k")));
    }
    for (keys, wanted) in [
        ("name = \"a b\"\nlink = \"udpout:h:1\"\n", "forward.name"),
        (
            "name = \"a\"\nlink = \"udpin:0.0.0.0:14560\"\n",
            "without a key it would send",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\ncommands = true\n",
            "vsm keygen",
        ),
        (
            "name = \"a\"\nlink = \"udpin:127.0.0.1:14550\"\n",
            "which no vehicle",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\nsystem_id = 1\n",
            "forward.system_id is 1",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\nsystem_id = 245\n",
            "mavlink.system_id",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\nvehicles = [\"1b:00:01:09\"]\n",
            "1b:00:01:09",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\nvehicles = []\n",
            "forward.vehicles is [], expected the ids of [[vehicle]]s of this file; without the key, all",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\ncommands = 1\n",
            "true, false, or a table",
        ),
        (
            "name = \"a\"\nlink = \"udpout:h:1\"\n[[forward]]\nname = \"a\"\nlink = \"udpout:h:2\"\n",
            "a name of its own",
        ),
    ] {
        let message = refusal(&with(keys));
        assert!(message.contains(wanted), "{keys}: {message}");
        assert!(message.contains("line 2"), "{keys}: {message}");
    }
}

#[test]
fn a_missing_file_is_named() {
    let message = Config::load(Path::new("no/such/vsm.toml"))
        .expect_err("missing")
        .to_string();
    assert!(message.contains("no/such/vsm.toml"), "{message}");
}

#[test]
fn the_examples_are_good() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
    let mut seen = 0;
    for entry in std::fs::read_dir(&folder).expect("examples") {
        let path = entry.expect("entry").path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if name.ends_with(".toml")
            && !name.ends_with(".route.toml")
            && !name.ends_with(".fence.toml")
            && !name.ends_with(".airframe.toml")
        {
            let loaded = match name.as_str() {
                "airside.toml" => AirsideConfig::load(&path).map(drop),
                _ => Config::load(&path).map(drop),
            };
            loaded.unwrap_or_else(|fault| panic!("{fault}"));
            seen += 1;
        }
    }
    assert!(seen >= 3, "{seen} examples in {}", folder.display());
}

#[test]
fn the_reference_names_every_key() {
    let reference = include_str!("../../../docs/reference/configuration.md");
    let keys = "dli.vsm_id dli.listen dli.multicast dli.interface dli.provisional cucs.id cucs.loi cucs.address \
                cucs.override vehicle.id vehicle.link vehicle.system_id vehicle.tail_number vehicle.signing vehicle.signing.exchange vehicle.signing.agent vehicle.signing.rotate_days \
                vehicle.link_id vehicle.agl vehicle.curve.tolerance_m vehicle.curve.max_items vehicle.curve.policy vehicle.curve.wind_m_s vehicle.curve.mode \
                vehicle.limits.first_m vehicle.limits.leg_m vehicle.limits.lowest_m vehicle.limits.below_home vehicle.limits.highest_m \
                vehicle.limits.speed_m_s store.dir http.listen authority.warn_s authority.offer_s authority.act_s \
                authority.on_loss mavlink.system_id mavlink.component_id record.dir record.max_mb";
    for key in keys.split_whitespace() {
        assert!(
            reference.contains(&format!("`{key}`")),
            "{key} is not in docs/reference/configuration.md"
        );
    }
}

/// The unit copies the key from beside the configuration: advice to make one in its place would make a second.
#[test]
fn the_packaged_configuration_has_one_key_before_its_first_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let (config, key) = (
        folder.path().join("vsm.toml"),
        folder.path().join("uav1.key"),
    );
    let packaged = include_str!("../../../packaging/vsm.toml");
    // Where a bridge is installed here, its key is none of this test's.
    let packaged = packaged.replace("/var/lib/vsm/", "/var/lib/vsm/no-such-folder/");
    std::fs::write(&config, packaged).expect("the configuration");
    let vsm = |words: &[&str]| {
        let mut command = std::process::Command::new(kit::process::program("vsm"));
        let output = command
            .args(words)
            .arg(if words[0] == "keygen" { &key } else { &config });
        let output = output.output().expect("vsm");
        let text = [output.stdout, output.stderr].concat();
        (
            output.status.success(),
            String::from_utf8_lossy(&text).into_owned(),
        )
    };
    let (good, printed) = vsm(&["check-config"]);
    let advice = format!("`vsm keygen {}`", key.display());
    assert!(!good && printed.contains(&advice), "{printed}");
    assert!(vsm(&["keygen"]).0);
    let (good, printed) = vsm(&["check-config"]);
    let place = format!("in {}: vsm.service copies it", key.display());
    assert!(good && printed.contains(&place), "{printed}");
}

const AGENT: &str = r#"
[agent]
vehicle_id = "1b:00:01:01"
vsm_id = "1b:00:00:01"
key_file = "uav1.key"
[radio]
link = "udpin:127.0.0.1:14560"
talkers = [{ system_id = 245, component_id = 190 }]
[px4]
link = "udpin:127.0.0.1:14550"
system_id = 1
[store]
dir = "state"
"#;

#[test]
fn the_agents_file_is_refused_with_the_key_and_what_was_expected() {
    let good = AirsideConfig::parse(AGENT, Path::new("/etc/vsm")).expect("good");
    assert_eq!(good.store.dir, Path::new("/etc/vsm/state"));
    assert!(good.px4.get_ref().restamp && !good.px4.get_ref().i_trust_this_link);
    assert!(AirsideConfig::is_meant_by(AGENT) && !AirsideConfig::is_meant_by(GOOD));
    let nine = "[{ system_id = 9, component_id = 1 }, ".to_owned()
        + &"{ system_id = 9, component_id = 1 }, ".repeat(8)
        + "]";
    let bad = [
        ("dir = \"state\"", "dir = \"state\"\nkeep = 1", "keep"),
        ("system_id = 1\n", "system_id = 0\n", "px4.system_id"),
        ("system_id = 1\n", "system_id = 246\n", "agent.system_id"),
        (
            "key_file = \"uav1.key\"",
            "key_file = \"k\"\ncomponent_id = 1",
            "agent.component_id",
        ),
        ("udpin:127.0.0.1:14550", "udpin:127.0.0.1:14560", "px4.link"),
        (
            "udpin:127.0.0.1:14550",
            "udpin:0.0.0.0:14550",
            "px4.i_trust_this_link",
        ),
        (
            "udpin:127.0.0.1:14550",
            "udpout:192.0.2.1:14550",
            "a loopback address",
        ),
        (
            "vsm_id = \"1b:00:00:01\"",
            "vsm_id = \"1b:00:01:01\"",
            "agent.vsm_id",
        ),
        ("{ system_id = 245,", "{ system_id = 1,", "radio.talkers"),
        (
            "[{ system_id = 245, component_id = 190 }]",
            "[]",
            "radio.talkers",
        ),
        (
            "[{ system_id = 245, component_id = 190 }]",
            &nine,
            "radio.talkers",
        ),
        ("[px4]\nlink", "[px4]\nlinc", "linc"),
        // A route needs an upload, which is the bridge's.
        (
            "[store]",
            "[contingency]\nlink = \"contingency-a\"\n[store]",
            "the agent uploads no route",
        ),
        (
            "[store]",
            "[contingency]\nposition = \"rtl\"\n[store]",
            "contingency.position",
        ),
        (
            "[store]",
            "[contingency]\nfence = \"rtl\"\n[store]",
            "[[contingency.area]]",
        ),
        (
            "[store]",
            "[contingency]\nlink_lost_s = 4.0\n[store]",
            "5 to 3600",
        ),
        (
            "[store]",
            "[contingency]\nbattery_percent = 91\n[store]",
            "1 to 90",
        ),
    ];
    for (from, to, key) in bad {
        let text = AGENT.replace(from, to);
        assert_ne!(text, AGENT, "{from}");
        let fault = AirsideConfig::parse(&text, Path::new(""))
            .expect_err(to)
            .to_string();
        assert!(
            fault.contains(key) && fault.contains("line"),
            "{to}: {fault}"
        );
    }
}
