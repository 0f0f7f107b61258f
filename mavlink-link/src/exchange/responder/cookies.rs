//! Proof that a sender receives at its address, asked for under load: nothing is kept for each address.

use core::fmt;
use core::hash::Hash;
use core::time::Duration;

use zeroize::Zeroizing;

use crate::exchange::gate::{Cookie, Gate, Opened, cookie_of};
use crate::exchange::identity::Random;

/// The secret that cookies are made with, and the one before.
#[derive(Default)]
pub(super) struct Cookies {
    now: Option<(Zeroizing<[u8; 32]>, Duration)>,
    before: Option<(Zeroizing<[u8; 32]>, Duration)>,
}

impl Cookies {
    /// The cookie of an address; `None` without random bytes.
    pub(super) fn make<A: Hash>(
        &mut self,
        address: &A,
        now: Duration,
        random: &mut dyn Random,
    ) -> Option<Cookie> {
        let fresh = |(_, since): &(_, Duration)| now.saturating_sub(*since) < LIFE;
        if !self.now.as_ref().is_some_and(fresh) {
            let mut secret = Zeroizing::new([0; 32]);
            random.fill(&mut *secret).ok()?;
            self.before = self.now.replace((secret, now));
        }
        let (secret, _) = self.now.as_ref()?;
        Some(cookie_of(secret, address))
    }

    /// Whether the message shows that its sender was given the cookie of this address lately.
    pub(super) fn prove<A: Hash>(
        &self,
        gate: &Gate,
        opened: &Opened,
        address: &A,
        now: Duration,
    ) -> bool {
        let lately = |(_, since): &&(_, Duration)| now.saturating_sub(*since) < LIFE * 2;
        let secrets = [&self.now, &self.before].into_iter().flatten();
        opened.has_second()
            && secrets
                .filter(lately)
                .any(|(secret, _)| gate.has_cookie(opened, &cookie_of(secret, address)))
    }
}

impl fmt::Debug for Cookies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Cookies(..)")
    }
}

/// How long a secret is used; its cookies hold for as long again.
const LIFE: Duration = Duration::from_secs(120);
