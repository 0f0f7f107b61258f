//! The JSON form: what `vsm decode` prints and `vsm encode` reads.

use serde_json::{Value, json};
use stanag_msgs::ed25;
use stanag_msgs::json::{decode_line, encode_line};

fn encode(value: &Value, raw: bool) -> String {
    encode_line(&value.to_string(), raw).unwrap()
}

fn refuse(value: &Value, raw: bool) -> String {
    encode_line(&value.to_string(), raw)
        .unwrap_err()
        .to_string()
}

fn message(id: u16, fields: Value) -> Value {
    json!({ "id": id, "source": 452984832, "destination": "ff:ff:ff:ff", "fields": fields })
}

#[test]
fn an_id_among_the_fields_may_be_text() {
    let request = |id: Value| message(1, json!({ "Time Stamp": 1, "VSM ID": id }));
    assert_eq!(
        encode(&request(json!("ff:ff:ff:ff")), false),
        encode(&request(json!(-1)), false)
    );
    assert_eq!(
        encode(&request(json!("1b:00:00:01")), false),
        encode(&request(json!(0x1b00_0001)), false)
    );
    // Every field is in a message of Edition 2.5.
    let known = ed25::messages().find(|known| known.id == 1);
    let fields = known.expect("#1").fields.iter();
    let ones = fields.map(|field| (field.name.to_owned(), json!(1)));
    let ed25 = |id: Value| {
        let mut fields = serde_json::Map::from_iter(ones.clone());
        fields.insert("Vehicle ID".to_owned(), id);
        json!({ "id": 1, "idd": "2.5", "instance": 1, "fields": fields })
    };
    assert_eq!(
        encode(&ed25(json!("ff:00:00:00")), false),
        encode(&ed25(json!(-0x0100_0000)), false)
    );
    assert!(refuse(&ed25(json!("vehicle")), false).contains("Vehicle ID"));
    for wrong in ["1b:00:00", "", "vehicle"] {
        let why = refuse(&request(json!(wrong)), false);
        assert!(
            why.contains("VSM ID") && why.contains("an id such as 1b:00:00:01"),
            "{why}"
        );
    }
}

#[test]
fn a_message_is_printed_in_units_or_raw() {
    let command = message(
        2016,
        json!({
            "Time Stamp": 1000,
            "Select Flight Path Control Mode": "loiter",
            "Commanded Altitude": 120.0,
            "Commanded Course": -std::f64::consts::FRAC_PI_2,
            "Commanded Speed": 12.5,
            "Altitude Type": 3,
        }),
    );
    let wire = encode(&command, false);
    assert_eq!(
        wire,
        "00000011\
         1b000000ffffffff07e02000\
         01110b\
         00000003e80c001770c000001903"
    );
    let raw = json!({
        "id": 2016, "name": "Vehicle Operating Mode Command",
        "source": 452984832, "destination": 4294967295u32, "ack": false, "idd": 32, "checksum": 0,
        "fields": {
            "Time Stamp": 1000, "Select Flight Path Control Mode": 12, "Commanded Altitude": 6000,
            "Commanded Course": -16384, "Commanded Speed": 25, "Altitude Type": 3,
        },
    });
    assert_eq!(decode_line(&wire, true), std::slice::from_ref(&raw));
    assert_eq!(encode(&raw, true), wire);

    let units = &decode_line(&wire, false)[0]["fields"];
    assert_eq!(units["Select Flight Path Control Mode"], "loiter");
    assert_eq!(units["Commanded Altitude"], 120.0);
    assert_eq!(units["Commanded Course"], -std::f64::consts::FRAC_PI_2);
    assert_eq!(
        units["Altitude Type"],
        "WGS-84 (text adds 'geoid': datum ambiguous)"
    );
}

#[test]
fn values_without_a_name_are_integers_and_bitmaps_are_lists() {
    let wire = encode(
        &message(
            2,
            json!({ "LOI Granted": ["LOI 4", 32], "Access Granted": 9 }),
        ),
        false,
    );
    let fields = &decode_line(&wire, false)[0]["fields"];
    assert_eq!(
        *fields,
        json!({ "Access Granted": 9, "LOI Granted": ["LOI 4", 32] })
    );
    assert_eq!(
        decode_line(&wire, true)[0]["fields"],
        json!({ "Access Granted": 9, "LOI Granted": 36 })
    );
    assert_eq!(
        encode(
            &message(
                2,
                json!({ "LOI Granted": "LOI4", "Access Granted": "InControl" })
            ),
            false
        ),
        encode(
            &message(
                2,
                json!({ "LOI Granted": 4, "Access Granted": "in control" })
            ),
            false
        )
    );
    let none = encode(&message(2, json!({ "LOI Granted": [] })), false);
    assert_eq!(
        decode_line(&none, false)[0]["fields"],
        json!({ "LOI Granted": [] })
    );
}

#[test]
fn raw_texts_keep_every_byte_before_the_first_nul() {
    let text = |raw: bool, text: &str| {
        encode_line(
            &message(3, json!({ "Vehicle ID Update": 1, "Tail Number": text })).to_string(),
            raw,
        )
    };
    let wire = text(true, "A\u{e9}\u{7f}").unwrap();
    assert!(wire.contains("41e97f00"));
    assert_eq!(
        decode_line(&wire, true)[0]["fields"]["Tail Number"],
        "A\u{e9}\u{7f}"
    );
    assert_eq!(
        decode_line(&wire, false)[0]["fields"]["Tail Number"],
        "A?\u{7f}"
    );
    assert!(text(false, "A\u{e9}").unwrap().contains("413f00"));
    // A text is cut when raw and refused when not.
    let long = "ABCDEFGHIJKLMNOPQRSTUVWXYZ";
    assert_eq!(
        decode_line(&text(true, long).unwrap(), true)[0]["fields"]["Tail Number"],
        long[..15]
    );
    let error = text(false, long).unwrap_err().to_string();
    assert!(
        error.ends_with("expected a text of at most 15 characters"),
        "{error}"
    );
}

#[test]
fn nan_and_infinities_have_names() {
    let wire = encode(
        &message(
            3000,
            json!({ "X_CG": "NaN", "Propulsion Fuel Capacity": "-Infinity" }),
        ),
        true,
    );
    assert!(wire.ends_with("ff8000007fc00000"));
    assert_eq!(decode_line(&wire, false)[0]["fields"]["X_CG"], "NaN");
    let wire = wire.replace("7fc00000", "3dcccccd");
    assert_eq!(
        decode_line(&wire, true)[0]["fields"]["X_CG"].to_string(),
        "0.10000000149011612"
    );
}

#[test]
fn several_messages_and_errors_share_a_line() {
    let beat = encode(&message(16002, json!({ "Time Stamp": 5 })), true);
    let unknown = beat.replace("3e82", "07d9");
    let odd = beat.replace("01000000", "03000000");
    let values = decode_line(&format!("{beat}{unknown}{odd}{beat}{}", &beat[..10]), true);
    assert_eq!(values.len(), 5);
    assert_eq!(
        (&values[0]["id"], &values[3]["id"]),
        (&json!(16002), &json!(16002))
    );
    assert_eq!(
        values[1],
        json!({ "error": "unknown message type 2009", "offset": 22 + 16, "id": 2009 })
    );
    assert_eq!(values[2]["offset"], 44 + 16);
    assert_eq!(
        values[4],
        json!({ "error": "offset 88: 5 bytes, expected a header of 16", "offset": 88 })
    );
}

#[test]
fn lines_that_are_not_hexadecimal_give_the_place() {
    assert_eq!(decode_line("  \n", true), [] as [Value; 0]);
    let error = |line| decode_line(line, true).remove(0);
    assert_eq!(
        error("00zz"),
        json!({ "error": "'z', expected a hexadecimal digit", "offset": 2 })
    );
    assert_eq!(
        error("123"),
        json!({ "error": "3 hexadecimal digits, expected an even number", "offset": 3 })
    );
    assert_eq!(error("00ÿ")["offset"], 2);
}

#[test]
fn encode_errors_name_what_was_expected() {
    let with = |key: &str, value: Value| {
        let mut message = message(13002, json!({}));
        message[key] = value;
        refuse(&message, true)
    };
    assert_eq!(with("id", json!(2009)), "id: unknown message type 2009");
    assert_eq!(with("id", json!(70000)), "id: 70000, expected 0 to 65535");
    assert_eq!(
        with("source", json!(-1)),
        "source: -1, expected 0 to 4294967295"
    );
    assert_eq!(
        with("source", json!("1b")),
        "source: \"1b\", expected 1 bytes, expected 4 as in 1b:00:00:01"
    );
    assert_eq!(with("idd", json!(29)), "idd: 29, expected 30 to 32");
    assert_eq!(with("checksum", json!(4)), "checksum: 4, expected 0 to 3");
    assert_eq!(with("ack", json!(1)), "ack: 1, expected true or false");
    assert_eq!(with("fields", json!([])), "fields: [], expected an object");
    assert_eq!(
        with("fields", json!({ "Speed": 1 })),
        "message 13002 has no field \"Speed\""
    );
    assert_eq!(
        refuse(&json!({ "id": 16002, "source": 1, "fields": {} }), true),
        "destination is missing"
    );
    assert_eq!(
        encode_line("{\"id\": 16002,", true).unwrap_err().to_value()["offset"],
        json!(12)
    );

    // A misspelt or foreign key is no message without it.
    let known = "id, name, source, destination, ack, idd, checksum, fields";
    for (key, value) in [
        ("Ack", json!(true)),
        ("destinaton", json!("1b:00:01:01")),
        ("instance", json!(1)),
        ("wire", json!("00")),
    ] {
        let refused = format!("unknown key {key:?}, expected only {known}");
        assert_eq!(with(key, value), refused);
    }
    let of_ed25 = json!({ "id": 1, "idd": "2.5", "source": 1, "fields": {} });
    assert_eq!(
        refuse(&of_ed25, true),
        "unknown key \"source\", expected only id, name, idd, instance, fields"
    );

    let field =
        |name: &str, value: Value, raw: bool| refuse(&message(13002, json!({ name: value })), raw);
    assert_eq!(
        field("Waypoint Number", json!(65536), true),
        "Waypoint Number: 65536, expected 0 to 65535"
    );
    assert_eq!(
        field("Waypoint Number", json!(0), false),
        "Waypoint Number: 0, expected 1 to 65534"
    );
    assert_eq!(
        field("Waypoint to Speed", json!(-1), false),
        "Waypoint to Speed: -1, expected 0 to 32767.5 m/s"
    );
    assert_eq!(
        field("Turn Type", json!("u-turn"), false),
        "Turn Type: \"u-turn\", expected an integer or \"short turn (cut the corner)\", \"fly over\""
    );
    assert_eq!(
        field("Turn Type", json!("fly over"), true),
        "Turn Type: \"fly over\", expected an integer"
    );
    assert_eq!(
        field("Loop Limit", json!(1.5), true),
        "Loop Limit: 1.5, expected an integer"
    );
}
