//! What is integrated, read-only: a user's system as tapes and patterns.

pub mod mechanical;
pub mod polynomial;
pub mod quantum;
pub mod semi_explicit;

use crate::memory::Memory;
use crate::trouble::Trouble;

/// Turns a state into the numbers a run keeps of it.
pub trait Observe<State>: Memory + Send {
    /// How many numbers a row has for a state like this.
    fn width(&self, state: &State) -> usize;

    /// Appends the row of `state` at time `t`: most append one, some as many as have come since the last
    /// state. On failure, nothing.
    ///
    /// # Errors
    /// A quantity that is not finite, or multipliers that cannot be solved for.
    fn observe(&mut self, t: f64, state: &State, row: &mut Vec<f64>) -> Result<(), Trouble>;
}

/// Tells how long steps should be, by a positive function s of time and state.
pub trait Monitor<State>: Memory + Send {
    /// (ds/dt)/s along the motion.
    ///
    /// # Errors
    /// s is not positive, or a value is not finite.
    fn rate(&mut self, t: f64, state: &State) -> Result<f64, Trouble>;
}
