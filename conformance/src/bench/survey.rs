//! What a discovery showed: vehicles, ids, levels, payload stations; and whether the run may begin at all.
//!
//! What the profile claims is added to what was found.

use std::collections::BTreeSet;

use stanag_msgs::Id;

/// What the subject is and whom it knows.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// Vehicles that the subject offered, or that the profile names.
    pub vehicles: Vec<VehicleFound>,
    /// CUCS ids that the subject knows.
    pub cucs: Vec<CucsFound>,
    /// Whether it answered anything.
    pub answered: bool,
    /// Whether it answers a broadcast discovery.
    pub broadcast: bool,
    /// Whether a data link answered to a broadcast request.
    pub data_links: bool,
    /// Whether one of these data links was free.
    pub links_available: bool,
    /// Share of round trips that were lost, 0 to 1: those that were answered late are not.
    pub loss: f64,
    /// Who else is in control, where the run must not begin.
    pub occupied: Option<String>,
}

/// A vehicle.
#[derive(Clone, Debug)]
pub struct VehicleFound {
    /// Its id.
    pub id: Id,
    /// Vehicle Type.
    pub kind: i64,
    /// Vehicle Subtype.
    pub subtype: i64,
    /// Payload stations, a bit for each.
    pub stations: i64,
}

/// A CUCS id.
#[derive(Clone, Debug)]
pub struct CucsFound {
    /// The id.
    pub id: Id,
    /// LOI Authorised of message 2, as bits.
    pub authorised: i64,
    /// Whether the profile lets it override.
    pub overrides: bool,
    /// The levels that the profile claims for it, as bits.
    pub claimed: Option<i64>,
}

/// LOI numbers as bits.
#[must_use]
pub fn bits(levels: &[u8]) -> i64 {
    levels.iter().fold(0, |bits, &level| {
        bits | if (2..=5).contains(&level) {
            1 << (level - 2)
        } else {
            0
        }
    })
}

impl Survey {
    /// The vehicle that is judged.
    #[must_use]
    pub fn vehicle(&self) -> Option<&VehicleFound> {
        self.vehicles.first()
    }

    /// The ids of the vehicles, in the order in which they were offered.
    pub fn vehicle_ids(&self) -> impl Iterator<Item = Id> {
        self.vehicles.iter().map(|vehicle| vehicle.id)
    }

    /// Ids that may have these levels, those without override first.
    #[must_use]
    pub fn with(&self, levels: i64) -> Vec<&CucsFound> {
        let mut found: Vec<_> = self
            .cucs
            .iter()
            .filter(|cucs| (cucs.authorised | cucs.claimed.unwrap_or_default()) & levels == levels)
            .collect();
        found.sort_by_key(|cucs| cucs.overrides);
        found
    }

    /// Numbers of the payload stations of the judged vehicle, from 1.
    #[must_use]
    pub fn stations(&self) -> BTreeSet<u8> {
        let bits = self.vehicle().map_or(0, |vehicle| vehicle.stations);
        (1..=16)
            .filter(|station| bits >> (station - 1) & 1 == 1)
            .collect()
    }
}
