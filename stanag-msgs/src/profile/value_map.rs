//! Values of one byte that a peer numbers otherwise.

use crate::codec::{Reader, Writer};
use crate::scalar::Field;

/// From the wire, or to it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    In,
    Out,
}

/// Pairs of values, ours and the wire's, made whole: values that one side only uses are paired
/// with one another, so that nothing is lost and nothing means two things.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueMap {
    pairs: [(u8, u8); Self::MOST],
}

impl ValueMap {
    const MOST: usize = 6;
    /// Every value is itself.
    pub(super) const SAME: Self = Self {
        pairs: [(0, 0); Self::MOST],
    };

    /// `None` unless `wire` names as many different values as `ours`.
    pub(super) fn parse(ours: &str, wire: &str) -> Option<Self> {
        let read = |text: &str| -> Option<Vec<u8>> {
            text.split(',')
                .map(|value| value.trim().parse().ok())
                .collect()
        };
        let (ours, wire) = (read(ours)?, read(wire)?);
        let twice = wire
            .iter()
            .enumerate()
            .any(|(index, value)| wire[..index].contains(value));
        if twice || ours.len() != wire.len() || 2 * ours.len() > Self::MOST {
            return None;
        }
        if ours == wire {
            return Some(Self::SAME);
        }
        let only_wire = wire.iter().filter(|value| !ours.contains(value));
        let only_ours = ours.iter().filter(|value| !wire.contains(value));
        let named = ours.iter().zip(&wire);
        let mut pairs = [(ours[0], wire[0]); Self::MOST];
        for (pair, (&ours, &wire)) in pairs.iter_mut().zip(named.chain(only_wire.zip(only_ours))) {
            *pair = (ours, wire);
        }
        Some(Self { pairs })
    }

    /// Translates a field of one byte.
    pub(super) fn translate<T: Field>(&self, field: &mut Option<T>, way: Way) {
        let Some(value) = field else { return };
        let mut byte = [0];
        if value.write(&mut Writer::new(&mut byte)).is_ok() {
            byte[0] = self.apply(byte[0], way);
            *field = T::read(&mut Reader::new(&byte)).ok();
        }
    }

    fn apply(&self, value: u8, way: Way) -> u8 {
        let mut pairs = self.pairs.iter();
        let found = match way {
            Way::Out => pairs.find(|pair| pair.0 == value).map(|pair| pair.1),
            Way::In => pairs.find(|pair| pair.1 == value).map(|pair| pair.0),
        };
        found.unwrap_or(value)
    }
}
