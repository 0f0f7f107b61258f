//! The authority machine itself, driven by a model checker through every state that its inputs can lead to.
//!
//! At every state every CUCS may send anything that is in scope, as often as it likes: a datagram that is lost, comes
//! twice, late or in another order is such a history too, so that all of them are covered without a network in the
//! state. Restart, silence, loads and launches come between any two inputs, and where `reloads` is in scope the configuration is read
//! again between any two: a CUCS goes and comes back, another may hold less and more.
//!
//! What keeps the states few, and what each leaves out: how a state was reached is no part of it. Handovers that wait
//! have one order, by their rights. Time stands still but for one step in which all that waits lapses: what a single
//! lapse leaves is what the release of that wish leaves. The silence that is only warned of is none to the machine.
//! The two payload stations are treated alike: one of them is asked for together with control, each by itself.
#![allow(
    dead_code,
    unreachable_pub,
    missing_docs,
    reason = "each test file uses its own part"
)]

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;
use stateright::{Model, Property};
use vsm::session::{
    Access, Answer, Asker, Authority, CONSENT_WITHIN, CONTROL, Change, Circumstances, Decision,
    Ended, Handover, Outcome, Reason, Rights, Silence, Stage, Stations,
};

/// What is tried.
#[derive(Clone, Copy, Debug)]
pub struct Scope {
    /// CUCSs, 1 to 3.
    pub cucs: usize,
    /// Payload stations, 0 to 2.
    pub stations: u8,
    /// Silence and its end.
    pub silence: bool,
    /// Loads of a mission, launches and landings.
    pub phases: bool,
    /// LOI 2 by itself.
    pub monitors: bool,
    /// The configuration is read again: a CUCS goes and comes, another may hold less and more.
    pub reloads: bool,
}

/// The whole of what the properties are about.
pub const FULL: Scope = Scope {
    cucs: 3,
    stations: 2,
    silence: true,
    phases: true,
    monitors: true,
    reloads: false,
};

pub struct AuthorityModel {
    pub scope: Scope,
    roster: Vec<Asker>,
    /// What the configuration can become: as it is, without the last CUCS, and with one that may hold less.
    rosters: Vec<Vec<Asker>>,
    /// What any step did so far, so that a model that does not move cannot pass.
    seen: Seen,
}

impl AuthorityModel {
    pub fn new(scope: Scope) -> AuthorityModel {
        AuthorityModel {
            scope,
            roster: roster(scope.cucs),
            rosters: rosters(scope.cucs),
            seen: Seen::default(),
        }
    }

    /// Panics where something that the scope allows has never happened.
    pub fn assert_moved(&self) {
        let Scope {
            cucs,
            silence,
            phases,
            reloads,
            ..
        } = self.scope;
        let seen = |what: &AtomicBool| what.load(Relaxed);
        assert!(seen(&self.seen.handed_over), "no handover is completed");
        assert!(seen(&self.seen.lapsed), "no handover lapses");
        assert!(
            seen(&self.seen.overridden) || cucs < 2,
            "no override succeeds"
        );
        assert!(
            seen(&self.seen.taken_in_silence) || !silence,
            "the silent never lose to others"
        );
        assert!(
            seen(&self.seen.after_load) || !phases,
            "no handover waits for a load"
        );
        assert!(
            seen(&self.seen.withdrawn) || !reloads,
            "no reload takes anything away"
        );
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct State {
    pub machine: Authority,
    /// Who holds what by the changes alone, as an auditor who sees only the log would know it.
    pub ledger: Vec<Rights>,
    /// Index of the CUCS that loads a mission; the number of CUCSs for the VSM.
    pub loading: Option<usize>,
    pub launch_or_landing: bool,
    /// The configuration, an index of the model's rosters.
    pub roster: usize,
    /// What a step did that it must not.
    pub flaw: Option<&'static str>,
}

/// No part of the state: the same state is one, whatever led to it.
#[derive(Debug, Default)]
struct Seen {
    handed_over: AtomicBool,
    overridden: AtomicBool,
    lapsed: AtomicBool,
    taken_in_silence: AtomicBool,
    after_load: AtomicBool,
    withdrawn: AtomicBool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    Request(usize, Access, Rights),
    /// Message 4 of the first, which names the second.
    Handover(usize, usize, Rights),
    Silence(usize, Silence),
    Loading(Option<usize>),
    LaunchOrLanding(bool),
    Lapse,
    Restart,
    /// The configuration becomes this one.
    Reload(usize),
}

pub fn roster(cucs: usize) -> Vec<Asker> {
    let all = LoiBitmap::from_raw(0x0f);
    let no_loi_5 = LoiBitmap::from_raw(0x07);
    [
        (0xa0, all, false, 1),
        (0xb0, all, true, 2),
        (0xc0, no_loi_5, true, 0),
    ]
    .into_iter()
    .take(cucs)
    .map(|(id, authorised, may_override, rank)| Asker {
        id: Id(id),
        authorised,
        may_override,
        rank,
    })
    .collect()
}

fn rosters(cucs: usize) -> Vec<Vec<Asker>> {
    let all = roster(cucs);
    let without = all[..cucs - 1].to_vec();
    let mut less = all.clone();
    // LOI 2 only.
    less[0].authorised = LoiBitmap::LOI2;
    vec![all, without, less]
}

fn control() -> Rights {
    Rights::of_control(CONTROL)
}

fn station(number: u8) -> Rights {
    Rights::of_stations(Stations::one(number))
}

impl AuthorityModel {
    fn index(&self, id: Id) -> Option<usize> {
        self.roster.iter().position(|asker| asker.id == id)
    }

    /// A CUCS in the configuration of a state; none where that does not list it.
    fn asker(&self, state: &State, index: usize) -> Option<&Asker> {
        let id = self.roster.get(index)?.id;
        self.rosters[state.roster].iter().find(|one| one.id == id)
    }

    fn may_hold(&self, state: &State, index: usize) -> Rights {
        let asker = self.asker(state, index);
        asker.map_or(Rights::NONE, Asker::may_hold)
    }

    /// One input to the machine under test, and what its step must and must not do.
    fn step(&self, last: &State, input: Input) -> State {
        let mut state = last.clone();
        match input {
            Input::Reload(to) => state.roster = to,
            Input::Loading(owner) => state.loading = owner,
            Input::LaunchOrLanding(on) => state.launch_or_landing = on,
            _ => {}
        }
        let (roster, every) = (&self.rosters[state.roster], &self.roster);
        let owner = |index: usize| every.get(index).map_or(Id::NULL, |asker| asker.id);
        let at = Circumstances {
            now: if input == Input::Lapse {
                CONSENT_WITHIN
            } else {
                Duration::ZERO
            },
            roster,
            loading: state.loading.map(owner),
            launch_or_landing: state.launch_or_landing,
        };
        let decision = match input {
            // Who is not listed does not come as far as the machine.
            Input::Request(by, ..) | Input::Handover(by, ..)
                if self.asker(&state, by).is_none() =>
            {
                Decision::default()
            }
            Input::Request(by, access, wanted) => {
                let asker = self.asker(last, by).unwrap_or(&every[by]);
                state.machine.request(&at, asker, access, wanted, true)
            }
            Input::Handover(by, to, wanted) => {
                let asker = self.asker(last, by).unwrap_or(&every[by]);
                state.machine.handover(&at, asker, every[to].id, wanted)
            }
            Input::Silence(of, silence) => state.machine.silence_of(&at, every[of].id, silence),
            Input::Reload(_) => state.machine.reconfigured(&at),
            Input::Restart => {
                // The load dies with the process; what was stored is what there is.
                state.loading = None;
                let at = Circumstances {
                    loading: None,
                    ..at
                };
                state.machine = Authority::restored(&last.machine.record(), at.now, roster);
                state.machine.look_again(&at)
            }
            Input::Lapse | Input::Loading(_) | Input::LaunchOrLanding(_) => {
                state.machine.look_again(&at)
            }
        };
        for change in &decision.changes {
            state.flaw = state.flaw.or(self.flaw_of(last, &state, input, change));
            self.book(&mut state, change);
        }
        let listed = match input {
            Input::Request(by, ..) => self.asker(&state, by).is_some(),
            _ => true,
        };
        if listed {
            state.flaw = state.flaw.or(self.flaw_of_answer(&state, input, &decision));
        }
        self.note(last, &decision);
        state
    }

    /// The ledger is written from the changes alone.
    fn book(&self, state: &mut State, change: &Change) {
        if let Some(from) = change.from.and_then(|id| self.index(id)) {
            if !state.ledger[from].contains(change.lost) {
                state.flaw = Some("something is taken that was not held");
            }
            state.ledger[from] = state.ledger[from].without(change.lost);
        }
        if let Some(to) = change.to.and_then(|id| self.index(id)) {
            if !self.may_hold(state, to).contains(change.gained) {
                state.flaw = Some("more is given than the configuration allows");
            }
            state.ledger[to] = state.ledger[to].with(change.gained);
        }
    }

    /// Each change has its reason: what a CUCS was granted goes only where it let go, was lost, or was overridden.
    fn flaw_of(
        &self,
        last: &State,
        state: &State,
        input: Input,
        change: &Change,
    ) -> Option<&'static str> {
        let from = change.from.and_then(|id| self.index(id));
        let to = change.to.and_then(|id| self.index(id));
        let passes = from.is_some() && to.is_some();
        let control = !change.lost.control().is_empty() || !change.gained.control().is_empty();
        if control && to.is_some() && state.loading.is_some_and(|owner| Some(owner) != to)
            // A further level for who controls already is no transfer.
            && last.machine.controller() != change.to
        {
            return Some("control passes to another while a mission is loaded");
        }
        if control && passes && state.launch_or_landing && change.why != Reason::Overridden {
            return Some("control is taken during launch or landing without override");
        }
        let silence = |of: usize| last.machine.silence(self.roster[of].id);
        let fits = match change.why {
            Reason::Requested => from.is_none(),
            Reason::Released => {
                matches!(input, Input::Request(by, Access::Release, _) if Some(by) == from)
            }
            // What the new configuration does not allow, and no more.
            Reason::Withdrawn => {
                matches!(input, Input::Reload(_))
                    && to.is_none()
                    && from
                        .is_some_and(|from| change.lost.both(self.may_hold(state, from)).is_empty())
            }
            Reason::Lost => matches!(input, Input::Silence(of, Silence::Lost) if Some(of) == from),
            Reason::OfferedInSilence => from.is_some_and(|from| {
                silence(from) >= Silence::Offered
                    || matches!(input, Input::Silence(of, Silence::Offered) if of == from)
                    || self.was_decided(last, from, to, Reason::OfferedInSilence)
            }),
            Reason::Controller => {
                matches!(input, Input::Request(by, ..) if Some(by) == to)
                    && !control
                    && state.machine.controller() == change.to
            }
            Reason::Overridden => from.is_some_and(|from| {
                let ranks = &self.roster;
                to.is_some_and(|to| ranks[to].may_override && ranks[to].rank >= ranks[from].rank)
                    && (matches!(input, Input::Request(by, Access::Override, _) if Some(by) == to)
                        || self.was_decided(last, from, to, Reason::Overridden))
            }),
            Reason::HandedOver => from
                .zip(to)
                .is_some_and(|(from, to)| self.both_agreed(last, input, from, to)),
        };
        (!fits).then_some("rights change hands without a reason")
    }

    fn was_decided(&self, last: &State, from: usize, to: Option<usize>, why: Reason) -> bool {
        last.machine.pending().iter().any(|handover| {
            handover.stage == Stage::Load(why)
                && handover.from.and_then(|id| self.index(id)) == Some(from)
                && self.index(handover.to) == to
        })
    }

    /// Holder and acquirer have both agreed: one now, the other before.
    fn both_agreed(&self, last: &State, input: Input, from: usize, to: usize) -> bool {
        let between = |stage: fn(&Stage) -> bool| {
            last.machine.pending().iter().any(|handover| {
                handover.from.and_then(|id| self.index(id)) == Some(from)
                    && self.index(handover.to) == Some(to)
                    && stage(&handover.stage)
            })
        };
        match input {
            Input::Handover(by, named, _) if by == from && named == to => {
                between(|stage| matches!(stage, Stage::Consent(_)))
            }
            Input::Handover(by, named, _) if by == to && named == to => {
                between(|stage| matches!(stage, Stage::Acceptance(_)))
            }
            Input::Request(by, Access::Control | Access::Override, _) if by == to => {
                between(|stage| matches!(stage, Stage::Acceptance(_)))
            }
            _ => self.was_decided(last, from, Some(to), Reason::HandedOver),
        }
    }

    fn flaw_of_answer(
        &self,
        state: &State,
        input: Input,
        decision: &Decision,
    ) -> Option<&'static str> {
        match (input, &decision.answer) {
            (Input::Request(by, Access::Control | Access::Override, wanted), Answer::Granted) => {
                (!state.ledger[by].contains(wanted)).then_some("reported as granted, but not held")
            }
            (Input::Request(_, Access::Release, _), answer) if *answer != Answer::Granted => {
                Some("a release is not granted")
            }
            (Input::Request(by, Access::Release, wanted), _) => {
                let left = state.ledger[by].both(wanted);
                let left = if wanted.is_empty() {
                    state.ledger[by]
                } else {
                    left
                };
                (!left.is_empty()).then_some("something is left of what was released")
            }
            _ => None,
        }
    }

    fn note(&self, last: &State, decision: &Decision) {
        let waited = |handover: &Handover| handover.stage == Stage::Load(Reason::HandedOver);
        for change in &decision.changes {
            match change.why {
                Reason::HandedOver if last.machine.pending().iter().any(waited) => {
                    self.seen.after_load.store(true, Relaxed);
                }
                Reason::HandedOver => self.seen.handed_over.store(true, Relaxed),
                Reason::Overridden => self.seen.overridden.store(true, Relaxed),
                Reason::OfferedInSilence => self.seen.taken_in_silence.store(true, Relaxed),
                Reason::Withdrawn => self.seen.withdrawn.store(true, Relaxed),
                _ => {}
            }
        }
        let lapsed = |ended: &Ended| ended.outcome == Outcome::Lapsed;
        if decision.ended.iter().any(lapsed) {
            self.seen.lapsed.store(true, Relaxed);
        }
    }

    /// Whatever order they do it in, all let go, and everything is free.
    fn released_is_free(&self, state: &State) -> bool {
        let roster = &self.rosters[state.roster];
        let at = Circumstances {
            now: Duration::ZERO,
            roster,
            loading: state
                .loading
                .and_then(|index| roster.get(index))
                .map(|asker| asker.id),
            launch_or_landing: state.launch_or_landing,
        };
        let orders: &[[usize; 3]] = &[[0, 1, 2], [2, 1, 0], [1, 2, 0]];
        orders.iter().all(|order| {
            let mut machine = state.machine.clone();
            for asker in order.iter().filter_map(|index| self.asker(state, *index)) {
                machine.request(&at, asker, Access::Release, Rights::NONE, false);
            }
            machine.is_free()
        })
    }
}

impl Model for AuthorityModel {
    type State = State;
    type Action = Input;

    fn init_states(&self) -> Vec<State> {
        vec![State {
            machine: Authority::default(),
            ledger: vec![Rights::NONE; self.scope.cucs],
            loading: None,
            launch_or_landing: false,
            roster: 0,
            flaw: None,
        }]
    }

    fn actions(&self, state: &State, inputs: &mut Vec<Input>) {
        if state.flaw.is_some() {
            return;
        }
        let Scope { cucs, stations, .. } = self.scope;
        for by in 0..cucs {
            let mut parts = vec![control()];
            parts.extend((1..=stations).map(station));
            for part in &parts {
                inputs.push(Input::Request(by, Access::Control, *part));
                inputs.push(Input::Request(by, Access::Override, *part));
                inputs.push(Input::Request(by, Access::Release, *part));
                for to in 0..cucs {
                    inputs.push(Input::Handover(by, to, *part));
                }
            }
            if stations > 0 {
                let both = control().with(station(1));
                inputs.push(Input::Handover(by, by, both));
                inputs.push(Input::Request(by, Access::Control, both));
            }
            inputs.push(Input::Request(by, Access::Release, Rights::NONE));
            inputs.extend((0..cucs).map(|to| Input::Handover(by, to, Rights::NONE)));
            if self.scope.silence {
                let steps = [Silence::None, Silence::Offered, Silence::Lost];
                inputs.extend(steps.map(|silence| Input::Silence(by, silence)));
            }
        }
        if self.scope.monitors {
            inputs.push(Input::Request(cucs - 1, Access::Control, Rights::monitor()));
        }
        if self.scope.phases {
            inputs.push(Input::Loading(None));
            // By any of them, or by the VSM itself.
            inputs.extend((0..=cucs).map(|owner| Input::Loading(Some(owner))));
            inputs.extend([false, true].map(Input::LaunchOrLanding));
        }
        if self.scope.reloads {
            inputs.extend((0..self.rosters.len()).map(Input::Reload));
        }
        inputs.extend([Input::Lapse, Input::Restart]);
    }

    fn next_state(&self, last: &State, input: Input) -> Option<State> {
        let state = self.step(last, input);
        (state != *last).then_some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("at most one holder of each right", |_, state: &State| {
                let held = &state.ledger;
                (0..held.len()).all(|a| (0..a).all(|b| !held[a].collides(held[b])))
            }),
            Property::always(
                "no command without its right at that moment",
                |model: &Self, state: &State| {
                    model.roster.iter().zip(&state.ledger).all(|(asker, held)| {
                        let levels = [
                            LoiBitmap::LOI2,
                            LoiBitmap::LOI3,
                            LoiBitmap::LOI4,
                            LoiBitmap::LOI5,
                        ];
                        levels.iter().all(|level| {
                            state.machine.holds(asker.id, *level) == held.levels().contains(*level)
                        }) && (1..=model.scope.stations).all(|number| {
                            state.machine.holds_station(asker.id, number)
                                == held.contains(station(number))
                        })
                    })
                },
            ),
            Property::always("a granted request is never lost", |_, state: &State| {
                state.flaw.is_none()
            }),
            Property::always(
                "a restart changes nothing",
                |model: &Self, state: &State| {
                    let roster = &model.rosters[state.roster];
                    let again =
                        Authority::restored(&state.machine.record(), Duration::ZERO, roster);
                    let holders = |machine: &Authority| machine.holders().collect::<Vec<_>>();
                    holders(&again) == holders(&state.machine)
                        && again.pending() == state.machine.pending()
                },
            ),
            Property::always("a release leads to free", Self::released_is_free),
            Property::always(
                "nobody holds what the configuration does not allow",
                |model: &Self, state: &State| {
                    let mut held = state.ledger.iter().enumerate();
                    held.all(|(index, held)| model.may_hold(state, index).contains(*held))
                },
            ),
            Property::always("no two handovers are of one right", |_, state: &State| {
                let pending = state.machine.pending();
                (0..pending.len())
                    .all(|a| (0..a).all(|b| !pending[a].rights.collides(pending[b].rights)))
            }),
        ]
    }
}
