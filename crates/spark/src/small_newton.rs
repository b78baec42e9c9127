//! The stage equations of a small system, corrected by full Newton with its matrix in registers.

use super::probe::{self, AtStages};
use super::stages::Stages;
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_base::newton::{Equations, Stop};
use liouville_problem::{Model, Step};
use liouville_small::Small;

/// All equations of one step, to be solved together.
pub(super) struct SmallNewton<'a> {
    small: &'a mut Small<f64>,
    stages: &'a mut Stages,
    model: &'a mut Model,
    step: Step<'a>,
    is_linearized: bool,
}

impl<'a> SmallNewton<'a> {
    /// The equations of one step, still to be linearised.
    pub(super) fn new(
        small: &'a mut Small<f64>,
        stages: &'a mut Stages,
        model: &'a mut Model,
        step: Step<'a>,
    ) -> Self {
        Self {
            small,
            stages,
            model,
            step,
            is_linearized: false,
        }
    }
}

impl AtStages<f64> for SmallNewton<'_> {
    fn stages(&mut self) -> (&mut Stages, Step<'_>) {
        (self.stages, self.step)
    }
}

impl Equations for SmallNewton<'_> {
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    fn scaled_size(&self, size: f64) -> f64 {
        self.stages.scaled_size(size)
    }

    fn deviation(&self) -> f64 {
        self.stages.deviation(self.step)
    }

    fn refresh(&mut self) {
        self.is_linearized = false;
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.stages.is_residual_roundoff(self.model, self.step)
    }

    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        probe::roundoff_floor(self)
    }

    fn correct(&mut self) -> Result<f64, StepError> {
        let (small, stages, Step { t, h, .. }) = (&mut *self.small, &mut *self.stages, self.step);
        stages.evaluate(self.model, self.step)?;
        let unknowns = &mut stages.unknowns;
        if !self.is_linearized {
            let nodes = [&stages.node_y, &unknowns.lam];
            small.linearize_at((t, h), [&stages.y, &unknowns.z], nodes);
            self.is_linearized = true;
        }
        let residuals = [&stages.momentum_residual, &stages.g];
        let size = small.correct_at(h, residuals, [&mut unknowns.z, &mut unknowns.lam]);
        copy(unknowns.v.flat_mut(), unknowns.z.flat());
        Ok(self.stages.relative(size, self.step))
    }
}
