//! Records of a mechanical or semi-explicit system at an output point.

use super::{Dynamics, Model, State, TangentView, model::finite};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// The state that a method carries from step to step.
pub trait Carried {
    /// Coordinates.
    fn y(&self) -> &[f64];

    /// Velocities or momenta, as the system has them.
    fn z(&self) -> &[f64];

    /// The method's accelerations and the work done so far, where it carries them.
    fn accelerations(&self) -> Option<(&[f64], f64)> {
        None
    }

    /// The tangents of y, z and of time, where they are carried.
    fn tangents(&self) -> Option<TangentView<'_>> {
        None
    }
}

impl Carried for State {
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn z(&self) -> &[f64] {
        &self.z
    }
}

/// Records y, z, λ and ν, and z' and a of methods that carry a (where states are wanted); then the work of
/// such methods; then the outputs of a tape (t, y, z) → quantities.
#[derive(Clone, Debug)]
pub struct Observer<M: Dynamics = Model> {
    model: M,
    states: Option<M::Solver>,
    tape: Arc<Tape>,
    registers: Registers<f64>,
}

impl<M: Dynamics> Observer<M> {
    /// An observer of `model`, with or without its states.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, y, z, params).
    pub fn new(model: M, params: &[f64], tape: Arc<Tape>, states: bool) -> Self {
        let [n, l, _] = model.sizes();
        assert_eq!(
            tape.inputs(),
            [1, n, l, params.len()],
            "inputs of an observer"
        );
        let states = states.then(|| model.solver());
        let registers = tape.bind(params);
        Self {
            model,
            states,
            tape,
            registers,
        }
    }

    /// The observed model.
    pub fn model(&self) -> &M {
        &self.model
    }

    /// The tape of the quantities.
    pub fn tape(&self) -> &Arc<Tape> {
        &self.tape
    }

    /// The solver of the multipliers, where states are recorded.
    pub fn solved(&self) -> Option<&M::Solver> {
        self.states.as_ref()
    }

    fn append<S: Carried>(
        &mut self,
        t: f64,
        state: &S,
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        if let Some(states) = &mut self.states {
            self.model.solve_lam(states, t, state.y(), state.z())?;
            row.extend_from_slice(state.y());
            row.extend_from_slice(state.z());
            row.extend_from_slice(M::lam(states));
        }
        if let Some((a, work)) = state.accelerations() {
            if let Some(states) = &self.states {
                row.extend_from_slice(M::z_dot(states));
                row.extend_from_slice(a);
            }
            row.push(work);
        }
        let args: [&[f64]; 3] = [&[t], state.y(), state.z()];
        let values = self.tape.eval(&mut self.registers, args);
        finite(values, Quantity::Observable, t)?;
        row.extend_from_slice(values);
        Ok(())
    }
}

impl Observer {
    /// Forgets what it has observed.
    pub fn reset(&mut self) {
        if let Some(states) = &mut self.states {
            states.reset();
        }
    }
}

impl<S: Carried, M: Dynamics> Observe<S> for Observer<M> {
    fn width(&self, state: &S) -> usize {
        let [n, l, m] = self.model.sizes();
        let accelerations = state.accelerations().map_or(0, |(a, _)| a.len());
        let states = self
            .states
            .as_ref()
            .map_or(0, |_| n + l + m + 2 * accelerations);
        states + usize::from(state.accelerations().is_some()) + self.tape.outputs()
    }

    fn observe(&mut self, t: f64, state: &S, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.append(t, state, row)
            .inspect_err(|_| row.truncate(start))
    }
}

impl<M: Dynamics> Checkpoint for Observer<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        if let Some(states) = &self.states {
            states.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match &mut self.states {
            Some(states) => states.restore(member, saved),
            None => Ok(()),
        }
    }
}

/// Records what [`Observer`] does of several members in lock-step, one after another.
#[derive(Clone, Debug)]
pub struct Observers {
    /// One for each member, or one for all of them.
    each: Vec<Observer>,
    members: usize,
    state: Option<State>,
}

impl Observers {
    /// Observers of the first `members` in lock-step: one for each, or one for all where they have the same
    /// parameters.
    pub fn new(each: Vec<Observer>, members: usize) -> Self {
        Self {
            each,
            members,
            state: None,
        }
    }
}

impl<R: Real> Observe<State<R>> for Observers {
    fn width(&self, state: &State<R>) -> usize {
        let single = State::<f64>::zeros(state.y.len());
        self.members * self.each[0].width(&single)
    }

    fn observe(&mut self, t: f64, state: &State<R>, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        let single = self
            .state
            .get_or_insert_with(|| State::zeros(state.y.len()));
        for member in 0..self.members {
            single.copy_member(0, state, member);
            let place = member.min(self.each.len() - 1);
            if let Err(error) = self.each[place].observe(t, single, row) {
                row.truncate(start);
                return Err(error.of_member(member));
            }
        }
        Ok(())
    }
}

impl Checkpoint for Observers {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.each[member.min(self.each.len() - 1)].save(0, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let place = member.min(self.each.len() - 1);
        self.each[place].restore(0, saved)
    }
}
