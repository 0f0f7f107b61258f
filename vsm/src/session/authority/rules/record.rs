//! The stored form of rights and pending handovers, written before a decision is answered.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::decision::{Handover, Reason, Stage};
use super::rights::{Rights, Stations};
use super::{Asker, Authority, CONSENT_WITHIN};

/// The stored form.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Record {
    held: Vec<Held>,
    pending: Vec<Pending>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct Held {
    id: u32,
    levels: u8,
    stations: u32,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
struct Pending {
    from: Option<u32>,
    to: u32,
    levels: u8,
    stations: u32,
    stage: StageName,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StageName {
    Consent,
    Acceptance,
    LoadThenRequested,
    LoadThenOverridden,
    LoadThenHandedOver,
    LoadThenOffered,
}

impl Authority {
    /// The state to store.
    #[must_use]
    pub fn record(&self) -> Record {
        let held = self.holders().map(|(id, rights)| Held {
            id: id.0,
            levels: rights.levels_by_themselves().raw(),
            stations: rights.stations().raw(),
        });
        let pending = self.pending.iter().map(|handover| Pending {
            from: handover.from.map(|id| id.0),
            to: handover.to.0,
            levels: handover.rights.levels_by_themselves().raw(),
            stations: handover.rights.stations().raw(),
            stage: match handover.stage {
                Stage::Consent(_) => StageName::Consent,
                Stage::Acceptance(_) => StageName::Acceptance,
                Stage::Load(Reason::Overridden) => StageName::LoadThenOverridden,
                Stage::Load(Reason::HandedOver) => StageName::LoadThenHandedOver,
                Stage::Load(Reason::OfferedInSilence) => StageName::LoadThenOffered,
                Stage::Load(_) => StageName::LoadThenRequested,
            },
        });
        Record {
            held: held.collect(),
            pending: pending.collect(),
        }
    }

    /// Restores rights and handovers, as far as the configuration still allows them. The time to consent or accept starts
    /// again.
    #[must_use]
    pub fn restored(record: &Record, now: Duration, roster: &[Asker]) -> Authority {
        let mut authority = Authority::default();
        let rights = |id: u32, levels: u8, stations: u32| {
            let asker = roster.iter().find(|asker| asker.id.0 == id)?;
            let rights = Rights::named(LoiBitmap::from_raw(levels), Stations::from_raw(stations));
            let rights = rights.both(asker.may_hold());
            (!rights.is_empty()).then_some((asker.id, rights))
        };
        for held in &record.held {
            if let Some((id, rights)) = rights(held.id, held.levels, held.stations) {
                // A record with two holders of one right was not written by this program: the first one keeps it.
                let free = rights.without(authority.held_by_others(id));
                authority.put(id, free);
            }
        }
        for pending in &record.pending {
            let Some((to, rights)) = rights(pending.to, pending.levels, pending.stations) else {
                continue;
            };
            // Deadlines are not stored: their clock starts again with the process.
            let until = now + CONSENT_WITHIN;
            authority.expect(Handover {
                from: pending.from.map(Id),
                to,
                rights,
                stage: match pending.stage {
                    StageName::Consent => Stage::Consent(until),
                    StageName::Acceptance => Stage::Acceptance(until),
                    // The load ended with the earlier process: the next check of the handover completes or ends it.
                    StageName::LoadThenRequested => Stage::Load(Reason::Requested),
                    StageName::LoadThenOverridden => Stage::Load(Reason::Overridden),
                    StageName::LoadThenHandedOver => Stage::Load(Reason::HandedOver),
                    StageName::LoadThenOffered => Stage::Load(Reason::OfferedInSilence),
                },
            });
        }
        authority
    }
}
