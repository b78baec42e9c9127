//! The Newton matrix of a step, block by block; see the module above for the equations.

use super::{FullEquations, FullNewton};
use liouville_base::error::StepError;
use liouville_problem::{diagnose_rank, diagnose_rank_all};

impl FullEquations<'_> {
    /// Makes the matrix at the present unknowns, and factors it.
    pub(super) fn linearize(&mut self) -> Result<(), StepError> {
        let (solver, at) = (&mut *self.solver.newton, (self.step, &*self.solver.z1));
        let nodes = solver.of.offsets.nodes;
        (solver.derivatives).evaluate(self.model, self.stages, at, nodes)?;
        if !self.model.problem.is_linear {
            self.update_mass()?;
        }
        let FullNewton {
            of, derivatives, ..
        } = &mut *self.solver.newton;
        let factored = of.factor(derivatives, self.step.h);
        factored.map_err(|_| self.diagnose())
    }

    /// The mass at the end of the step where that is solved for, else in its middle.
    pub(super) fn update_mass(&mut self) -> Result<(), StepError> {
        let (solver, stages) = (&mut *self.solver.newton, &*self.stages);
        let (t, y, z) = if solver.of.blocks.own.is_some() {
            let k = stages.tableau.intervals;
            let t = stages.node_time(self.step, k);
            (t, stages.node_y.row(k), &*self.solver.z1)
        } else {
            let middle = stages.tableau.stages / 2;
            let t = stages.stage_time(self.step, middle);
            (t, stages.y.row(middle), stages.unknowns.z.row(middle))
        };
        solver.mass.update(self.model, t, y, z)
    }

    /// The cause of a singular matrix: dependent constraints, if there are any at the end of the step.
    #[cold]
    fn diagnose(&mut self) -> StepError {
        let problem = self.model.problem.clone();
        if problem.l() > 0
            && let Err(error) = self.update_mass()
        {
            return error;
        }
        let (stages, z1) = (&*self.stages, &*self.solver.z1);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        let nu = stages.unknowns.nu.row(s - 1);
        let k_z = self.model.nonholonomic_blocks(t, y1, z1, nu)[1].to_vec();
        let lam = stages.unknowns.lam.row(k);
        let [g_y, _] = self.model.node_blocks(t, y1, lam);
        if problem.l() > 0 {
            diagnose_rank_all(&problem, &self.solver.newton.mass, g_y, &k_z)
        } else {
            diagnose_rank(&problem.patterns.g_y, g_y, StepError::SingularNewton)
        }
    }
}
