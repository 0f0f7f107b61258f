//! A curved leg within a route: which one leads on from a waypoint, its chords as items, and how near the vehicle comes
//! to their ends.

use mavlink_link::service::mission::Item;
use stanag_msgs::messages::UaPositionWaypoint;

use super::bounds::height;
use super::item::{self, DO_CHANGE_SPEED, NAV_WAYPOINT, change_speed};
use super::{CompiledMission, Leg, Reason, RouteError, Site};
use crate::curve::{self, Chords, Curved};
use crate::performance::Performance;
use crate::plan::Plan;

/// The curves that start at a waypoint: at most one, and to its Next Waypoint.
pub(super) fn check(plan: &Plan, number: u16, waypoint: &UaPositionWaypoint) -> Result<(), Reason> {
    let mut curves = plan.curves_from(number).map(|(p4, _)| p4);
    let Some(to) = curves.next() else {
        return Ok(());
    };
    if let Some(other) = curves.next() {
        return Err(Reason::TwoCurves(to, other));
    }
    let next = waypoint.next_waypoint.unwrap_or(0);
    if next == to {
        Ok(())
    } else {
        Err(Reason::CurveEnd { to, next })
    }
}

/// Pushes the chords of the curved leg from `p1` to `p4`, where there is one.
pub(super) fn fly(
    plan: &Plan,
    p1: &Leg,
    p4: &Leg,
    compiled: &mut CompiledMission,
    site: &Site,
) -> Result<Option<Chords>, RouteError> {
    let Some((_, curve)) = plan.curves_from(p1.number).find(|(to, _)| *to == p4.number) else {
        return Ok(None);
    };
    let speed_m_s = p4.speed_m_s.unwrap_or_else(|| compiled.speed_m_s(site));
    let chords = curve::chords(p1, p4, curve, speed_m_s, site).map_err(|fault| RouteError {
        waypoint: p1.number,
        reason: Reason::Curve {
            to: p4.number,
            fault,
        },
    })?;
    for chord in &chords.vertices {
        height(chord.level, &site.home, &site.limits).map_err(|reason| RouteError {
            waypoint: p1.number,
            reason,
        })?;
    }
    let tolerance_m = site.curving.tolerance_m;
    compiled.curved = Some(Curved::and(compiled.curved, &chords, tolerance_m));
    if chords.reads_differently {
        let text = format!(
            "curve {} to {} is flown as defined; drawn in latitude and longitude it is another line",
            p1.number, p4.number
        );
        compiled.notes.push(text);
    }
    if let Some(speed_m_s) = chords.speed_at_start_m_s {
        compiled.push(p4.number, change_speed(speed_m_s));
    }
    for chord in &chords.vertices {
        let place = (chord.latitude, chord.longitude);
        let params = [0.0, chords.acceptance_m, 0.0, f32::NAN];
        let item = item::placed(place, chord.level, NAV_WAYPOINT, params);
        compiled.push(p4.number, item);
        if let Some(speed_m_s) = chord.speed_m_s {
            compiled.push(p4.number, change_speed(speed_m_s));
        }
    }
    Ok(Some(chords))
}

/// A vertex of a level curve is not passed by more than the curve's radius; one of a climbing curve not by less.
pub(super) fn accept(item: &mut Item, chords: &Chords) {
    let acceptance_m = chords.acceptance_m;
    let closer = item.params[1] > 0.0 && item.params[1] < acceptance_m;
    if item.command == NAV_WAYPOINT && (chords.climbs || !closer) {
        item.params[1] = acceptance_m;
    }
}

/// The end of a curve before an item at another altitude: a multicopter swings about its altitude on the way to it, and
/// must stay within its radius for as long as that takes (`curve::SWING_S`).
pub(super) fn widen(items: &mut [Item], end: usize, performance: &Performance) {
    let z = |item: &Item| (item.frame, item.z);
    let speed_m_s = items
        .iter()
        .take(end)
        .rev()
        .find(|item| item.command == DO_CHANGE_SPEED)
        .map_or(performance.cruise_m_s as f32, |item| item.params[1]);
    let next = items.iter().skip(end + 1).find(|item| item.is_global());
    let differs = items
        .get(end)
        .zip(next)
        .is_some_and(|(item, next)| z(item) != z(next));
    if let Some(item) = items.get_mut(end)
        && item.command == NAV_WAYPOINT
        && differs
    {
        let wide_m = (0.5 * curve::SWING_S as f32 * speed_m_s).min(WIDEST_M);
        item.params[1] = item.params[1].max(wide_m);
    }
}

/// Most that the end of a curve is widened to, m.
const WIDEST_M: f32 = 20.0;
