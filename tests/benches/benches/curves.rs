//! How fast legs become vertices, and what others' flattening makes of the same curves: counts and true deviations
//! are printed first, from the same legs and the same run.
#![allow(
    missing_docs,
    reason = "criterion's macros write functions without them"
)]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use curve_paths::cubic::Cubic;
use curve_paths::vector::Vec3;
use curve_paths::{BezierLeg, Leg, Options, densify, densify_to_budget, vertices_needed};
use kit::curves::random_leg;

/// Four control points in a plane, m.
type Plane = [[f64; 2]; 4];
/// Takes a point.
type Each<'a> = &'a mut dyn FnMut(f64, f64);

const TOLERANCE_M: f64 = 1.0;

/// Legs of every kind, some 20 m to 5 km long, level.
fn legs() -> Vec<BezierLeg> {
    (0..2_000)
        .map(|seed| {
            let (_, leg) = random_leg(seed);
            let flat = |c: curve_paths::Control| curve_paths::Control::level(c.lat_deg, c.lon_deg);
            let level = |p: curve_paths::Position| curve_paths::Position { alt_m: 100.0, ..p };
            BezierLeg::new(
                level(leg.p1()),
                flat(leg.p2()),
                flat(leg.p3()),
                level(leg.p4()),
            )
            .unwrap()
        })
        .collect()
}

/// A leg of some 25 chords there and back, over and over, to about 500 vertices.
fn route_of_500() -> Vec<Leg> {
    let needs = |leg: &BezierLeg| {
        vertices_needed(&[(*leg).into()], &Options::geometry(TOLERANCE_M)).unwrap() - 1
    };
    let leg = legs()
        .into_iter()
        .find(|leg| (24..28).contains(&needs(leg)))
        .unwrap();
    let turns = 500 / needs(&leg);
    (0..turns)
        .map(|k| {
            if k % 2 == 0 {
                leg.into()
            } else {
                leg.reversed().into()
            }
        })
        .collect()
}

/// The leg in the plane at its start, for flatteners that know planes only.
fn in_plane(leg: &BezierLeg) -> Plane {
    let ecef = leg.ecef();
    let up = ecef.0[0].unit();
    let east = Vec3::new(-up.y, up.x, 0.0).unit();
    let north = up.cross(east);
    ecef.0
        .map(|p| [(p - ecef.0[0]).dot(east), (p - ecef.0[0]).dot(north)])
}

fn kurbo_points(p: &Plane, mut each: impl FnMut(f64, f64)) {
    let mut path = kurbo::BezPath::new();
    path.move_to((p[0][0], p[0][1]));
    path.curve_to((p[1][0], p[1][1]), (p[2][0], p[2][1]), (p[3][0], p[3][1]));
    kurbo::flatten(path, TOLERANCE_M, |element| {
        if let kurbo::PathEl::LineTo(q) = element {
            each(q.x, q.y);
        }
    });
}

fn lyon_points(p: &Plane, mut each: impl FnMut(f64, f64)) {
    let [from, ctrl1, ctrl2, to] = p.map(|p| lyon_geom::point(p[0], p[1]));
    lyon_geom::CubicBezierSegment {
        from,
        ctrl1,
        ctrl2,
        to,
    }
    .for_each_flattened(TOLERANCE_M, &mut |line| each(line.to.x, line.to.y));
}

fn own_points(leg: &BezierLeg, plane: &Plane, mut each: impl FnMut(f64, f64)) {
    let curve = Cubic(plane.map(|p| Vec3::new(p[0], p[1], 0.0)));
    let route = densify(&[(*leg).into()], &Options::geometry(TOLERANCE_M)).unwrap();
    for vertex in &route.vertices[1..] {
        let at = curve.at(vertex.t);
        each(at.x, at.y);
    }
}

/// Greatest distance from a dense sampling of the curve to the polyline.
fn deviation_m(plane: &Plane, line: &[[f64; 2]]) -> f64 {
    let curve = Cubic(plane.map(|p| Vec3::new(p[0], p[1], 0.0)));
    let mut worst: f64 = 0.0;
    for k in 0..=2_000 {
        let p = curve.at(f64::from(k) / 2_000.0);
        let nearest = line.windows(2).map(|s| {
            let (d, e) = (
                [s[1][0] - s[0][0], s[1][1] - s[0][1]],
                [p.x - s[0][0], p.y - s[0][1]],
            );
            let l2 = d[0] * d[0] + d[1] * d[1];
            let f = if l2 > 0.0 {
                ((d[0] * e[0] + d[1] * e[1]) / l2).clamp(0.0, 1.0)
            } else {
                0.0
            };
            (e[0] - f * d[0]).hypot(e[1] - f * d[1])
        });
        worst = worst.max(nearest.fold(f64::INFINITY, f64::min));
    }
    worst
}

#[expect(
    clippy::print_stdout,
    reason = "the counts and deviations belong beside the times"
)]
fn report(legs: &[BezierLeg], planes: &[Plane]) {
    let mut rows = [
        ("curve-paths", 0, 0.0f64),
        ("kurbo", 0, 0.0),
        ("lyon", 0, 0.0),
    ];
    for (leg, plane) in legs.iter().zip(planes).take(500) {
        for (k, row) in rows.iter_mut().enumerate() {
            let mut line = vec![plane[0]];
            let mut each = |x: f64, y: f64| line.push([x, y]);
            match k {
                0 => own_points(leg, plane, &mut each),
                1 => kurbo_points(plane, &mut each),
                _ => lyon_points(plane, &mut each),
            }
            row.1 += line.len() - 1;
            row.2 = row.2.max(deviation_m(plane, &line));
        }
    }
    println!("500 legs at {TOLERANCE_M} m: chords, true deviation m");
    for (name, chords, worst) in rows {
        println!("{name:>12} {chords:>8} {worst:>8.3}");
    }
}

/// Points a second in the fastest of many rounds, by turns: what the core does while nothing else has it. The means that
/// criterion prints contain what else the machine did.
#[expect(clippy::print_stdout, reason = "as above")]
fn fastest(rows: &[(&str, &dyn Fn() -> usize)]) {
    let mut min = vec![f64::INFINITY; rows.len()];
    for _ in 0..ROUNDS {
        for ((_, points), min) in rows.iter().zip(&mut min) {
            let begun = Instant::now();
            let points = black_box(points());
            *min = min.min(begun.elapsed().as_secs_f64() / points as f64);
        }
    }
    println!("fastest of {ROUNDS} rounds: million points a second");
    for ((name, _), min) in rows.iter().zip(min) {
        println!("{name:>20} {:>8.1}", 1e-6 / min);
    }
}

const ROUNDS: u32 = 200;

fn benches(c: &mut Criterion) {
    let legs = legs();
    let planes: Vec<_> = legs.iter().map(in_plane).collect();
    report(&legs, &planes);
    let options = Options::geometry(TOLERANCE_M);
    let route: Vec<[Leg; 1]> = legs.iter().map(|&leg| [leg.into()]).collect();
    let local = || {
        route
            .iter()
            .map(|r| vertices_needed(black_box(r), &options).unwrap() - 1)
            .sum::<usize>()
    };
    let geodetic = || {
        route
            .iter()
            .map(|r| densify(black_box(r), &options).unwrap().vertices.len() - 1)
            .sum::<usize>()
    };
    let counted = |flatten: &dyn Fn(&Plane, Each<'_>)| {
        let mut n = 0;
        planes.iter().for_each(|p| {
            flatten(p, &mut |x, y| {
                black_box((x, y));
                n += 1;
            });
        });
        n
    };
    let kurbo = || counted(&|p, each| kurbo_points(p, each));
    let lyon = || counted(&|p, each| lyon_points(p, each));
    let rows: [(&str, &dyn Fn() -> usize); 4] = [
        ("local frame", &local),
        ("geodetic output", &geodetic),
        ("kurbo, in the plane", &kurbo),
        ("lyon, in the plane", &lyon),
    ];
    fastest(&rows);
    let mut group = c.benchmark_group("points");
    for (name, points) in rows {
        group.throughput(Throughput::Elements(points() as u64));
        group.bench_function(name, |b| b.iter(points));
    }
    group.finish();

    let long = route_of_500();
    let flight = Options {
        min_chord_m: 0.0,
        ..Options::flight(TOLERANCE_M)
    };
    c.bench_function("route of 500 items", |b| {
        b.iter(|| densify(black_box(&long), &flight).unwrap().vertices.len())
    });
    let tight = Options {
        tolerance_m: 0.05,
        ..flight
    };
    c.bench_function("budget of 500 items", |b| {
        b.iter(|| {
            densify_to_budget(black_box(&long), 500, &tight)
                .unwrap()
                .tolerance_m
        });
    });
}

criterion_group!(all, benches);
criterion_main!(all);
