//! Corners: fixes where the track turns so sharply that a leg must not run through.

use super::plane::Vec2;
use super::track::Sampled;

/// The fixes at which the track, looked at over `reach_m` before and after, turns by more than `corner_deg`; of
/// several within that reach, the one that turns most. Ascending.
pub(crate) fn corners(track: &Sampled, corner_deg: f64, reach_m: f64) -> Vec<usize> {
    let turns: Vec<f64> = (0..track.count)
        .map(|i| turn_deg(track, i, reach_m))
        .collect();
    let arc = |i: usize| track.arc_m[track.fix[i]];
    let lap_m = if track.closed {
        arc(track.count)
    } else {
        f64::INFINITY
    };
    let is_top = |&i: &usize| {
        turns[i] > corner_deg
            && (0..track.count).all(|k| {
                let apart = (arc(k) - arc(i)).abs();
                let near = apart.min(lap_m - apart) <= reach_m;
                k == i || !near || turns[k] < turns[i] || (turns[k] == turns[i] && k > i)
            })
    };
    (0..track.count).filter(is_top).collect()
}

fn turn_deg(track: &Sampled, i: usize, reach_m: f64) -> f64 {
    if !track.closed && (i == 0 || i == track.count - 1) {
        return 0.0;
    }
    // In the second round of a closed track there is room on both sides of every fix but the last few of it.
    let k = track.fix[if track.closed && i < track.count / 2 {
        i + track.count
    } else {
        i
    }];
    let here = track.arc_m[k];
    let (before, after) = (at(track, here - reach_m), at(track, here + reach_m));
    let (a, b) = (track.points[k] - before, after - track.points[k]);
    a.cross(b).atan2(a.dot(b)).abs().to_degrees()
}

/// The point of the track at a length along it, its ends beyond them.
fn at(track: &Sampled, arc_m: f64) -> Vec2 {
    let k = track.arc_m.partition_point(|&a| a < arc_m);
    if k == 0 {
        return track.points[0];
    }
    if k == track.points.len() {
        return track.points[k - 1];
    }
    let (a, b) = (track.arc_m[k - 1], track.arc_m[k]);
    track.points[k - 1].lerp(track.points[k], (arc_m - a) / (b - a))
}
