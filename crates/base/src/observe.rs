//! The view of a state that is recorded, and the time scale that chooses steps.

use crate::checkpoint::Checkpoint;
use crate::error::StepError;

/// Turns a state into the numbers a run keeps of it.
pub trait Observe<State>: Checkpoint {
    /// How many numbers a row has for a state like this.
    fn width(&self, state: &State) -> usize;

    /// Appends the row of `state` at time `t`: most append one, some as many as have come since the last
    /// state. On failure, nothing.
    ///
    /// # Errors
    /// A quantity that is not finite, or multipliers that cannot be solved for.
    fn observe(&mut self, t: f64, state: &State, row: &mut Vec<f64>) -> Result<(), StepError>;

    /// Appends the arguments of the equations at a state, whatever rows have: coordinates, velocities and multipliers.
    /// Returns whether the observer knows them.
    ///
    /// # Errors
    /// Multipliers that cannot be solved for.
    fn locate(
        &mut self,
        _t: f64,
        _state: &State,
        _place: &mut Vec<f64>,
    ) -> Result<bool, StepError> {
        Ok(false)
    }

    /// Whether it sees every step, by [`Observe::follow`] where it does not observe.
    fn is_following(&self) -> bool {
        false
    }

    /// Goes on to the state of a step that is not recorded.
    fn follow(&mut self, _t: f64, _state: &State) {}
}

/// A finding about a motion: its kind, and its numbers.
pub type Finding = (&'static str, Vec<f64>);

/// Looks at the states that the steps of a run lead to, whether they are recorded or not.
pub trait Watch<State>: Checkpoint {
    /// Called once after each step: whether its state is to be looked at.
    fn is_due(&mut self, is_last: bool) -> bool;

    /// Looks at the state at a time, to which a step of this size has led, perhaps the last; that of the start has
    /// size zero.
    ///
    /// # Errors
    /// The state is none of the system.
    fn look(&mut self, at: (f64, f64, bool), state: &State) -> Result<(), StepError>;

    /// Goes on from the state after a reset.
    fn restart(&mut self, t: f64, state: &State);

    /// Returns the findings so far, with the place of the member.
    fn found(&self) -> Vec<(usize, Finding)>;
}

/// Tells how long steps should be, by a positive function s of time and state.
pub trait Monitor<State>: Checkpoint {
    /// (ds/dt)/s along the motion.
    ///
    /// # Errors
    /// s is not positive, or a value is not finite.
    fn rate(&mut self, t: f64, state: &State) -> Result<f64, StepError>;
}

/// A monitor s = (c + x)^(−p) of a quantity x ≥ 0 of the state, with numbers c ≥ 0 and p ≥ 0 that are fitted to a motion.
pub trait Fitted<State>: Monitor<State> {
    /// x.
    fn quantity(&mut self, t: f64, state: &State) -> f64;

    /// Takes c and p.
    fn fit(&mut self, offset: f64, power: f64);
}
