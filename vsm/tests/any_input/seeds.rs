//! What fuzzing begins with: the golden vectors of the DLI, recordings of real autopilots, the example configurations.

use std::path::PathBuf;

use mavlink_link::frame::Parser;
use stanag_msgs::frames as dli_frames;

use kit::any_input::session::{FRAME, MESSAGE, TIME};
use kit::captures;
use kit::process::from_hex;

/// The golden vectors, one a datagram.
pub(crate) fn datagrams() -> Vec<Vec<u8>> {
    let text = String::from_utf8(captures::unpack("dli/vectors-4586.jsonl.gz")).expect("text");
    let wires = text.lines().filter_map(|line| {
        let (_, rest) = line.split_once("\"wire\": \"")?;
        Some(rest.split('"').next()?.to_owned())
    });
    // One in so many: there are thousands of them, and each type is there often.
    wires.step_by(7).map(|hex| from_hex(&hex)).collect()
}

/// Datagrams of PX4, of another autopilot, signed and unsigned; the first byte gives the length of the pieces.
pub(crate) fn frames() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for name in [
        "02-params-mission-upload",
        "04-signing-gcs-linka",
        "11-ardupilot-signing",
    ] {
        let datagrams = capture(name);
        seeds.extend(datagrams.into_iter().step_by(97).take(60).map(|mut bytes| {
            bytes.insert(0, bytes.len() as u8);
            bytes
        }));
    }
    seeds
}

/// Whole operations: a file of 300 bytes that is read, a folder, a file that is written and one that is removed.
pub(crate) fn file_answers() -> Vec<Vec<u8>> {
    let answer = |data: &[u8]| {
        // The number, opcode and offset of the request, and an ACK.
        let mut bytes = vec![15, 12 + data.len() as u8, 0, 0, 0, 128, data.len() as u8];
        bytes.extend([0; 7]);
        bytes.extend(data);
        bytes
    };
    let size = 300_u32.to_le_bytes();
    let read = [&[][..], &size, &[1; 239], &[1; 61], &[], &size];
    let written = [&[][..], &[0; 4], &[9, 0, 0, 0], &[], &[0; 4]];
    let operations: [(u8, &[&[u8]]); 4] = [
        (3, &read),
        (0, &[&[], b"Fa\t9\0Db\0"]),
        (1, &written),
        (2, &[&[], &[]]),
    ];
    let seeds = operations.iter().map(|(first, answers)| {
        let mut seed = vec![*first];
        answers.iter().for_each(|data| seed.extend(answer(data)));
        seed
    });
    seeds.collect()
}

/// A vehicle with a live link, then one vector of each type that a station sends, with time between.
pub(crate) fn sessions() -> Vec<Vec<u8>> {
    let mut received = Vec::new();
    for bytes in capture("03-arm-takeoff-mission-landa")
        .into_iter()
        .take(400)
    {
        let mut parser = Parser::new();
        let mut frames = parser.feed(&bytes);
        while let Some(Ok(view)) = frames.next() {
            let id = view.header().message_id;
            if [0, 24, 33, 242, 245].contains(&id) && received.len() < 2_000 {
                let mut data = (id as u16).to_le_bytes().to_vec();
                data.extend(view.payload());
                push(&mut received, FRAME, &data);
            }
        }
    }
    let request = [&[0, 1][..], &request_of_all()].concat();
    push(&mut received, MESSAGE, &request);
    let mut seeds = Vec::new();
    for datagram in datagrams() {
        for frame in dli_frames(&datagram).flatten() {
            if frame.data.len() > 250 {
                continue;
            }
            let mut session = received.clone();
            let data = [&frame.header.message_type.to_be_bytes()[..], frame.data].concat();
            push(&mut session, MESSAGE, &data);
            session.extend([TIME, 50]);
            seeds.push(session);
        }
    }
    seeds
}

/// The example configurations.
pub(crate) fn configurations() -> Vec<Vec<u8>> {
    let folder = kit::workspace().join("examples");
    let entries = std::fs::read_dir(folder).expect("the examples");
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    files
        .iter()
        .map(|path| std::fs::read(path).expect("an example"))
        .collect()
}

/// Lists that somebody else has signed, and that nobody has.
pub(crate) fn access_lists() -> Vec<Vec<u8>> {
    use mavlink_link::signing::{KeyId, SigningKey};
    use stanag_msgs::Id;
    use vsm::session::{AccessEntry, AccessGroup, AccessKey, AccessList, parse_until};
    let key = AccessKey::new(&SigningKey::new([8; 32]).expect("not all zero"));
    let mut list = AccessList::new(Id(0x1b00_0001));
    let mut seeds = vec![list.draft()];
    for (n, group) in (1..).zip(AccessGroup::ALL) {
        let until = ["never", "2027-01-31T12:00:00Z"][usize::from(n % 2)];
        let entry = AccessEntry {
            cucs: Id(0x1b00_00a0 + u32::from(n / 3)),
            vehicle: Id(0x1b00_0101),
            group,
            key: KeyId::from_bytes([n; 8]),
            until: parse_until(until).expect("a time"),
        };
        list.grant(entry).expect("there is room");
        seeds.extend([list.draft(), list.signed(n.into(), &key)]);
    }
    seeds.into_iter().map(String::into_bytes).collect()
}

/// The data of a message 1 that asks for LOI 2 to 5.
fn request_of_all() -> Vec<u8> {
    use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
    use stanag_msgs::messages::CucsAuthorisationRequest;
    let message = stanag_msgs::Message::from(CucsAuthorisationRequest {
        time_stamp: Some(stanag_msgs::TimeStamp(1)),
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0f)),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    });
    let mut out = [0; 548];
    let length = message.encode_data(&mut out).expect("it fits");
    out[..length].to_vec()
}

fn push(session: &mut Vec<u8>, operation: u8, data: &[u8]) {
    session.extend([operation, u8::try_from(data.len()).unwrap_or(u8::MAX)]);
    session.extend(&data[..data.len().min(255)]);
}

/// What the autopilot of a recording sent.
fn capture(name: &str) -> Vec<Vec<u8>> {
    let sent = captures::read(name).into_iter();
    let sent = sent.filter(|datagram| datagram.from_autopilot);
    sent.map(|datagram| datagram.bytes).collect()
}

/// What a web client seals: messages, a route, what is neither.
pub(crate) fn web_frames() -> Vec<Vec<u8>> {
    let texts = [
        r#"{"n":1,"message":{"id":16002,"destination":"1b:00:00:01","fields":{"Time Stamp":849100000000}}}"#,
        r#"{"n":1,"message":{"id":1,"destination":452985089,"ack":true,"fields":{"Time Stamp":849100000000,"Requested/Handover LOI":["LOI 4","LOI 5"],"Requested/Handover Access":"request control"}}}"#,
        r#"{"n":1,"message":{"id":2016,"destination":"1b:00:01:01","fields":{"Time Stamp":1,"Select Flight Path Control Mode":"launch","Commanded Altitude":20.5,"Altitude Type":"AGL"}}}"#,
        r#"{"n":1,"route":{"vehicle":"1b:00:01:01","file":"a.kml","text":"<kml/>","stamp":1,"height_m":50}}"#,
        r#"{"n":1,"route":{"vehicle":"1b:00:01:01","file":"a.kmz","base64":"UEsDBA==","stamp":1,"line":"2"}}"#,
        r#"{"n":0,"hello":{"version":1,"cucs":"1b:00:00:b0","random":"0404040404040404040404040404040404040404040404040404040404040404"}}"#,
    ];
    texts.map(|text| text.as_bytes().to_vec()).to_vec()
}

/// A route in each kind of file; the first byte names the kind.
pub(crate) fn route_files() -> Vec<Vec<u8>> {
    let square = std::fs::read(kit::workspace().join("examples/square.route.toml"));
    let files: [(u8, &[u8]); 6] = [
        (0, &square.expect("an example")),
        (1, br#"{"fileType":"Plan","version":1,"mission":{"items":[{"command":16,"frame":3,"params":[0,0,0,null,47.1,8.1,20],"type":"SimpleItem"}],"plannedHomePosition":[47,8,400]}}"#),
        (2, b"QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t400\t1\n1\t0\t3\t16\t0\t0\t0\t0\t47.1\t8.1\t20\t1\n"),
        (3, br#"{"type":"LineString","coordinates":[[8.1,47.1,420],[8.2,47.1,420]]}"#),
        (132, b"<kml><Placemark><LineString><coordinates>8.1,47.1 8.2,47.1</coordinates></LineString></Placemark></kml>"),
        (134, b"<gpx><rte><rtept lat=\"47.1\" lon=\"8.1\"><ele>420</ele></rtept></rte></gpx>"),
    ];
    let each = files.iter().map(|(kind, file)| [&[*kind], *file].concat());
    each.collect()
}
