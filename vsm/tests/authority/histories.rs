//! Long random histories of the authority machine: what the checker proves of every state, here of long ways.

use crate::model::{AuthorityModel, FULL, Input, State};
use proptest::prelude::*;
use stateright::{Expectation, Model as _};

fn go(model: &AuthorityModel, state: &State, choice: usize) -> (Input, Option<State>) {
    let mut inputs = Vec::new();
    model.actions(state, &mut inputs);
    let input = inputs[choice % inputs.len()];
    (input, model.next_state(state, input))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_promise_holds_along_histories_of_five_hundred_inputs(
        choices in prop::collection::vec(any::<usize>(), 500)
    ) {
        let model = AuthorityModel::new(FULL);
        let mut state = model.init_states().remove(0);
        let mut history = Vec::new();
        for choice in choices {
            let (input, next) = go(&model, &state, choice);
            history.push(input);
            let Some(next) = next else { continue };
            state = next;
            for property in model.properties() {
                if property.expectation == Expectation::Always {
                    prop_assert!(
                        (property.condition)(&model, &state),
                        "{}: {:?} {history:?}",
                        property.name,
                        state.flaw
                    );
                }
            }
        }
    }
}
