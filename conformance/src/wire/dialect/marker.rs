//! A harmless setting whose effect is reported: in Edition 4 the loiter radius (2017, 3004), in Edition 2.5 the mode preference
//! (#48, #109), since nothing reports the loiter of #41 there.
//!
//! A preference has three parts of three values, so 27 radii stand for the 27 preferences. A preference that stays
//! set overrides later steering, so a station resets it before it commands a mode.

/// How many radii there are.
pub const COUNT: u32 = 27;
/// The first radius, metres.
const FIRST_M: f64 = 90.0;
/// The step from one radius to the next, metres.
const STEP_M: f64 = 1.5;

/// The radius that stands for this number, in metres.
#[must_use]
pub fn radius_m(number: u32) -> f64 {
    FIRST_M + STEP_M * f64::from(number % COUNT)
}

/// The preference (altitude, speed, course and heading) that a radius stands for.
#[must_use]
pub fn preference(radius_m: f64) -> Option<[i64; 3]> {
    let number = (radius_m - FIRST_M) / STEP_M;
    let whole = number.round();
    let is_one = (number - whole).abs() < 1e-3 && (0.0..f64::from(COUNT)).contains(&whole);
    let number = whole as i64;
    is_one.then_some([number % 3, number / 3 % 3, number / 9])
}

/// The radius for a preference, in metres; none where one of its parts is out of range.
#[must_use]
pub fn radius_of([altitude, speed, course]: [i64; 3]) -> Option<f64> {
    let valid = [altitude, speed, course]
        .iter()
        .all(|part| (0..3).contains(part));
    valid.then(|| radius_m((altitude + 3 * speed + 9 * course) as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_radius_is_one_preference_and_back() {
        for number in 0..COUNT {
            let radius = radius_m(number);
            assert_eq!(preference(radius).and_then(radius_of), Some(radius));
        }
        assert_eq!(preference(91.0), None);
        assert_eq!(preference(0.0), None);
        assert_eq!(radius_of([0, 3, 0]), None);
    }
}
