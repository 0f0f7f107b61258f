//! Every message that a station of Edition 2.5 may send, against the support table: taken, or refused by name with the reason.

use kit::bridge::vehicle_id;
use mapping::support::{In25, in_edition_25};
use serde_json::json;
use stanag_msgs::ed25;
use stanag_msgs::table::Direction;

use super::*;

#[test]
fn each_message_is_taken_or_refused_as_the_support_table_says() {
    let (mut rig, mut station) = ready();
    let mut refused = Vec::new();
    let from_a_cucs = |info: &&stanag_msgs::table::MessageInfo| info.direction != Direction::ToCucs;
    for info in ed25::messages().filter(from_a_cucs) {
        // A release would end the rights that the others need.
        if info.id == 1 {
            continue;
        }
        let before = station.alerts(&rig).len();
        station.send(&mut rig, vehicle_id(0), info.id, &json!({}));
        rig.run(0.4);
        let texts = station.alerts(&rig).split_off(before).join("|");
        let unsupported = texts.contains("not supported") || texts.contains("not served");
        match in_edition_25(info) {
            In25::Refused(_) => {
                let named = texts.contains(&format!("#{}", info.id))
                    || texts.contains(&format!("{} of", info.id));
                assert!(named && texts.contains("refused"), "#{}: {texts}", info.id);
                refused.push(info.id);
            }
            // Its fields may be refused, as an empty #800 or #1401 are; the message is known.
            _ => assert!(
                !unsupported || texts.contains(" mode 0"),
                "#{}: {texts}",
                info.id
            ),
        }
    }
    assert_eq!(refused.len(), 15, "{refused:?}");
}

/// Whatever Edition 4 can ask the vehicle for is reached from here where the text has the field.
#[test]
fn what_edition_4_takes_has_a_place_or_none_in_the_text() {
    let mut unreachable = Vec::new();
    for row in mapping::support::rows().filter(|row| !row.taken.is_empty() && row.id < 50_000) {
        if !ed25::messages().any(|info| info.ed4_messages.contains(&row.id)) {
            unreachable.push(row.id);
        }
    }
    // 4: #1 that waits, and #600; 2010: sticks; 16002 and heartbeats are of later editions.
    assert_eq!(unreachable, [4, 2_010, 16_002]);
}
