//! One ground station: its rights by configuration, where it was heard last, and how long it has been silent.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use stanag_msgs::Id;

use super::authority::{Asker, Silence};
use super::duplicate::Recent;
use crate::config::Cucs;

/// A CUCS of the configuration.
#[derive(Debug)]
pub(crate) struct Station {
    pub(crate) config: Cucs,
    /// Its latest accepted address: where answers and status go.
    pub(crate) peer: Option<SocketAddr>,
    /// When anything of it was accepted last.
    pub(crate) heard: Option<Duration>,
    /// It has sent 16002: only then can silence cost it control.
    pub(crate) sends_heartbeats: bool,
    pub(crate) recent: Recent,
    /// Lines of its command_log since that was last written anew.
    pub(crate) journal_lines: usize,
    /// Messages that it has scheduled by 17001: (vehicle, message type) to period.
    pub(crate) schedule: BTreeMap<(Id, u16), Period>,
}

/// How often a message goes to a station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Period {
    /// 17001 with frequency 0: not at all.
    Never,
    /// Every so long.
    Every(Duration),
}

impl Station {
    pub(crate) fn new(config: Cucs) -> Station {
        Station {
            config,
            peer: None,
            heard: None,
            sends_heartbeats: false,
            recent: Recent::default(),
            journal_lines: 0,
            schedule: BTreeMap::new(),
        }
    }

    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    pub(crate) fn asker(&self) -> Asker {
        Asker {
            id: self.config.id,
            authorised: self.config.loi.0,
            may_override: self.config.override_control,
            rank: self.config.rank,
        }
    }

    /// How long ago it was heard; `None` where silence does not count.
    pub(crate) fn silent_for(&self, now: Duration) -> Option<Duration> {
        let heard = self.heard.filter(|_| self.sends_heartbeats)?;
        Some(now.saturating_sub(heard))
    }

    /// How far its silence has gone.
    pub(crate) fn silence(&self, now: Duration, limits: &crate::config::Authority) -> Silence {
        let Some(silent) = self.silent_for(now).map(|span| span.as_secs_f64()) else {
            return Silence::None;
        };
        if silent >= limits.act_s {
            Silence::Lost
        } else if silent >= limits.offer_s {
            Silence::Offered
        } else if silent >= limits.warn_s {
            Silence::Warned
        } else {
            Silence::None
        }
    }
}
