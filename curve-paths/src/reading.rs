//! What the same four points draw under another reading.
//!
//! A ground station that draws the cubic in latitude and longitude shows another line than the one that is flown: 2
//! cm off for a leg of 1 km at 37 degrees, 1.9 m for 10 km, 48 m for 50 km. A leg for which that exceeds a quarter of
//! the tolerance deserves a warning.

use crate::leg::BezierLeg;
use crate::wgs84::Ground;

impl BezierLeg {
    /// Greatest distance, m, on the ground between this leg and the cubic through the latitudes and longitudes of its
    /// points, at the same t. From 128 samples, which find it to a thousandth.
    #[must_use]
    pub fn latitude_longitude_difference_m(&self) -> f64 {
        let points = [
            self.p1().ground(),
            self.p2().ground(),
            self.p3().ground(),
            self.p4().ground(),
        ];
        // Longitudes the short way around, so that the date line does not split the other reading.
        let west = points[0].lon_deg;
        let lon = points.map(|g| (g.lon_deg - west + 540.0).rem_euclid(360.0) - 180.0);
        let lat = points.map(|g| g.lat_deg);
        let origin = self.origin();
        let mut worst: f64 = 0.0;
        for k in 1..SAMPLES {
            let t = f64::from(k) / f64::from(SAMPLES);
            let read = Ground::new(bernstein(lat, t), west + bernstein(lon, t));
            let flown = Ground::from_ecef(origin + self.offsets().at(t));
            worst = worst.max(read.distance_m(flown));
        }
        worst
    }

    /// Whether a station that draws the cubic in latitude and longitude shows another line than is flown: by more
    /// than a quarter of the tolerance.
    #[must_use]
    pub fn reads_differently(&self, tolerance_m: f64) -> bool {
        self.latitude_longitude_difference_m() > 0.25 * tolerance_m
    }
}

fn bernstein(c: [f64; 4], t: f64) -> f64 {
    let s = 1.0 - t;
    s * s * (s * c[0] + 3.0 * t * c[1]) + t * t * (3.0 * s * c[2] + t * c[3])
}

/// Samples along a leg, which find the greatest difference to a thousandth.
const SAMPLES: u32 = 128;

#[cfg(test)]
mod tests {
    use crate::{BezierLeg, Control, Position};

    fn leg(km: f64) -> BezierLeg {
        // A gentle arc to the north-east at 37 degrees north.
        let deg = km / 111.0;
        let at = |f: f64, g: f64| (37.0 + deg * f, 127.0 + deg * g / 0.8);
        let ((a, b), (c, d), (e, f), (g, h)) =
            (at(0.0, 0.0), at(0.4, 0.1), at(0.6, 0.5), at(0.7, 0.7));
        BezierLeg::new(
            Position::new(a, b, 0.0),
            Control::level(c, d),
            Control::level(e, f),
            Position::new(g, h, 0.0),
        )
        .unwrap()
    }

    #[test]
    fn the_difference_grows_with_the_square_of_the_length() {
        let (one, ten) = (
            leg(1.0).latitude_longitude_difference_m(),
            leg(10.0).latitude_longitude_difference_m(),
        );
        assert!((0.002..0.02).contains(&one), "{one}");
        assert!((90.0..110.0).contains(&(ten / one)), "{one} {ten}");
        assert!(!leg(1.0).reads_differently(1.0) && leg(10.0).reads_differently(1.0));
    }

    #[test]
    fn the_date_line_is_no_difference() {
        let at = |lon: f64| (10.0, lon);
        let ((a, b), (c, d), (e, f), (g, h)) =
            (at(179.999), at(179.9995), at(-179.9995), at(-179.999));
        let leg = BezierLeg::new(
            Position::new(a, b, 0.0),
            Control::level(c, d),
            Control::level(e, f),
            Position::new(g, h, 0.0),
        )
        .unwrap();
        assert!(leg.latitude_longitude_difference_m() < 0.001);
    }
}
