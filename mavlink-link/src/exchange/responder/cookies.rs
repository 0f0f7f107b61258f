//! Values that only this process can have given, recently, for something it received; it keeps no state for each.
//!
//! Given for an address they prove that the sender receives there, which is required under load. Given for the number of an
//! order they prove that the order is not older ([`Cookies::of_orders`]).

use core::fmt;
use core::hash::Hash;
use core::time::Duration;

use subtle::ConstantTimeEq as _;
use zeroize::Zeroizing;

use crate::exchange::gate::{Cookie, Gate, Opened, cookie_of};
use crate::exchange::identity::Random;

/// The secret that cookies are made with, and the one before it.
pub(super) struct Cookies {
    /// How long a secret is used; its cookies hold for as long again.
    life: Duration,
    now: Option<(Zeroizing<[u8; 32]>, Duration)>,
    before: Option<(Zeroizing<[u8; 32]>, Duration)>,
}

impl Cookies {
    pub(super) fn of_addresses() -> Self {
        Self::of(Duration::from_secs(120))
    }

    pub(super) fn of_orders() -> Self {
        Self::of(Duration::from_secs(10))
    }

    fn of(life: Duration) -> Self {
        Self {
            life,
            now: None,
            before: None,
        }
    }

    /// The cookie of an address; `None` without random bytes.
    pub(super) fn make<A: Hash>(
        &mut self,
        address: &A,
        now: Duration,
        random: &mut dyn Random,
    ) -> Option<Cookie> {
        let fresh = |(_, since): &(_, Duration)| now.saturating_sub(*since) < self.life;
        if !self.now.as_ref().is_some_and(fresh) {
            let mut secret = Zeroizing::new([0; 32]);
            random.fill(&mut *secret).ok()?;
            // The old secret stays valid for a life, so a cookie does not expire while its answer is on the way.
            self.before = self.now.replace((secret, now));
        }
        let (secret, _) = self.now.as_ref()?;
        Some(cookie_of(secret, address))
    }

    /// Whether the message shows that its sender was recently given the cookie of this address.
    pub(super) fn prove<A: Hash>(
        &self,
        gate: &Gate,
        opened: &Opened,
        address: &A,
        now: Duration,
    ) -> bool {
        opened.has_second()
            && self
                .of_late(address, now)
                .any(|cookie| gate.has_cookie(opened, &cookie))
    }

    /// Whether this cookie was given for this recently.
    pub(super) fn is_of<A: Hash>(&self, cookie: &Cookie, of: &A, now: Duration) -> bool {
        self.of_late(of, now)
            .any(|given| bool::from(given.ct_eq(cookie)))
    }

    /// Whether a cookie given at that time may still hold.
    pub(super) fn holds_since(&self, given: Duration, now: Duration) -> bool {
        now.saturating_sub(given) < self.life * 2
    }

    fn of_late<A: Hash>(&self, of: &A, now: Duration) -> impl Iterator<Item = Cookie> {
        let lately = move |(_, since): &&(_, Duration)| now.saturating_sub(*since) < self.life * 2;
        let secrets = [&self.now, &self.before].into_iter().flatten();
        let cookie = |(secret, _): &(Zeroizing<[u8; 32]>, _)| cookie_of(secret, of);
        secrets.filter(lately).map(cookie)
    }
}

impl fmt::Debug for Cookies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Cookies(..)")
    }
}
