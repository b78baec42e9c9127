//! Errors of the steps, in units of a tolerance.

use super::Spark;
use super::kinks::{self, Kinks};
use super::velocity_error::VelocityError;
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
        self.velocity_error = VelocityError::new(self.model.problem.n);
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
        self.velocity_error.begin();
        if estimate.error() > 1.0 {
            return;
        }
        let ends = [estimate.before(state), state];
        let solved_by = (&mut self.model, &mut self.predictor);
        let unseen = self.kinks.error(solved_by, (t, h), ends, estimate);
        let (velocities, kinks, tolerance) = (
            self.predictor.velocities(),
            &self.kinks,
            &estimate.tolerance,
        );
        let (of_velocity, order) = if kinks.are_known() {
            let both = |end, k| {
                let of_v = estimate.defect(velocities, end, k);
                [of_v, kinks.defect(velocities, h, end, k)]
            };
            let y = ends.map(|state| &state.y[..]);
            self.velocity_error
                .measure(velocities, h, (y, tolerance), both)
        } else {
            (0.0, 1.0)
        };
        // below the tolerance a kink leaves the steps as they are
        if unseen > 1.0 {
            estimate.raise(unseen, kinks::ORDER);
        }
        estimate.raise(of_velocity, order);
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
            self.velocity_error.undo();
        }
    }

    fn most_corrections(&self) -> f64 {
        self.stop.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.insists = insists;
    }
}
