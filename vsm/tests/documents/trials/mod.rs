//! The trials, in the order of the messages. Places are metres north and east of home; 11930 steps of an angle are
//! about 110 m of latitude.

macro_rules! rule {
    () => {
        None
    };
    ($rule:literal) => {
        Some($rule)
    };
}

macro_rules! trial {
    ($setup:ident, $before:ident, $act:ident, $base:expr, [$($field:literal = $change:literal $(refused $rule:literal)?),* $(,)?]) => {
        Trial {
            setup: $setup,
            before: $before,
            base: || $base.into(),
            act: $act,
            changes: &[$(crate::scene::Change {
                field: $field,
                value: $change,
                refused: rule!($($rule)?),
            }),*],
        }
    };
}

mod flight;
mod held;
pub(super) mod messages;
pub(super) mod payload;
mod private;
mod requests;
mod routes;
mod scenes;
mod zeroize;

use super::scene::Trial;

/// All of them.
pub(super) fn trials() -> Vec<Trial> {
    let mut all = requests::rights();
    all.extend(flight::flight());
    all.extend(routes::routes());
    all.extend(requests::requests());
    all.extend(payload::payload());
    all.extend(private::private());
    all.extend(held::held());
    all.extend(zeroize::zeroize());
    all
}

/// All trials of a message.
pub(super) fn trials_of(id: u16) -> impl Iterator<Item = Trial> {
    trials()
        .into_iter()
        .filter(move |trial| (trial.base)().id() == id)
}
