//! What is recorded of a mechanical system at an output point.

use super::{Acceleration, Model, State, model::finite};
use crate::problem::Observe;
use crate::tape::{Registers, Tape};
use crate::trouble::{Quantity, Trouble};

/// Records y, z, λ (where states are wanted), then the outputs of a tape (t, y, z) → quantities.
#[derive(Clone, Debug)]
pub struct Observer {
    model: Model,
    states: Option<Acceleration>,
    tape: Tape,
    registers: Registers<f64>,
}

impl Observer {
    /// An observer of `model`, with or without its states.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, y, z, params).
    pub fn new(model: Model, params: &[f64], tape: Tape, states: bool) -> Self {
        let n = model.problem.n;
        assert_eq!(
            tape.inputs(),
            [1, n, n, params.len()],
            "inputs of an observer"
        );
        let states = states.then(|| Acceleration::new(&model));
        let registers = tape.bind(params);
        Self {
            model,
            states,
            tape,
            registers,
        }
    }
}

impl Observe for Observer {
    type State = State;

    fn width(&self) -> usize {
        let states = 2 * self.model.problem.n + self.model.problem.m;
        self.tape.outputs() + if self.states.is_some() { states } else { 0 }
    }

    fn observe(&mut self, t: f64, state: &State, row: &mut Vec<f64>) -> Result<(), Trouble> {
        let start = row.len();
        if let Some(acceleration) = &mut self.states {
            acceleration.solve(&mut self.model, t, &state.y, &state.z)?;
            row.extend_from_slice(&state.y);
            row.extend_from_slice(&state.z);
            row.extend_from_slice(&acceleration.lam);
        }
        let values = self
            .tape
            .eval(&mut self.registers, [&[t], &state.y, &state.z]);
        if let Err(trouble) = finite(values, Quantity::Observable, t) {
            row.truncate(start);
            return Err(trouble);
        }
        row.extend_from_slice(values);
        Ok(())
    }
}
