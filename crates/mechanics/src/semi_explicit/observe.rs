//! What is recorded of a semi-explicit system at an output point.

use super::State;
use crate::problem::finite;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::tape::{Registers, Tape};

/// Records y and z (where states are wanted), then the outputs of a tape (t, y, z) → quantities.
#[derive(Clone, Debug)]
pub struct Observer {
    tape: Tape,
    registers: Registers<f64>,
    has_states: bool,
}

impl Observer {
    /// An observer with or without states.
    ///
    /// # Panics
    /// When `params` has not the size the tape has.
    pub fn new(params: &[f64], tape: Tape, has_states: bool) -> Self {
        Self {
            registers: tape.bind(params),
            tape,
            has_states,
        }
    }
}

impl Observe<State> for Observer {
    fn width(&self, state: &State) -> usize {
        let states = if self.has_states {
            state.y.len() + state.z.len()
        } else {
            0
        };
        states + self.tape.outputs()
    }

    fn observe(&mut self, t: f64, state: &State, row: &mut Vec<f64>) -> Result<(), StepError> {
        let args: [&[f64]; 3] = [&[t], &state.y, &state.z];
        let values = self.tape.eval(&mut self.registers, args);
        finite(values, Quantity::Observable, t)?;
        if self.has_states {
            row.extend_from_slice(&state.y);
            row.extend_from_slice(&state.z);
        }
        row.extend_from_slice(values);
        Ok(())
    }
}

impl Checkpoint for Observer {}
