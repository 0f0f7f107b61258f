//! What Tag/Data of a 13006 requests at its waypoint, in addition to flying there: camera, camera trigger, a delay, and the
//! transition of a VTOL.
//!
//! Anything else is refused on arrival, and nothing of it is stored. Several actions are separated by `;`, up to 18
//! characters in all, and run in their order when the waypoint is reached; a transition is always the last.

use stanag_msgs::messages::VehicleSpecificWaypoint;

/// A transition of a VTOL at a waypoint; it flies the legs from there in the new state. Tag/Data of 13006.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// `TRANSITION WINGS`.
    Wings,
    /// `TRANSITION HOVER`.
    Hover,
}

/// One action of a 13006's Tag/Data, at its waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// `TRANSITION WINGS` or `TRANSITION HOVER`.
    Transition(Transition),
    /// `PHOTO`: one picture.
    Photo,
    /// `PHOTO EVERY 2.5`: a picture each 2.5 seconds, until `PHOTO STOP`.
    PhotoEvery(f64),
    /// `PHOTO STOP`.
    PhotoStop,
    /// `VIDEO START`, `VIDEO STOP`.
    Video(bool),
    /// `TRIGGER 25 M`: the camera trigger, each 25 metres flown.
    TriggerMetres(f64),
    /// `TRIGGER 2.5 S`: each 2.5 seconds.
    TriggerSeconds(f64),
    /// `TRIGGER OFF`.
    TriggerOff,
    /// `ROI OFF`: stops looking at a place.
    RoiOff,
    /// `DELAY 10`: hovers for 10 seconds.
    Delay(f64),
}

/// The actions of a 13006, in order; none for an empty one, which withdraws an earlier one.
///
/// # Errors
/// A Tag Type or a Tag/Data that is not supported.
pub fn tagged(specific: &VehicleSpecificWaypoint) -> Result<Vec<Action>, String> {
    let text = specific.tag_data.as_ref().map_or("", |text| text.as_str());
    let tag_type = specific.tag_type.unwrap_or(0);
    // The field holds 19 characters. In a full one a number may have been cut: `DELAY 40` became `DELAY 4`.
    if text.len() > LONGEST {
        return Err(format!(
            "13006 Tag/Data \"{text}\" fills its field and may have been cut, expected at most {LONGEST} characters"
        ));
    }
    let texts = text.split(';').map(str::trim).filter(|one| !one.is_empty());
    if texts
        .clone()
        .any(|one| one.split_whitespace().next() == Some("SERVO"))
    {
        return Err(format!("13006 Tag/Data \"{text}\": {NO_SERVO}"));
    }
    let actions: Option<Vec<Action>> = texts.map(named).collect();
    match actions.filter(|_| tag_type == 0 || text.is_empty()) {
        Some(actions) if tag_type == 0 => Ok(actions),
        _ => Err(format!(
            "13006 Tag Type {tag_type} with Tag/Data \"{text}\", expected Tag Type 0 with {TAGS}, divided by \";\", or with no \
             Tag/Data"
        )),
    }
}

fn named(text: &str) -> Option<Action> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let number = |word: &str, low: f64, high: f64| {
        let number = word.parse::<f64>().ok()?;
        (low..=high).contains(&number).then_some(number)
    };
    let seconds = |word: &str| number(word, 0.1, 3_600.0);
    Some(match words.as_slice() {
        ["TRANSITION", "WINGS"] => Action::Transition(Transition::Wings),
        ["TRANSITION", "HOVER"] => Action::Transition(Transition::Hover),
        ["PHOTO"] => Action::Photo,
        ["PHOTO", "EVERY", every] => Action::PhotoEvery(seconds(every)?),
        ["PHOTO", "STOP"] => Action::PhotoStop,
        ["VIDEO", "START"] => Action::Video(true),
        ["VIDEO", "STOP"] => Action::Video(false),
        ["TRIGGER", every, "M"] => Action::TriggerMetres(number(every, 0.5, 10_000.0)?),
        ["TRIGGER", every, "S"] => Action::TriggerSeconds(seconds(every)?),
        ["TRIGGER", "OFF"] => Action::TriggerOff,
        ["ROI", "OFF"] => Action::RoiOff,
        ["DELAY", time] => Action::Delay(seconds(time)?),
        _ => return None,
    })
}

/// The supported texts of Tag/Data.
const TAGS: &str = "PHOTO, PHOTO EVERY s, PHOTO STOP, VIDEO START, VIDEO STOP, TRIGGER m M, TRIGGER s S, TRIGGER OFF, ROI OFF, \
                    DELAY s, TRANSITION HOVER or TRANSITION WINGS";
/// Characters of Tag/Data.
const LONGEST: usize = 18;
/// PX4 reads the outputs 5 and 6 of a mission's DO_SET_ACTUATOR from param5 and param6, which are integers in
/// MISSION_ITEM_INT. No integer leaves an output unchanged, so every item would move both.
const NO_SERVO: &str = "SERVO is not supported: PX4 would set the actuator outputs 5 and 6 to their middle with it, whatever is on \
                        them, since its mission items cannot leave them as they are";

#[cfg(test)]
mod tests {
    use stanag_msgs::Text;

    use super::*;

    fn of(text: &str) -> Result<Vec<Action>, String> {
        tagged(&VehicleSpecificWaypoint {
            tag_data: Some(Text::new(text)),
            ..VehicleSpecificWaypoint::default()
        })
    }

    #[test]
    fn a_tag_names_actions_in_their_order() {
        assert_eq!(of(""), Ok(vec![]));
        assert_eq!(
            of("PHOTO;DELAY 2.5"),
            Ok(vec![Action::Photo, Action::Delay(2.5)])
        );
        assert_eq!(of("TRIGGER 25 M"), Ok(vec![Action::TriggerMetres(25.0)]));
        // An item of a mission would set outputs 5 and 6 too.
        let servo = of("PHOTO;SERVO 4 -0.5").expect_err("it moves others");
        assert!(servo.contains("outputs 5 and 6"), "{servo}");
        assert_eq!(
            of("TRANSITION HOVER"),
            Ok(vec![Action::Transition(Transition::Hover)])
        );
        for wrong in ["DELAY", "DELAY nan", "PHOTO EVERY 0", "FLY HOME", "PHOTO;X"] {
            let why = of(wrong).expect_err("it means nothing");
            assert!(why.contains(wrong) && why.contains("TRIGGER OFF"), "{why}");
        }
        let cut = of("TRIGGER OFF;DELAY 40").expect_err("it may have been cut");
        assert!(cut.contains("at most 18 characters"), "{cut}");
        let start = VehicleSpecificWaypoint {
            tag_type: Some(1),
            tag_data: Some(Text::new("PHOTO")),
            ..VehicleSpecificWaypoint::default()
        };
        assert!(tagged(&start).is_err_and(|why| why.contains("Tag Type 1")));
    }
}
