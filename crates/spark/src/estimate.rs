//! Errors of the steps, in units of a tolerance.

use super::Spark;
use super::kinks::{self, Kinks};
use liouville_base::error::StepError;
use liouville_base::method::{Estimating, Tolerance};
use liouville_problem::{Estimate, State};

impl Spark {
    /// The same, with errors estimated in units of a tolerance.
    #[must_use]
    pub fn estimating(mut self, tolerance: Tolerance) -> Self {
        let estimate = Estimate::new(&self.tableau, tolerance);
        self.estimate = Some(Box::new(estimate));
        self.kinks = Kinks::new(&self.model, &self.tableau);
        self
    }

    /// The same, where a step that only continuation might solve is refused, to be made shorter.
    #[must_use]
    pub fn shortened(mut self) -> Self {
        self.is_shortened = true;
        self
    }

    /// Estimates the error of the step from t that led to `state`, if there is an estimate.
    pub(super) fn measure(&mut self, (t, h): (f64, f64), state: &State) {
        let Some(estimate) = &mut self.estimate else {
            return;
        };
        estimate.measure(self.predictor.velocities(), h, state);
        self.kinks.begin();
        if estimate.error() > 1.0 {
            return;
        }
        let (ends, off) = ([estimate.before(state), state], estimate.off());
        let solved_by = (&mut self.model, &mut self.predictor);
        let unseen = self
            .kinks
            .error(solved_by, (t, h), ends, (off, &estimate.tolerance));
        // below the tolerance a kink leaves the steps as they are
        if unseen > 1.0 {
            estimate.raise(unseen, kinks::ORDER);
        }
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
            self.kinks.undo();
        }
    }
}
