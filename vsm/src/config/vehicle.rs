//! `[[vehicle]]`: one vehicle, its link and key, its geofence, and the bounds of what it is commanded to fly.

use mapping::area::{self, Holder, Shape};
use serde::Deserialize;
use stanag_msgs::Id;

use super::contingency::Contingency;
use super::controls::Controls;
use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Required, Table, Value, ValueOrTable};
use super::key::table;
use super::payload::{self, Payload};
use super::rally::{self, Rally};
use super::termination::Termination;
use super::terrain::TerrainFolder;
use super::value::{self, LinkAddress, Signing, SigningTable, id, logical_id};

table! {
    /// `[[vehicle]]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Vehicle {
        /// Identification number of the vehicle (the wrapper's destination of commands)
        #[serde(deserialize_with = "id")]
        pub id: Id => Required,
        /// Logical id, `"00:.."`, by which it is offered until it is there; then a message 3 names the `id` in its place, for as
        /// long as this VSM runs
        #[serde(default, deserialize_with = "logical_id")]
        pub logical_id: Option<Id> => Nothing("its `id` at once"),
        /// Where its MAVLink is: `udpin:ADDRESS:PORT` bind and wait, `udpout:HOST:PORT`, `serial:DEVICE:BAUD`. Vehicles that
        /// differ in `system_id` may share one, each with a key of its own
        pub link: LinkAddress => Required,
        /// MAVLink system id of the vehicle, 1 to 255, and not `mavlink.system_id`
        pub system_id: u8 => Required,
        /// So many vehicles of this table, 1 to 255, on one link: `id`, `logical_id` and `system_id` are counted up from the ones given
        /// here, and `{n}` in `tail_number` and `signing.key_file` stands for the number of each, from 1. They share `rate_bps`
        pub count: Option<u8> => Nothing("one vehicle"),
        /// Tail number for message 3, at most 15 ASCII characters
        #[serde(default)]
        pub tail_number: String => Value("\"\""),
        /// `{ key_file = "FILE" }`, or `"off"`, which is logged and raised as a 16000 alert
        pub signing: Signing => ValueOrTable(SigningTable::KEYS),
        /// MAVLink signing link id of the VSM on this link, 0 to 255
        #[serde(default)]
        pub link_id: u8 => Value("0"),
        /// MAVLink signing link id, 0 to 255, that the vehicle's autopilot uses on this link (PX4: the number of its MAVLink
        /// instance); given here, no other is ever accepted
        pub vehicle_link_id: Option<u8> => Nothing("learned, and kept in the store"),
        /// What its link carries, where that is little, such as a radio: bits a second in both directions together, 9600 to
        /// 10000000. Reports of the vehicle are requested less often until they fit, and what can wait waits for commands
        /// ([px4.md](../guide/px4.md#a-slow-radio))
        pub rate_bps: Option<u32> => Nothing("no limit"),
        /// Whether all of the link is encrypted ([encryption.md](../guide/encryption.md)): with an air-side agent that has been
        /// paired (`signing.exchange = "on"`) and `encrypt = true` in the `[radio]` of its file. Nothing is taken or sent in the
        /// clear then but KEY_EXCHANGE
        #[serde(default)]
        pub encrypt: bool => Value("false"),
        /// How altitude type 2 (AGL) is flown: as height above `"home"`, above the ground of `terrain` (`"terrain"`, refused where
        /// no file covers a place, [mapping.md](../guide/mapping.md#height-above-the-ground)), or `"refuse"`
        #[serde(default)]
        pub agl: Agl => Value("\"home\""),
        /// How curved legs are flown.
        #[serde(default)]
        pub curve: Curve => Table(Curve::KEYS),
        /// Longest time, s, that a mission may get no nearer to its waypoint before the vehicle is commanded to hold, 10 to
        /// 3600; `0` for no watch ([px4.md](../guide/px4.md))
        #[serde(default = "value::default_stall", deserialize_with = "value::stall")]
        pub stall_s: Option<f64> => Value("30.0"),
        /// Folder of elevation files (SRTM tiles such as `N47E008.hgt`, GeoTIFF in degrees such as those of Copernicus, ESRI grids
        /// `.asc`): a route that is anywhere below their
        /// ground, between waypoints too, is refused ([mapping.md](../guide/mapping.md)). All are read at the start, 1 GiB at most
        #[serde(default)]
        pub terrain: Option<TerrainFolder> => Nothing("routes are compared with home alone"),
        /// Bounds of a route.
        #[serde(default)]
        pub limits: Limits => Table(Limits::KEYS),
        /// Where a fixed wing or VTOL lands while no approach route is loaded; without it a route without one is refused.
        pub landing: Option<Landing> => Table(Landing::KEYS),
        /// What a commanded flight termination does; without this table it is refused.
        pub termination: Option<Termination> => Table(Termination::KEYS),
        /// What is flown while something is wrong with it.
        #[serde(default)]
        pub contingency: Contingency => Table(Contingency::KEYS),
        /// Its parameters that a CUCS is offered as controls; without it none is.
        pub controls: Option<Controls> => Table(Controls::KEYS),
        /// Areas of its geofence, which no CUCS can take away.
        #[serde(default)]
        pub area: Vec<Area> => Table(Area::KEYS),
        /// Where it may return to beside home.
        #[serde(default)]
        pub rally: Vec<Rally> => Table(Rally::KEYS),
        /// Its payload stations.
        #[serde(default)]
        pub payload: Vec<Payload> => Table(Payload::KEYS),
    }
}

table! {
    /// `vehicle.curve`
    #[derive(Debug, Clone, Copy, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Curve {
        /// Largest planned deviation from a curve, 0.1 to 100 m
        pub tolerance_m: f64 => Value("1.0"),
        /// Largest number of mission items of a route, 2 to 10000; where it needs more, repeated speeds are left out, then its
        /// curves flown within the smallest tolerance that this allows, reported by 16000
        pub max_items: u16 => Value("500"),
        /// Where a curve is too tight for the speed: `"slow"` or `"refuse"`
        pub policy: CurvePolicy => Value("\"slow\""),
        /// Vertices of the straight legs `"on"` the curve, or `"free"`: off it by up to the tolerance, about a quarter fewer
        /// items, proven all the same
        pub vertices: CurveVertices => Value("\"on\""),
        /// Wind, from any direction, in which the flown deviation of wings is predicted, 0 to 30 m/s
        pub wind_m_s: f64 => Value("5.0"),
        /// How a multicopter flies curves: as straight legs of its `"mission"`, or `"offboard"`: streamed, by set points along
        /// the curve itself, which depends on the link while it is flown; only with a `COM_OBL_RC_ACT` of 3, 4 or 5 and a
        /// `COM_OF_LOSS_T` of 0.5 to 1 s ([curves.md](../guide/curves.md#streamed-curves))
        pub mode: CurveMode => Value("\"mission\""),
    }
}

impl Default for Curve {
    fn default() -> Self {
        Curve {
            tolerance_m: 1.0,
            max_items: 500,
            policy: CurvePolicy::Slow,
            vertices: CurveVertices::On,
            wind_m_s: 5.0,
            mode: CurveMode::Mission,
        }
    }
}

/// `vehicle.curve.mode`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurveMode {
    /// As chords, items of the mission.
    Mission,
    /// By set points along the curve.
    Offboard,
}

/// `vehicle.curve.vertices`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurveVertices {
    /// On the curve.
    On,
    /// Off it by up to the tolerance: about a quarter fewer items, proven all the same.
    Free,
}

/// `vehicle.curve.policy`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurvePolicy {
    /// Slow down before the tight part, and speed up after.
    Slow,
    /// Refuse the route.
    Refuse,
}

/// `vehicle.agl`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Agl {
    /// Flown as height above home (MAVLink frame 6).
    #[default]
    Home,
    /// Above the ground of `vehicle.terrain`.
    Terrain,
    /// Refused.
    Refuse,
}

table! {
    /// `vehicle.limits`: a route beyond these is refused whole.
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Limits {
        /// Farthest first waypoint from home, m, above 0
        pub first_m: f64 => Value("5000.0"),
        /// Longest leg, m, above 0
        pub leg_m: f64 => Value("50000.0"),
        /// Lowest waypoint, m above home, below `highest_m`; a negative one has an effect only with `below_home = true`
        pub lowest_m: f64 => Value("-500.0"),
        /// Whether any part of a route, or a commanded altitude, may be below home, which is then bounded by `lowest_m`: for
        /// a flight into a valley ([mapping.md](../guide/mapping.md))
        pub below_home: bool => Value("false"),
        /// Highest waypoint, m above home
        pub highest_m: f64 => Value("5000.0"),
        /// What follows where the vehicle itself is outside `lowest_m` (once it was above it, and unless it lands or returns) to
        /// `highest_m`: an alert as long as it is (`"alert"`), or hold, too, where it flies by itself and is 5 m outside, 20 m on wings (`"hold"`)
        pub outside: Outside => Value("\"alert\""),
        /// Lowest place of a route, m above the terrain where `vehicle.terrain` covers it, -500 to 1000: what elevation files are
        /// off by belongs into it (SRTM: up to 16 m); a negative one allows a route below their ground
        pub above_terrain_m: f64 => Value("0.0"),
        /// Fastest commanded speed, m/s, above 0; the vehicle's own limit (MPC_XY_VEL_MAX, FW_AIRSPD_MAX) applies where it is lower
        pub speed_m_s: f64 => Value("100.0"),
        /// Lowest transition of a VTOL, m above home, above 0; VT_FW_MIN_ALT applies where it is higher
        pub transition_m: f64 => Value("20.0"),
    }
}

impl Default for Limits {
    fn default() -> Self {
        let mapping::limits::Limits {
            first_m,
            leg_m,
            lowest_m,
            below_home,
            highest_m,
            above_terrain_m,
            speed_m_s,
            transition_m,
            ..
        } = mapping::limits::Limits::default();
        Limits {
            first_m,
            leg_m,
            lowest_m,
            below_home,
            highest_m,
            outside: Outside::Alert,
            above_terrain_m,
            speed_m_s,
            transition_m,
        }
    }
}

/// `vehicle.limits.outside`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outside {
    /// An alert.
    Alert,
    /// An alert, and hold.
    Hold,
}

table! {
    /// `vehicle.landing`: a loiter down to `height_m`, then straight to the touch-down.
    #[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Landing {
        /// Landing pattern of a fixed wing or VTOL: the course of its final approach, degrees clockwise from true north, 0
        /// to 360 ([wings.md](../guide/wings.md))
        pub course_deg: f64 => Required,
        /// Height of its loiter, m above home, 1 to 500
        #[serde(default = "Landing::default_height_m")]
        pub height_m: f64 => Value("50.0"),
        /// Slope of the glide of a fixed wing, degrees, 0.5 to 45; at most the vehicle's FW_LND_ANG
        pub glide_deg: Option<f64> => Nothing("FW_LND_ANG of the vehicle"),
        /// Radius of its loiter, m, 10 to 1000, or -10 to -1000, which is counter-clockwise
        pub radius_m: Option<f64> => Nothing("NAV_LOITER_RAD of the vehicle"),
        /// Touch-down: degrees north and east
        pub place: Option<[f64; 2]> => Nothing("home"),
    }
}

impl Landing {
    fn default_height_m() -> f64 {
        50.0
    }

    /// As routes are ended by it.
    #[must_use]
    pub fn pattern(&self) -> mapping::route::Pattern {
        mapping::route::Pattern {
            course_rad: self.course_deg.to_radians(),
            height_m: self.height_m,
            glide_deg: self.glide_deg,
            radius_m: self.radius_m,
            place: self.place.map(|[north, east]| (north, east)),
        }
    }

    fn check(&self, at: usize) -> Result<(), Fault> {
        for (key, value, range, expected) in [
            (
                "course_deg",
                Some(self.course_deg),
                0.0..=360.0,
                "0 to 360 (degrees)",
            ),
            (
                "height_m",
                Some(self.height_m),
                1.0..=500.0,
                "1 to 500 (metres)",
            ),
            (
                "glide_deg",
                self.glide_deg,
                0.5..=45.0,
                "0.5 to 45 (degrees)",
            ),
            (
                "radius_m",
                self.radius_m.map(f64::abs),
                10.0..=1000.0,
                "10 to 1000 (metres), or negative",
            ),
        ] {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return fault(at, &format!("vehicle.landing.{key}"), value, expected);
            }
        }
        let on_earth = |[north, east]: [f64; 2]| north.abs() <= 90.0 && east.abs() <= 180.0;
        if let Some(place) = self.place.filter(|place| !on_earth(*place)) {
            let [north, east] = place;
            let found = format!("[{north}, {east}]");
            return fault(at, "vehicle.landing.place", found, "degrees north and east");
        }
        Ok(())
    }
}

table! {
    /// One area of the geofence: a polygon by `vertices`, or a circle by `centre` and `radius_m`.
    #[derive(Debug, Clone, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Area {
        /// In an area of the geofence, always aboard: `"in"` the vehicle stays inside, `"out"` outside
        pub keep: Keep => Required,
        /// Corners of a polygon in turn, degrees north and east, 3 to 64, and those of all areas together at most 64, each circle counted
        /// as one; or a circle:
        #[serde(default)]
        pub vertices: Vec<[f64; 2]> => Nothing("none"),
        /// Centre of a circle: degrees north and east
        pub centre: Option<[f64; 2]> => Nothing("none"),
        /// Radius of the circle, m, above 0, at most 100000
        pub radius_m: Option<f64> => Nothing("none"),
    }
}

/// `vehicle.area.keep`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Keep {
    /// It stays inside.
    In,
    /// It stays outside.
    Out,
}

impl Area {
    /// As the fence is made of it.
    #[must_use]
    pub fn area(&self) -> area::Area {
        let shape = match (self.centre, self.radius_m) {
            (Some([north, east]), Some(radius_m)) => Shape::Circle {
                centre: (north, east),
                radius_m,
            },
            _ => Shape::Polygon(self.vertices.iter().map(|[n, e]| (*n, *e)).collect()),
        };
        area::Area {
            keep_in: self.keep == Keep::In,
            shape,
        }
    }
}

impl Vehicle {
    /// Its ranges. `at` is where its table begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        if self.tail_number.len() > 15 || !self.tail_number.is_ascii() {
            let expected = "at most 15 ASCII characters";
            return fault(at, "vehicle.tail_number", &self.tail_number, expected);
        }
        if let Signing::KeyFile(_, exchange) = &self.signing {
            if exchange.agent < 2 {
                let expected = "a component id of 2 to 255: 1 is the autopilot";
                return fault(at, "vehicle.signing.agent", exchange.agent, expected);
            }
            let days = exchange.rotate_days;
            if !(0.0001..=3650.0).contains(&days) {
                let expected = "0.0001 to 3650 (days)";
                return fault(at, "vehicle.signing.rotate_days", days, expected);
            }
        }
        if self.encrypt && !self.signing.agrees_with_agent() {
            let expected = "vehicle.signing with exchange = \"on\" beside it: the link's keys are agreed on with the agent \
                            that has been paired";
            return fault(at, "vehicle.encrypt", true, expected);
        }
        if let Some(rate) = self.rate_bps
            && !(MIN_RATE_BPS..=10_000_000).contains(&rate)
        {
            let expected = "9600 to 10000000 (bits a second)";
            return fault(at, "vehicle.rate_bps", rate, expected);
        }
        if self.curve.mode == CurveMode::Offboard && self.rate_bps.is_some() {
            let expected = "\"mission\" beside vehicle.rate_bps: set points take 16000 bits/s, and cannot wait";
            return fault(at, "vehicle.curve.mode", "\"offboard\"", expected);
        }
        if self.agl == Agl::Terrain && self.terrain.is_none() {
            let expected = "vehicle.terrain beside it: the folder of the elevation files";
            return fault(at, "vehicle.agl", "\"terrain\"", expected);
        }
        self.curve.check(at)?;
        payload::check(&self.payload, at)?;
        self.contingency.check(at)?;
        if let Err(found) = check_areas(&self.area) {
            return fault(at, "vehicle.area", found, "areas that make a fence");
        }
        let areas: Vec<_> = self.area.iter().map(Area::area).collect();
        rally::check(&self.rally, &areas, at)?;
        if let Some(landing) = &self.landing {
            landing.check(at)?;
        }
        if let Some(termination) = &self.termination {
            termination.check(at)?;
        }
        if let Some(controls) = &self.controls {
            controls.check(at)?;
        }
        self.limits.check(at)
    }
}

impl Curve {
    fn check(self, at: usize) -> Result<(), Fault> {
        if !(0.1..=100.0).contains(&self.tolerance_m) {
            let expected = "0.1 to 100 (metres)";
            return fault(at, "vehicle.curve.tolerance_m", self.tolerance_m, expected);
        }
        if !(2..=10_000).contains(&self.max_items) {
            return fault(at, "vehicle.curve.max_items", self.max_items, "2 to 10000");
        }
        if !(0.0..=30.0).contains(&self.wind_m_s) {
            return fault(at, "vehicle.curve.wind_m_s", self.wind_m_s, "0 to 30 (m/s)");
        }
        Ok(())
    }
}

impl Limits {
    fn check(self, at: usize) -> Result<(), Fault> {
        for (key, value) in [
            ("vehicle.limits.first_m", self.first_m),
            ("vehicle.limits.leg_m", self.leg_m),
            ("vehicle.limits.speed_m_s", self.speed_m_s),
            ("vehicle.limits.transition_m", self.transition_m),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return fault(at, key, value, "a number above 0");
            }
        }
        let (lowest_m, highest_m) = (self.lowest_m, self.highest_m);
        if !(lowest_m.is_finite() && highest_m.is_finite() && lowest_m < highest_m) {
            let found = format!("lowest_m {lowest_m} and highest_m {highest_m}");
            return fault(at, "vehicle.limits", found, "lowest_m below highest_m");
        }
        if !(-500.0..=1000.0).contains(&self.above_terrain_m) {
            let (key, expected) = ("vehicle.limits.above_terrain_m", "-500 to 1000 (metres)");
            return fault(at, key, self.above_terrain_m, expected);
        }
        Ok(())
    }
}

/// Whether the areas make a fence; what is wrong where they do not.
pub(super) fn check_areas(areas: &[Area]) -> Result<(), String> {
    let mut all = Vec::with_capacity(areas.len());
    for (number, area) in (1..).zip(areas) {
        let places = area.vertices.iter().chain(&area.centre);
        for [north, east] in places {
            if !(-90.0..=90.0).contains(north) || !(-180.0..=180.0).contains(east) {
                return Err(format!(
                    "area {number}: {north}, {east} is not a place on earth"
                ));
            }
        }
        match (area.vertices.len(), area.centre, area.radius_m) {
            (3.., None, None) => {}
            (0, Some(_), Some(radius_m)) if radius_m > 0.0 && radius_m <= 1e5 => {}
            (0, Some(_), Some(radius_m)) => {
                return Err(format!("area {number}: radius_m {radius_m}"));
            }
            (count, _, _) => {
                return Err(format!(
                    "area {number}: {count} vertices, centre and radius_m {}",
                    if area.centre.is_some() && area.radius_m.is_some() {
                        "too"
                    } else {
                        "not both given"
                    }
                ));
            }
        }
        all.push(area.area());
    }
    area::fence(&all, &[], &Holder::default())
        .map(|_| ())
        .map_err(|fault| fault.reason.to_string())
}

/// The slowest link that is of use to one vehicle, bits a second.
pub(super) const MIN_RATE_BPS: u32 = 9_600;
