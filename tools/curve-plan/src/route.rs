//! The geometry of a route: a fit as a route, and the straight legs by which a route is flown.

use cucs::formats::{Conduct, Datum, Draft, Point, Repeat};
use curve_paths::fit::Fitted;
use curve_paths::{BezierLeg, Densified};

/// A route of the cubic legs of a fit.
pub(crate) fn of_fit(name: &str, fitted: &Fitted, closed: bool, datum: Datum) -> Draft {
    let mut points: Vec<Point> = fitted
        .legs
        .iter()
        .map(|leg| Point {
            curve: Some([leg.p2(), leg.p3()]),
            ..Point::straight(leg.p1(), None)
        })
        .collect();
    if let (false, Some(leg)) = (closed, fitted.legs.last()) {
        points.push(Point::straight(leg.p4(), None));
    }
    Draft {
        name: name.to_owned(),
        closed,
        points,
        datum,
        ..Draft::default()
    }
}

/// The straight legs by which a route is flown. Its waypoints keep their actions; the vertices between have the speed
/// of their leg.
pub(crate) fn flown(route: &Draft, densified: &Densified) -> Draft {
    let n = route.points.len();
    // The index of each waypoint's vertex.
    let mut places = vec![0; n + 1];
    let mut points: Vec<Point> = Vec::with_capacity(densified.vertices.len());
    for (k, v) in densified.vertices.iter().enumerate() {
        let waypoint = if k == 0 { 0 } else { v.leg + 1 };
        let of = &route.points[waypoint % n];
        let ends = k == 0 || v.t >= 1.0;
        let conduct = match (ends, waypoint < n) {
            (true, true) => of.conduct,
            // The first waypoint again, at the end of a closed route.
            (true, false) => Conduct::default(),
            (false, _) => Conduct {
                speed_m_s: of.conduct.speed_m_s,
                speed_type: of.conduct.speed_type,
                ..Conduct::default()
            },
        };
        if ends {
            places[waypoint] = k;
        }
        points.push(Point {
            item: of.item,
            conduct,
            ..Point::straight(v.position, None)
        });
    }
    for point in &mut points {
        let repeat = &mut point.conduct.repeat;
        *repeat = repeat.map(|repeat| Repeat {
            to: places[repeat.to],
            ..repeat
        });
    }
    let extras = route.extras.iter().cloned().map(|mut extra| {
        extra.after = match extra.after.checked_sub(1) {
            Some(before) => places[before.min(n - 1)] + 1,
            None => 0,
        };
        extra
    });
    Draft {
        extras: extras.collect(),
        points,
        closed: false,
        ..route.clone()
    }
}

/// P1 to P4 of each leg of a fit, degrees north and east.
pub(crate) fn ground_points(fitted: &Fitted) -> Vec<[[f64; 2]; 4]> {
    let points = |leg: &BezierLeg| {
        let (p1, p4) = (leg.p1().ground(), leg.p4().ground());
        [p1, leg.p2().ground(), leg.p3().ground(), p4].map(|g| [g.lat_deg, g.lon_deg])
    };
    fitted.legs.iter().map(points).collect()
}
