//! Active rules: each a scene that the suite plays with the subject.
//!
//! A scene reads like its rule's text. It is given a [`Trial`](crate::bench::trial::Trial), plays, and returns: `Ok`
//! is a pass, a [`Stop`](crate::verdict::Stop) returned by `?` is anything else. To add one: write the function in
//! the file of its group, name it in that file's `SCENES`, and show with a mutant that it can fail.

mod acknowledgement;
mod agreement;
mod alerts;
mod authority;
mod condition;
mod configuration;
mod curves;
mod discovery;
mod edition_25;
mod flight;
mod handover;
mod image;
mod link;
mod load;
mod maneuver;
mod mission;
mod mode;
mod payload;
mod presence;
mod robust;
mod scalar;
mod scene;
mod status;
mod steering;
mod sticks;
mod transfer;
mod vehicles;
mod wrapper;

pub use scene::Scene;

use crate::catalogue::Rule;

/// All scenes.
#[must_use]
pub fn scenes() -> Vec<&'static Scene> {
    [
        wrapper::SCENES,
        discovery::SCENES,
        authority::SCENES,
        presence::SCENES,
        scalar::SCENES,
        acknowledgement::SCENES,
        mission::SCENES,
        transfer::SCENES,
        mode::SCENES,
        flight::SCENES,
        maneuver::SCENES,
        steering::SCENES,
        sticks::SCENES,
        status::SCENES,
        condition::SCENES,
        vehicles::SCENES,
        configuration::SCENES,
        alerts::SCENES,
        handover::SCENES,
        payload::SCENES,
        image::SCENES,
        link::SCENES,
        curves::SCENES,
        load::SCENES,
        robust::SCENES,
        edition_25::SCENES,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// What else is played for a rule once its scene has passed; nothing in Edition 2.5.
pub fn further(rule: &str) -> impl Iterator<Item = &'static Scene> {
    agreement::scenes().filter(move |scene| scene.rule == rule)
}

/// Rules of the catalogue that have neither scene nor judge, with the reason.
pub const WITHOUT_CODE: &[(&str, &str)] = &[(
    "ROUTE-018",
    "needs a means by which a contingency is declared",
)];

/// Rules that name Edition 2.5 and cannot be judged there by playing, with the reason.
const NOT_IN_25: &[(&str, &str)] = &[
    (
        "CURVE-005",
        "the private messages 50001 and 50002 have no form in Edition 2.5, whose private types are 2000 to 2399",
    ),
    (
        "LOAD-001",
        "it counts acknowledgements of 2017, which is #48 there: the suite does not match those of #48",
    ),
    (
        "LOAD-003",
        "it counts acknowledgements of 2017, which is #48 there: the suite does not match those of #48",
    ),
    (
        "MULTI-001",
        "the subject is spoken to at one address: whether a group hears it is not seen",
    ),
];

/// Why a rule cannot be judged in an edition, where it cannot.
#[must_use]
pub fn not_in_edition(rule: &Rule, edition: &str) -> Option<String> {
    if !rule.editions.iter().any(|listed| listed == edition) {
        return Some(format!("is not judged in Edition {edition}"));
    }
    let known = NOT_IN_25.iter().find(|(id, _)| *id == rule.id);
    known
        .filter(|_| edition == "2.5")
        .map(|(_, reason)| (*reason).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Catalogue;

    #[test]
    fn every_scene_and_judge_has_its_rule() {
        let catalogue = Catalogue::embedded();
        let judges = crate::passive::judges();
        let ids = scenes()
            .into_iter()
            .map(|scene| scene.rule)
            .chain(judges.into_iter().map(|judge| judge.rule));
        let known: Vec<_> = scenes().into_iter().map(|scene| scene.rule).collect();
        for scene in agreement::scenes() {
            assert!(
                known.contains(&scene.rule),
                "{} has no scene before its second",
                scene.rule
            );
        }
        for id in ids {
            assert!(catalogue.find(id).is_some(), "{id} is not in the catalogue");
        }
        let mut once: Vec<_> = scenes().into_iter().map(|scene| scene.rule).collect();
        let all = once.len();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), all, "a rule has two scenes");
    }
}
