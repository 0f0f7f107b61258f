//! One ground station (CUCS): its rights by configuration, its address, and how long it has been silent.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use stanag_msgs::ed25::Version;
use stanag_msgs::enums::LoiBitmap;

use super::access::{Group, Permits, Permitted};
use super::authority::rules::{Asker, GUARDED_RANK, Silence};
use super::clock_offset::ClockOffset;
use super::duplicates::Delay;
use super::editions::Translator;
use super::guard::GuardEnd;
use super::station_profile::{Shown, StationProfile};
use super::web::WebLink;
use crate::config::{Cucs, Dli, Edition};

/// A station that has sent nothing in its edition for this long may come back in another one.
pub(crate) const EDITION_CHANGES_AFTER: Duration = Duration::from_secs(10);

/// A CUCS of the configuration.
#[derive(Debug)]
pub(crate) struct GroundStation {
    pub(crate) config: Cucs,
    /// How it is spoken to.
    pub(crate) profile: StationProfile,
    /// It was removed from the configuration. It keeps its place, since other machines refer to it by index.
    pub(crate) removed: bool,
    /// Where it is (`paths`): where answers and status go.
    pub(crate) peer: Option<SocketAddr>,
    /// It has proved to be there, or the configuration vouches for the address.
    pub(crate) proven: bool,
    /// When anything of it was accepted last, acknowledgements apart.
    pub(crate) received: Option<Duration>,
    /// Its clock against this computer's.
    pub(crate) clock: ClockOffset,
    /// The delay of its latest message.
    pub(crate) delay: Delay,
    /// It has sent 16002 from a proven address: only then can silence cost it control.
    pub(crate) sends_heartbeats: bool,
    /// The end of its guarded way, where it has one and there is a key.
    pub(crate) guard: Option<GuardEnd>,
    /// The latest guard key that it has used while it was in force, in earlier runs too.
    pub(crate) used_key: Option<KeyId>,
    /// The guard key that has sealed what is handled now.
    pub(crate) sealed_under: Option<KeyId>,
    /// Its connection, if it is a connected web client.
    pub(crate) web: Option<WebLink>,
    /// What the access list allows it.
    pub(crate) permits: Permits,
    /// Whether it spoke Edition 2.5 last, and when.
    pub(crate) spoken: Option<(bool, Duration)>,
    /// Of what it sends and is sent in Edition 2.5.
    pub(crate) translator: Translator,
}

impl GroundStation {
    pub(crate) fn new(config: Cucs, dli: &Dli) -> GroundStation {
        GroundStation {
            profile: StationProfile::of(&config, dli),
            config,
            removed: false,
            peer: None,
            proven: false,
            received: None,
            clock: ClockOffset::default(),
            delay: Delay::Unknown,
            sends_heartbeats: false,
            guard: None,
            used_key: None,
            sealed_under: None,
            web: None,
            permits: Permits::default(),
            spoken: None,
            translator: Translator::default(),
        }
    }

    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    /// Whether it is spoken to in Edition 2.5: as it spoke last, or as the configuration sets.
    pub(crate) fn speaks_ed25(&self) -> bool {
        match self.spoken {
            Some((ed25, _)) => ed25,
            None => self.profile.edition() == Edition::Ed25,
        }
    }

    /// The version by which it calls Edition 2.5, where it speaks that.
    pub(crate) fn ed25_version(&self) -> Option<Version> {
        self.speaks_ed25().then(|| self.translator.version())
    }

    /// What a restart has to know of how it speaks.
    pub(crate) fn shown(&self) -> Shown {
        Shown {
            ed25: self.ed25_version().map(|version| version.text().to_owned()),
            ..self.profile.shown()
        }
    }

    /// How it spoke before a restart: it is answered so, and what comes in its name in another edition is dropped as if it
    /// had spoken just now.
    pub(crate) fn restore(&mut self, now: Duration, shown: &Shown) {
        self.profile.restore(shown);
        let version = shown.ed25.as_deref().and_then(Version::from_text);
        if let Some(version) = version {
            self.translator.call_it(version);
        }
        if version.is_some() || shown.spoken.is_some() {
            self.spoken = Some((version.is_some(), now));
        }
    }

    /// What it may request of a vehicle: what the configuration and the access list allow.
    pub(crate) fn asker(&self, vehicle: Id) -> Asker {
        let has = |key| self.guard.as_ref().is_some_and(|guard| guard.has(key));
        self.asker_for(self.permits.levels(vehicle, has))
    }

    /// What it may request by the message that is handled now: what the key that has sealed that is listed with. One that was replaced
    /// verifies for a day, and its thief must not request by it what is listed under the new one.
    pub(crate) fn sender(&self, vehicle: Id) -> Asker {
        let key = self.sealing_key();
        self.asker_for(self.permits.levels(vehicle, |listed| listed == key))
    }

    /// What it may give up, or hand over, by that message, if it holds it: an entry that has ended keeps nobody from that.
    pub(crate) fn disposes_of(&self, vehicle: Id) -> LoiBitmap {
        self.permits.kept_under(vehicle, self.sealing_key())
    }

    fn sealing_key(&self) -> KeyId {
        let key = self.sealed_under.filter(|_| self.guard.is_some());
        // Without a guard it has no key at all, and no entry is for that.
        key.unwrap_or(KeyId::from_bytes([0; 8]))
    }

    /// What it keeps of a vehicle where it holds it. In the air nothing ends by a clock, or by another guard key.
    pub(crate) fn keeper(&self, vehicle: Id, flies: bool) -> Asker {
        if flies {
            self.asker_for(self.permits.kept(vehicle))
        } else {
            self.asker(vehicle)
        }
    }

    /// Whether the access list allows a message of this group. `held`: it was held until now, and its key is not known.
    pub(crate) fn permitted(
        &self,
        vehicle: Id,
        group: Group,
        flies: bool,
        held: bool,
    ) -> Permitted {
        let key = (!held).then(|| self.sealing_key());
        self.permits.judge(vehicle, group, key, flies)
    }

    fn asker_for(&self, listed: LoiBitmap) -> Asker {
        Asker {
            id: self.config.id,
            authorised: LoiBitmap::from_raw(self.config.loi.0.raw() & listed.raw()),
            may_override: self.config.override_control,
            rank: u16::from(self.config.rank)
                + if self.config.guard.is_some() {
                    GUARDED_RANK
                } else {
                    0
                },
        }
    }

    /// How far its silence has gone.
    pub(crate) fn silence(&self, now: Duration, limits: &crate::config::Authority) -> Silence {
        let Some(silent_s) = self.silent_s(now) else {
            return Silence::None;
        };
        if silent_s >= limits.act_s {
            Silence::Lost
        } else if silent_s >= limits.offer_s {
            Silence::Offered
        } else if silent_s >= limits.warn_s {
            Silence::Warned
        } else {
            Silence::None
        }
    }

    /// When its silence is another than `known`, if nothing more comes of it.
    pub(crate) fn silence_changes_at(
        &self,
        known: Silence,
        now: Duration,
        limits: &crate::config::Authority,
    ) -> Option<Duration> {
        let received = self.received.filter(|_| self.sends_heartbeats)?;
        // Something was received since `known`: that its silence ended is due already.
        if self.silence(now, limits) < known {
            return Some(received);
        }
        let limit_s = match known {
            Silence::None => limits.warn_s,
            Silence::Warned => limits.offer_s,
            Silence::Offered => limits.act_s,
            Silence::Lost => return None,
        };
        Some(received + Duration::from_secs_f64(limit_s))
    }

    /// How long nothing of it was received, s; `None` where silence does not count.
    pub(crate) fn silent_s(&self, now: Duration) -> Option<f64> {
        let received = self.received.filter(|_| self.sends_heartbeats)?;
        Some(now.saturating_sub(received).as_secs_f64())
    }
}
