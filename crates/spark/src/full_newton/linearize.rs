//! The Newton matrix of a step, block by block; see the module above for the equations.

use super::StageEquations;
use super::blocks::add_to;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::copy;
use liouville_problem::{diagnose_rank, diagnose_rank_all, finite};

impl StageEquations<'_> {
    /// Makes the matrix at the present unknowns, and factors it.
    pub(super) fn linearize(&mut self) -> Result<(), StepError> {
        let (solver, h) = (&mut *self.solver, self.step.h);
        let nodes = solver.offsets.nodes;
        (solver.derivatives).evaluate(self.model, self.stages, self.step, nodes)?;
        solver.matrix.clear();
        (solver.blocks).add_stages(&mut solver.matrix, &solver.derivatives, h);
        self.add_reactions_at_stages()?;
        let solver = &mut *self.solver;
        (solver.blocks).add_nodes(&mut solver.matrix, &solver.derivatives, h);
        self.add_end()?;
        if !self.model.problem.is_linear {
            self.update_mass()?;
        }
        let factored = self.solver.matrix.factor();
        factored.map_err(|_| self.diagnose())
    }

    /// The blocks of k and its reactions at the stages.
    fn add_reactions_at_stages(&mut self) -> Result<(), StepError> {
        let (solver, stages, h) = (&mut *self.solver, &*self.stages, self.step.h);
        let (Some(at), matrix) = (&mut solver.blocks.own, &mut solver.matrix) else {
            return Ok(());
        };
        let unknowns = &stages.unknowns;
        for j in 0..stages.y.rows() {
            let t = stages.stage_time(self.step, j);
            let (y, z, nu) = (stages.y.row(j), unknowns.z.row(j), unknowns.nu.row(j));
            let blocks = self.model.nonholonomic_blocks(t, y, z, nu);
            for values in blocks {
                finite(values, Quantity::Derivative, t)?;
            }
            let [k_y, k_z, r_y, r_z, r_nu] = blocks;
            add_to(matrix, &at.k_z[j], k_z, 1.0);
            add_to(matrix, &at.r_z[j], r_z, -h);
            add_to(matrix, &at.r_nu[j], r_nu, -1.0);
            copy(solver.r_nu.row_mut(j), r_nu);
            copy(at.k_y_values.row_mut(j), k_y);
            copy(at.r_y_values.row_mut(j), r_y);
        }
        at.k_y.add_to(matrix, &at.k_y_values, h);
        at.r_y.add_to(matrix, &at.r_y_values, -h * h);
        Ok(())
    }

    /// The blocks of p, v, w and k at the end, which h b_j dV_j moves.
    fn add_end(&mut self) -> Result<(), StepError> {
        let (solver, stages, z1) = (&mut *self.solver, &*self.stages, &*self.z1);
        let (all, matrix, h) = (&solver.blocks, &mut solver.matrix, self.step.h);
        let Some(at) = &all.own else {
            return Ok(());
        };
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        let mut add = |targets, values: &[f64], factor| {
            add_to(matrix, targets, values, factor);
            finite(values, Quantity::Derivative, t)
        };
        let [p_z, v_z] = self.model.stage_blocks(t, y1, z1);
        add(&all.p_z[s], p_z, 1.0)?;
        add(&all.v_z[s], v_z, -1.0)?;
        add(&all.one[s], &all.ones, 1.0)?;
        let [p_y, ..] = self.model.stage_jacobian(t, y1, z1);
        add(&all.p_y[s], p_y, h)?;
        let nu = stages.unknowns.nu.row(s - 1);
        let [k_y, k_z, ..] = self.model.nonholonomic_blocks(t, y1, z1, nu);
        add(&at.end_k_z, k_z, 1.0)?;
        add(&at.end_k_y, k_y, h)?;
        add(&at.end_w_y, self.model.hidden_jacobian(t, y1, z1), h)?;
        let lam = stages.unknowns.lam.row(k);
        let [g_y, _] = self.model.node_blocks(t, y1, lam);
        add(&at.end_g_y, g_y, 1.0)
    }

    /// The mass at the end of the step where that is solved for, else in its middle.
    fn update_mass(&mut self) -> Result<(), StepError> {
        let (solver, stages) = (&mut *self.solver, &*self.stages);
        let (t, y, z) = if solver.blocks.own.is_some() {
            let k = stages.tableau.intervals;
            let t = stages.node_time(self.step, k);
            (t, stages.node_y.row(k), &*self.z1)
        } else {
            let middle = stages.tableau.stages / 2;
            let t = stages.stage_time(self.step, middle);
            (t, stages.y.row(middle), stages.unknowns.z.row(middle))
        };
        solver.mass.update(self.model, t, y, z)
    }

    /// What makes the matrix singular: dependent constraints, if there are any at the end of the step.
    #[cold]
    fn diagnose(&mut self) -> StepError {
        let problem = self.model.problem.clone();
        if problem.l() > 0
            && let Err(error) = self.update_mass()
        {
            return error;
        }
        let (stages, z1) = (&*self.stages, &*self.z1);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        let nu = stages.unknowns.nu.row(s - 1);
        let k_z = self.model.nonholonomic_blocks(t, y1, z1, nu)[1].to_vec();
        let lam = stages.unknowns.lam.row(k);
        let [g_y, _] = self.model.node_blocks(t, y1, lam);
        if problem.l() > 0 {
            diagnose_rank_all(&problem, &self.solver.mass, g_y, &k_z)
        } else {
            diagnose_rank(&problem.patterns.g_y, g_y, StepError::SingularNewton)
        }
    }
}
