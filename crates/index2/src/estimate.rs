//! Errors of the steps, in units of a tolerance.

use super::Index2;
use crate::semi_explicit::SemiExplicitState;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy};
use liouville_base::method::{Estimating, Tolerance};
use liouville_base::tableau::Spark;
use liouville_problem::{Dynamics, Estimate, StepVelocities};

/// The estimate, and f at the start of the step, V_1..V_s, and f at its end.
#[derive(Clone, Debug)]
pub(super) struct EndVelocities {
    pub(super) estimate: Estimate<SemiExplicitState>,
    velocities: Matrix,
}

impl Index2 {
    /// The same, with errors estimated in units of a tolerance.
    #[must_use]
    pub fn estimating(mut self, tableau: &Spark, tolerance: Tolerance) -> Self {
        self.estimate = Some(Box::new(EndVelocities {
            estimate: Estimate::new(tableau, tolerance),
            velocities: Matrix::zeros(tableau.stages + 2, self.y.len()),
        }));
        self
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance; infinite without one.
    ///
    /// # Errors
    /// The acceleration cannot be solved for.
    pub fn first_step(&mut self, t: f64, state: &SemiExplicitState) -> Result<f64, StepError> {
        let Some(at) = &self.estimate else {
            return Ok(f64::INFINITY);
        };
        let mut solver = self.model.solver();
        self.model.solve(&mut solver, t, &state.y, &state.z)?;
        let tolerance = &at.estimate.tolerance;
        Ok(tolerance.first_step(&state.y, [&solver.y_ddot; 2]))
    }

    /// Keeps the start of a step, and its stages, for the estimate.
    pub(super) fn begin_estimate(&mut self, t: f64, state: &SemiExplicitState) {
        let Some(at) = &mut self.estimate else {
            return;
        };
        at.estimate.keep(state);
        let SemiExplicitState { y, z, .. } = state;
        copy(at.velocities.row_mut(0), self.model.field(t, y, z));
        for i in 0..self.stages.count() {
            copy(at.velocities.row_mut(i + 1), self.stages.v.row(i));
        }
    }

    /// Estimates the error of the step that led to `state`.
    pub(super) fn end_estimate(&mut self, t: f64, h: f64, state: &SemiExplicitState) {
        let Some(at) = &mut self.estimate else {
            return;
        };
        let (last, SemiExplicitState { y, z, .. }) = (self.stages.count() + 1, state);
        copy(at.velocities.row_mut(last), self.model.field(t + h, y, z));
        let velocities = StepVelocities {
            rows: &at.velocities,
            noise: &[],
        };
        at.estimate.measure(velocities, h, state);
    }
}

impl Estimating for Index2 {
    fn error(&self) -> f64 {
        self.estimate
            .as_ref()
            .map_or(f64::INFINITY, |at| at.estimate.error())
    }

    fn error_order(&self) -> f64 {
        self.estimate.as_ref().map_or(1.0, |at| at.estimate.order())
    }

    fn undo(&mut self, state: &mut SemiExplicitState) {
        if let Some(at) = &self.estimate {
            at.estimate.undo(state);
            self.predictor.undo();
        }
    }
}
