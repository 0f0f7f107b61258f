//! The lease as a model: two nodes, an etcd, requests that arrive late or twice, lost answers, crashes, and leases that end
//! at any moment. The checker visits every reachable state.
//!
//! The stored value is a number that each write raises by one: an acknowledged write is lost if a smaller number is stored,
//! or served from, afterwards.

use stateright::{Checker as _, Model, Property};

const NODES: usize = 2;
/// The most values, requests and owners: enough for each order of two owners, a crash, and a repeated request.
const MAX_STORED: u8 = 3;
const MAX_REQUESTS: u8 = 4;
const MAX_OWNERS: u8 = 3;

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct State {
    /// The node that owns the VSM, and the revision that made it the owner.
    owner: Option<(usize, u8)>,
    revision: u8,
    epoch: u8,
    stored: u8,
    /// The request that was applied last.
    last: u8,
    /// How many requests were made.
    made: u8,
    nodes: [Node; NODES],
    /// Requests in transit, perhaps of nodes that have crashed; each may arrive again.
    requests: Vec<Write>,
    /// The largest number that was acknowledged to a station.
    acknowledged: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Node {
    StandsBy,
    Serves {
        created: u8,
        epoch: u8,
        /// What it serves from.
        local: u8,
        /// The part of it that etcd has acknowledged.
        durable: u8,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Write {
    node: usize,
    created: u8,
    value: u8,
    /// Its own number, and the number of the request that must be the last one.
    token: u8,
    behind: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Action {
    /// The owner's lease ends, whether or not the owner notices.
    Expire,
    /// A node that stands by takes the VSM and the stored value.
    TakeOver(usize),
    /// The owner finds its lease ended, and takes the VSM again without reading.
    TakeAgain(usize),
    /// The owner finds another owner, and stops.
    End(usize),
    Crash(usize),
    /// The owner changes something: a request goes out.
    Change(usize),
    /// A request had no answer, so the owner sends another.
    Repeat(usize),
    /// A request arrives, and its answer comes back.
    Answered(Write),
    /// A request arrives and its answer is lost: it will be sent again.
    Unanswered(Write),
}

/// A mistake that the model must find.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flaw {
    None,
    /// A write does not compare the owner.
    Unfenced,
    /// A write does not compare the request before it.
    Unordered,
    /// A write compares the node but not the revision: a request of an earlier ownership is applied.
    ByName,
    /// A node whose lease has ended takes the VSM again without comparing the epoch.
    AgainWithoutEpoch,
    /// A station is answered before etcd has answered.
    AnsweredEarly,
}

struct Lease(Flaw);

impl Model for Lease {
    type State = State;
    type Action = Action;

    fn init_states(&self) -> Vec<State> {
        vec![State {
            owner: None,
            revision: 0,
            epoch: 0,
            stored: 0,
            last: 0,
            made: 0,
            nodes: [Node::StandsBy; NODES],
            requests: vec![],
            acknowledged: 0,
        }]
    }

    fn actions(&self, state: &State, actions: &mut Vec<Action>) {
        if state.owner.is_some() {
            actions.push(Action::Expire);
        }
        for (at, node) in state.nodes.iter().enumerate() {
            match *node {
                Node::StandsBy => actions.push(Action::TakeOver(at)),
                Node::Serves { local, durable, .. } => {
                    actions.extend([Action::TakeAgain(at), Action::End(at), Action::Crash(at)]);
                    // One change at a time: queued changes would only be a longer queue.
                    if local > durable {
                        actions.push(Action::Repeat(at));
                    } else if local < MAX_STORED {
                        actions.push(Action::Change(at));
                    }
                }
            }
        }
        for write in &state.requests {
            actions.extend([Action::Answered(*write), Action::Unanswered(*write)]);
        }
    }

    fn next_state(&self, before: &State, action: Action) -> Option<State> {
        let mut state = before.clone();
        match action {
            Action::Expire => state.owner = None,
            Action::TakeOver(at) => {
                if state.owner.is_some() || state.revision == MAX_OWNERS {
                    return None;
                }
                state.revision += 1;
                state.epoch += 1;
                state.owner = Some((at, state.revision));
                state.nodes[at] = Node::Serves {
                    created: state.revision,
                    epoch: state.epoch,
                    local: state.stored,
                    durable: state.stored,
                };
            }
            Action::TakeAgain(at) => {
                let Node::Serves { created, epoch, .. } = &mut state.nodes[at] else {
                    return None;
                };
                let same = *epoch == state.epoch || self.0 == Flaw::AgainWithoutEpoch;
                if state.owner.is_some() || !same || state.revision == MAX_OWNERS {
                    return None;
                }
                state.revision += 1;
                *created = state.revision;
                state.owner = Some((at, state.revision));
            }
            Action::End(at) => {
                let Node::Serves { epoch, .. } = state.nodes[at] else {
                    return None;
                };
                if epoch == state.epoch {
                    return None;
                }
                state.nodes[at] = Node::StandsBy;
            }
            Action::Crash(at) => {
                // Its requests may still arrive.
                state.nodes[at] = Node::StandsBy;
            }
            Action::Change(at) | Action::Repeat(at) => {
                let Node::Serves { created, local, .. } = &mut state.nodes[at] else {
                    return None;
                };
                if state.made == MAX_REQUESTS {
                    return None;
                }
                if let Action::Change(_) = action {
                    *local += 1;
                }
                state.made += 1;
                let write = Write {
                    node: at,
                    created: *created,
                    value: *local,
                    token: state.made,
                    behind: state.last,
                };
                if self.0 == Flaw::AnsweredEarly {
                    state.acknowledged = state.acknowledged.max(write.value);
                }
                state.requests.push(write);
            }
            Action::Answered(write) | Action::Unanswered(write) => {
                let owned = match (self.0, state.owner) {
                    (Flaw::Unfenced, _) => true,
                    (Flaw::ByName, Some((node, _))) => node == write.node,
                    (_, owner) => owner == Some((write.node, write.created)),
                };
                let in_order = state.last == write.behind || self.0 == Flaw::Unordered;
                if owned && in_order {
                    state.stored = write.value;
                    state.last = write.token;
                }
                // A request applied earlier is found to be the last one.
                let applied = state.last == write.token;
                if let Action::Unanswered(_) = action {
                    return (state != *before).then_some(state);
                }
                state.requests.retain(|one| *one != write);
                if let Node::Serves {
                    created, durable, ..
                } = &mut state.nodes[write.node]
                    && *created == write.created
                    && applied
                {
                    *durable = (*durable).max(write.value);
                    state.acknowledged = state.acknowledged.max(write.value);
                }
            }
        }
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Lease>> {
        vec![
            Property::always("what was answered is stored", |_, state: &State| {
                state.stored >= state.acknowledged
            }),
            Property::always("the owner serves what was answered", |_, state: &State| {
                let serves = |(at, created): (usize, u8)| match state.nodes[at] {
                    Node::Serves {
                        created: own,
                        local,
                        ..
                    } if own == created => local >= state.acknowledged,
                    _ => true,
                };
                state.owner.is_none_or(serves)
            }),
            Property::sometimes("two nodes have served", |_, state: &State| {
                state.epoch > 1 && state.acknowledged > 1
            }),
            Property::sometimes(
                "a lease that had ended is taken again",
                |_, state: &State| state.revision > state.epoch && state.acknowledged > 0,
            ),
        ]
    }
}

#[test]
fn whatever_ends_and_arrives_late_what_was_answered_is_stored_and_served() {
    let checked = Lease(Flaw::None).checker().spawn_bfs().join();
    checked.assert_properties();
    assert!(
        checked.unique_state_count() > 1_000,
        "{}",
        checked.unique_state_count()
    );
}

#[test]
fn each_mistake_that_is_planted_is_found() {
    for flaw in [
        Flaw::Unfenced,
        Flaw::Unordered,
        Flaw::ByName,
        Flaw::AgainWithoutEpoch,
        Flaw::AnsweredEarly,
    ] {
        let checked = Lease(flaw).checker().spawn_bfs().join();
        let found = [
            "what was answered is stored",
            "the owner serves what was answered",
        ];
        let found = found.iter().any(|name| checked.discovery(name).is_some());
        assert!(found, "{flaw:?}");
    }
}
