//! Parts of a step, repeated from its start.

use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;

/// A stepper that repeats parts of a step, and the states before and after.
pub(super) struct PartialStep<State: Checkpoint> {
    pub(super) stepper: Box<dyn Stepper<State = State>>,
    pub(super) t: f64,
    pub(super) h: f64,
    /// t + h, as the run has it.
    pub(super) end: f64,
    pub(super) start: State,
    pub(super) state: State,
}

impl<State: Checkpoint + Clone> PartialStep<State> {
    /// Makes this part of the step, all of which leads to `end`; returns the time.
    #[allow(clippy::float_cmp)] // 0 and 1 are the ends of the step
    pub(super) fn go(&mut self, part: f64, end: &State) -> Result<f64, StepError> {
        if part == 1.0 {
            self.state.clone_from(end);
            return Ok(self.end);
        }
        self.state.clone_from(&self.start);
        if part != 0.0 {
            self.stepper.forget();
            self.stepper.step(self.t, part * self.h, &mut self.state)?;
            self.stepper.synchronize(&mut self.state)?;
        }
        Ok(self.t + part * self.h)
    }
}
