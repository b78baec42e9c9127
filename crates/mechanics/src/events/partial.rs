//! Parts of a step, made once more.

use liouville_base::error::StepError;
use liouville_base::method::Stepper;

/// A stepper that makes parts of a step, and the states before and after.
pub(super) struct PartialStep<S: Stepper> {
    pub(super) stepper: S,
    pub(super) t: f64,
    pub(super) h: f64,
    /// t + h, as the run has it.
    pub(super) end: f64,
    pub(super) start: S::State,
    pub(super) state: S::State,
}

impl<S: Stepper> PartialStep<S>
where
    S::State: Clone,
{
    /// Makes this part of the step, all of which leads to `end`; returns the time.
    #[allow(clippy::float_cmp)] // the ends of a step are its ends
    pub(super) fn go(&mut self, part: f64, end: &S::State) -> Result<f64, StepError> {
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
