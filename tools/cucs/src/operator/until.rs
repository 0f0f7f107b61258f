//! The condition of a held command (50020) as an option: `--until battery=25`.

use std::str::FromStr;

use stanag_msgs::Bam32;
use stanag_msgs::enums::HoldCondition;
use stanag_msgs::messages::HoldCommand;

/// The condition of a held command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Until {
    /// This many seconds pass.
    Time(f64),
    /// The vehicle has passed this waypoint.
    Waypoint(u16),
    /// It enters or leaves a place.
    Crosses {
        /// True where it enters.
        entered: bool,
        /// The place.
        place: Place,
    },
    /// Less energy than this is left, per cent.
    Battery(u8),
    /// This CUCS is lost.
    LinkLost,
    /// Another held command is carried out.
    Done(u16),
}

/// An area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Degrees north and east, metres.
    Circle(f64, f64, f64),
    /// An area that was sent by 50016.
    Area(u16),
}

/// A text that is not a condition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected time=SECONDS, waypoint=NUMBER, entered=LAT,LON,METRES or entered=AREA, left=..., battery=1 to 100, link-lost or \
     done=NUMBER"
)]
pub struct NoCondition;

impl FromStr for Until {
    type Err = NoCondition;

    fn from_str(text: &str) -> Result<Until, NoCondition> {
        fn number<T: FromStr>(text: &str) -> Result<T, NoCondition> {
            text.trim().parse().map_err(|_| NoCondition)
        }
        if text == "link-lost" {
            return Ok(Until::LinkLost);
        }
        let (what, value) = text.split_once('=').ok_or(NoCondition)?;
        let place = || -> Result<Place, NoCondition> {
            match value.split(',').collect::<Vec<_>>()[..] {
                [area] => Ok(Place::Area(number(area)?)),
                [north, east, radius] => {
                    let (north, east, radius): (f64, f64, f64) =
                        (number(north)?, number(east)?, number(radius)?);
                    let on_earth = north.abs() <= 90.0 && east.abs() <= 180.0 && radius > 0.0;
                    (on_earth.then_some(Place::Circle(north, east, radius))).ok_or(NoCondition)
                }
                _ => Err(NoCondition),
            }
        };
        let until = match what {
            "time" => Until::Time(number(value)?),
            "waypoint" => Until::Waypoint(number(value)?),
            "entered" | "left" => Until::Crosses {
                entered: what == "entered",
                place: place()?,
            },
            "battery" => Until::Battery(number(value)?),
            "done" => Until::Done(number(value)?),
            _ => return Err(NoCondition),
        };
        match until {
            Until::Time(seconds) if !(0.0..86_400.0).contains(&seconds) => Err(NoCondition),
            Until::Battery(percent) if !(1..=100).contains(&percent) => Err(NoCondition),
            until => Ok(until),
        }
    }
}

impl Until {
    /// Writes the condition into a 50020. A time is left to the caller, who has the clock.
    pub(super) fn apply(self, command: &mut HoldCommand) {
        command.hold_condition = Some(match self {
            Until::Time(_) => HoldCondition::Time,
            Until::Waypoint(number) => {
                command.condition_number = Some(number);
                HoldCondition::WaypointPassed
            }
            Until::Crosses { entered, place } => {
                match place {
                    Place::Area(number) => command.condition_number = Some(number),
                    Place::Circle(north, east, radius) => {
                        command.condition_latitude = Some(Bam32::from_degrees(north));
                        command.condition_longitude = Some(Bam32::from_degrees(east));
                        command.condition_radius = Some(radius as f32);
                    }
                }
                if entered {
                    HoldCondition::AreaEntered
                } else {
                    HoldCondition::AreaLeft
                }
            }
            Until::Battery(percent) => {
                command.condition_percent = Some(percent);
                HoldCondition::BatteryBelow
            }
            Until::LinkLost => HoldCondition::LinkLost,
            Until::Done(number) => {
                command.condition_number = Some(number);
                HoldCondition::CommandDone
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_are_read_and_what_is_none_is_refused() {
        for (text, until) in [
            ("time=30", Until::Time(30.0)),
            ("waypoint=102", Until::Waypoint(102)),
            ("battery=25", Until::Battery(25)),
            ("link-lost", Until::LinkLost),
            ("done=3", Until::Done(3)),
        ] {
            assert_eq!(text.parse(), Ok(until));
        }
        let circle = Place::Circle(47.5, -8.5, 200.0);
        for (text, entered, place) in [
            ("entered=47.5,-8.5,200", true, circle),
            ("left=7", false, Place::Area(7)),
        ] {
            assert_eq!(text.parse(), Ok(Until::Crosses { entered, place }));
        }
        for text in [
            "",
            "time",
            "time=-1",
            "battery=0",
            "battery=101",
            "entered=95,0,1",
            "entered=1,2",
            "left=1,2,0",
            "then=1",
        ] {
            assert_eq!(text.parse::<Until>(), Err(NoCondition), "{text}");
        }
    }
}
