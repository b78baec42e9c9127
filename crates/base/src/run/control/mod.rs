//! How long each step is: all fixed, as long as the estimated errors allow, or by a rule that time
//! reversal does not see.

mod adaptive;
mod fixed;
mod listed;
mod reversible;
mod time;

pub use adaptive::Adaptive;
pub use fixed::Fixed;
pub use listed::Listed;
pub use reversible::Reversible;

use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// What decides on the steps of a run.
pub trait StepControl<S: Stepper>: Checkpoint + Send {
    /// The present time.
    fn time(&self) -> f64;

    /// Whether the end is reached.
    fn is_over(&self) -> bool;

    /// Whether the state after step `n` is one to keep, if one in `every` is.
    fn is_due(&self, n: usize, every: usize) -> bool {
        n.is_multiple_of(every)
    }

    /// Makes the next step; on failure state and time are as they were.
    ///
    /// # Errors
    /// Why it could not be made.
    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), StepError>;

    /// How many steps were made and thrown away.
    fn rejected(&self) -> usize {
        0
    }

    /// The sizes of its steps, where they are not fixed.
    fn sizes(&self) -> Option<StepSizes> {
        None
    }
}

/// StepSizes of steps, all positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSizes {
    /// The smallest made so far; infinite before there is one.
    pub smallest: f64,
    /// The largest made so far; zero before there is one.
    pub largest: f64,
    /// The one to go on with from here, or back.
    pub next: f64,
}
