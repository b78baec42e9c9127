//! Errors of the steps, in units of a tolerance.

use super::Spark;
use liouville_base::error::StepError;
use liouville_base::method::{Estimating, Tolerance};
use liouville_problem::{Estimate, State};

impl Spark {
    /// The same, with errors estimated in units of a tolerance.
    #[must_use]
    pub fn estimating(mut self, tolerance: Tolerance) -> Self {
        let estimate = Estimate::new(&self.tableau, tolerance);
        self.estimate = Some(Box::new(estimate));
        self
    }

    /// The same, where a step that only continuation might solve is refused, to be made shorter.
    #[must_use]
    pub fn shortened(mut self) -> Self {
        self.is_shortened = true;
        self
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance.
    ///
    /// # Errors
    /// The acceleration cannot be solved for.
    pub fn first_step(&mut self, t: f64, state: &State, span: f64) -> Result<f64, StepError> {
        let longest = span.abs() / 100.0;
        let Some(estimate) = &self.estimate else {
            return Ok(longest);
        };
        let acceleration = self.predictor.acceleration(&mut self.model, t, state)?;
        Ok(estimate
            .tolerance
            .first_step(&state.y, [acceleration; 2], span))
    }
}

impl Estimating for Spark {
    fn error(&self) -> f64 {
        self.estimate.as_ref().map_or(f64::INFINITY, |x| x.error())
    }

    fn error_order(&self) -> f64 {
        self.estimate.as_ref().map_or(1.0, |x| x.order())
    }

    fn undo(&mut self, state: &mut State) {
        if let Some(estimate) = &self.estimate {
            estimate.undo(state);
            self.predictor.undo();
        }
    }
}
