//! Why something was not passed on, and how often.

/// Why a frame, or what it holds, was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dropped {
    /// It is MAVLink in the clear: never taken, whatever it says.
    Plaintext,
    /// A byte is escaped that never is, or the frame ends within an escape.
    Escape,
    /// It is longer or shorter than its kind.
    Length,
    /// The datagram ends before the frame.
    Truncated,
    /// A kind that is not known.
    Kind,
    /// A frame in the clear that is no KEY_EXCHANGE.
    NotExchange,
    /// A packet, while no key is agreed on.
    NoKey,
    /// A packet of another station, or of this one: reflected.
    Station,
    /// A packet whose counter was accepted before, or is too old to know.
    Replayed,
    /// A packet that was not made under the key, or was changed on its way.
    Forged,
    /// A packet under a key that too many forgeries were tried on.
    Retired,
    /// The inside of a packet that verifies is no sequence of MAVLink frames.
    Inside,
    /// A frame to be sent, while no key is agreed on.
    UnsentNoKey,
    /// A frame to be sent that is not one whole MAVLink 2 frame.
    UnsentShape,
    /// A frame to be sent, while too many wait.
    UnsentFull,
}

impl Dropped {
    const ALL: [(Self, &'static str); 15] = [
        (Self::Plaintext, "plaintext"),
        (Self::Escape, "escape"),
        (Self::Length, "length"),
        (Self::Truncated, "truncated"),
        (Self::Kind, "kind"),
        (Self::NotExchange, "not_exchange"),
        (Self::NoKey, "no_key"),
        (Self::Station, "station"),
        (Self::Replayed, "replayed"),
        (Self::Forged, "forged"),
        (Self::Retired, "retired"),
        (Self::Inside, "inside"),
        (Self::UnsentNoKey, "unsent_no_key"),
        (Self::UnsentShape, "unsent_shape"),
        (Self::UnsentFull, "unsent_full"),
    ];
}

/// Counts of packets and drops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncryptedStats {
    /// Packets sealed.
    pub sealed: u64,
    /// Packets that verified.
    pub opened: u64,
    /// Packets known to be lost: gaps in the counter.
    pub lost: u64,
    /// Packets of the other end that somebody else delivered first, from another address.
    pub copied: u64,
    /// KEY_EXCHANGE frames that passed in the clear, both directions.
    pub clear: u64,
    /// Frames of the radio at this end.
    pub radio: u64,
    dropped: [u64; Dropped::ALL.len()],
}

impl EncryptedStats {
    pub(super) fn drop_one(&mut self, why: Dropped) {
        self.dropped[why as usize] += 1;
    }

    /// How often something was dropped for this reason.
    #[must_use]
    pub fn count_of(&self, why: Dropped) -> u64 {
        self.dropped[why as usize]
    }

    /// Every counter by its name.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let passed = [
            ("sealed", self.sealed),
            ("opened", self.opened),
            ("lost", self.lost),
            ("copied", self.copied),
            ("clear", self.clear),
            ("radio", self.radio),
        ];
        let names = Dropped::ALL.into_iter().map(|(_, name)| name);
        passed.into_iter().chain(names.zip(self.dropped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_its_own_counter_under_its_own_name() {
        for (at, (why, name)) in Dropped::ALL.into_iter().enumerate() {
            assert_eq!(why as usize, at, "{name}");
            let mut stats = EncryptedStats::default();
            stats.drop_one(why);
            let counted: Vec<_> = stats.iter().filter(|&(_, count)| count > 0).collect();
            assert_eq!(counted, [(name, 1)]);
        }
    }
}
