//! The stage equations of a small system, corrected by full Newton with its matrix in registers.

use super::equations::{CorrectStages, StageEquations};
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_problem::Step;
use liouville_small::Small;

impl CorrectStages<f64> for StageEquations<'_, &mut Small<f64>> {
    fn correct_unknowns(&mut self) -> Result<f64, StepError> {
        let (small, stages, Step { t, h, .. }) = (&mut *self.solver, &mut *self.stages, self.step);
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

    /// The matrix of a single stage is symmetric, if the forces have a potential.
    fn corrects_against(&self) -> bool {
        self.stages.tableau.stages == 1 && self.solver.reversed() != 0.0
    }

    fn has_reversed(&mut self, _is_doubtful: bool) -> bool {
        self.solver.reversed() % 2.0 != 0.0
    }
}
