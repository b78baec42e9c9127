//! Control of the steps: all of equal size, as long as the estimated errors allow, or by a rule that is
//! symmetric under time reversal.

mod adaptive;
mod between_times;
mod fixed;
mod reversible;
mod time;
mod trial;

pub use adaptive::Adaptive;
pub use between_times::BetweenTimes;
pub use fixed::Fixed;
pub use reversible::Reversible;

use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// The control of the steps of a run, and the stepper that makes them.
///
/// A control owns its stepper, so that each can require the kind it needs: any, one with an error estimate, or a
/// symmetric one. Its checkpoint is that of the stepper, and then its own.
pub trait StepControl<State: Checkpoint>: Checkpoint {
    /// The stepper.
    fn stepper(&self) -> &dyn Stepper<State = State>;

    /// The stepper, to synchronize a state.
    fn stepper_mut(&mut self) -> &mut dyn Stepper<State = State>;

    /// The present time.
    fn time(&self) -> f64;

    /// Whether the end is reached.
    fn is_over(&self) -> bool;

    /// Whether the state after step `n` is recorded, if one in `every` is.
    fn is_due(&self, n: usize, every: usize) -> bool {
        n.is_multiple_of(every)
    }

    /// Makes one step of the preparation before the first step, such as a trial run; returns whether it is complete.
    fn prepare(&mut self, _state: &State) -> bool {
        true
    }

    /// Makes the next step; on failure state and time are as they were.
    ///
    /// # Errors
    /// Why it could not be made.
    fn step(&mut self, state: &mut State) -> Result<(), StepError>;

    /// Makes this part of the next step, or of what is left of it; none where steps are not equal, and are shortened
    /// already. On failure state and time are as they were.
    fn step_part(&mut self, _state: &mut State, _part: f64) -> Option<Result<(), StepError>> {
        None
    }

    /// Goes on from this time within the last step, or at its end, with another state. Called in
    /// runs with events only.
    fn restart(&mut self, _t: f64, _state: &State) {}

    /// Ends the last step earlier, at this time, from which the next one is as short as the first of a run, or goes to
    /// its given end. Called on controls by errors, and on those that repeat their steps, only.
    fn shorten(&mut self, _t: f64) {}

    /// How many steps were rejected.
    fn rejected(&self) -> usize {
        0
    }

    /// The sizes of the steps, where they are not fixed.
    fn sizes(&self) -> Option<StepSizes> {
        None
    }
}

/// Sizes of steps, all positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSizes {
    /// The smallest made so far; infinite before there is one.
    pub smallest: f64,
    /// The largest made so far; zero before there is one.
    pub largest: f64,
    /// The next step from here, forwards or backwards.
    pub next: f64,
}
