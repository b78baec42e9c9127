//! Substeps: parts of a step, made from its start.

use crate::cancel;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// A stepper that makes parts of a step again, and the states before and after.
pub struct Substep<State: Checkpoint> {
    /// Makes the same steps as the run.
    pub stepper: Box<dyn Stepper<State = State>>,
    /// Where the step begins.
    pub t: f64,
    /// Its length.
    pub h: f64,
    /// t + h, as the run has it.
    pub end: f64,
    /// The state where it begins.
    pub start: State,
    /// The state at the end of the last substep.
    pub state: State,
}

impl<State: Checkpoint + Clone> Substep<State> {
    /// Parts of the steps of `stepper`, whose states have the size of `state`.
    pub fn new(stepper: Box<dyn Stepper<State = State>>, state: &State) -> Self {
        Self {
            stepper,
            t: 0.0,
            h: 0.0,
            end: 0.0,
            start: state.clone(),
            state: state.clone(),
        }
    }

    /// Makes this fraction of the step, which ends at `end` as a whole; returns the time.
    ///
    /// # Errors
    /// The part cannot be made.
    #[allow(clippy::float_cmp)] // 0 and 1 are the ends of the step
    pub fn advance_to_fraction(&mut self, part: f64, end: &State) -> Result<f64, StepError> {
        if part == 1.0 {
            self.state.clone_from(end);
            return Ok(self.end);
        }
        self.advance_by(part * self.h)?;
        Ok(self.t + part * self.h)
    }

    /// Makes a step of this length from where the step begins.
    ///
    /// # Errors
    /// It cannot be made, or the run is cancelled.
    pub fn advance_by(&mut self, length: f64) -> Result<(), StepError> {
        self.state.clone_from(&self.start);
        if length == 0.0 {
            return Ok(());
        }
        if cancel::is_cancelled() {
            return Err(StepError::Interrupted);
        }
        self.stepper.forget();
        self.stepper.step(self.t, length, &mut self.state)?;
        self.stepper.synchronize(&mut self.state)
    }
}
