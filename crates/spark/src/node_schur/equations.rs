//! The stage equations of one step, corrected by node Schur.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::equations::{CorrectStages, StageEquations};
use super::{NodeSchur, Residuals};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::real::Real;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_problem::{diagnose_rank, finite};

/// The stage equations of one step, solved by node Schur.
type SchurEquations<'a, R> = StageEquations<'a, &'a mut NodeSchur<R>, R>;

impl<R: Real> SchurEquations<'_, R> {
    fn linearize(&mut self) -> Result<(), StepError> {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.linearize_blocks(),
        )
    }

    #[inline(always)]
    fn linearize_blocks(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (nodes, m) = (stages.tableau.intervals, model.problem.m);
        let middle = stages.tableau.stages / 2;
        let t = stages.stage_time(*step, middle);
        solver.mass.update(
            model,
            t,
            stages.y.row(middle),
            stages.unknowns.z.row(middle),
        )?;
        if m == 0 {
            return Ok(());
        }
        let times = stages.node_times(*step);
        let mut blocks = model.nodes_blocks((times, [&stages.node_y, &stages.unknowns.lam]));
        for j in 0..=nodes {
            let t = times.at(j);
            let [g_y, r_lam] = blocks.at(j);
            finite(g_y, Quantity::Derivative, t)?;
            finite(r_lam, Quantity::Derivative, t)?;
            copy(solver.g_y.row_mut(j), g_y);
            copy(solver.r_lam.row_mut(j), r_lam);
        }
        solver.factor().map_err(|_| {
            let (at, g_y) = (&solver.problem.patterns, solver.g_y.row(nodes));
            diagnose_rank(&at.g_y, g_y, StepError::SingularNewton)
        })
    }
}

impl<R: Real> SchurEquations<'_, R> {
    /// Evaluates r_y at the nodes for members whose next correction is the first to be improved.
    #[cold]
    fn evaluate_r_y(&mut self) -> Result<(), StepError> {
        let (stages, reactions) = (&*self.stages, &mut self.solver.reactions);
        let times = stages.node_times(self.step);
        let (y, lam) = (&stages.node_y, &stages.unknowns.lam);
        let mut points = self.model.nodes_jacobian((times, [y, lam]));
        for l in 0..reactions.r_y.rows() {
            let [r_y] = points.at(l);
            finite(r_y, Quantity::Derivative, times.at(l))?;
            for (out, value) in reactions.r_y.row_mut(l).iter_mut().zip(r_y) {
                *out = reactions.is_new.choose(*value, *out);
            }
        }
        Ok(())
    }

    /// Corrects all unknowns; returns the largest dV.
    #[inline(always)]
    fn correct_stages(&mut self) -> R {
        let (solver, stages, h) = (&mut *self.solver, &mut *self.stages, self.step.h);
        let residuals = Residuals {
            momentum: &stages.momentum_residual,
            velocity: &stages.velocity_residual,
            g: &stages.g,
        };
        solver.solve(residuals, h);
        solver.improve(residuals, h);
        let (unknowns, m) = (&mut stages.unknowns, solver.problem.m);
        if m > 0 {
            add_scaled(unknowns.lam.flat_mut(), 1.0 / h, &solver.d_lam);
        }
        add_scaled(unknowns.z.flat_mut(), 1.0, solver.d_z.flat());
        let d_v = if solver.problem.patterns.v_z.is_some() {
            &solver.d_v
        } else {
            &solver.d_z
        };
        add_scaled(unknowns.v.flat_mut(), 1.0, d_v.flat());
        max_norm(d_v.flat())
    }

    /// The size of the multipliers' corrections, which need not show in the velocities where r is not linear.
    #[inline(always)]
    fn multiplier_size(&mut self) -> R {
        let (solver, m) = (&mut *self.solver, self.model.problem.m);
        if self.model.problem.is_linear || m == 0 {
            return R::splat(0.0);
        }
        let corrections = solver.d_lam.chunks_exact(m).enumerate();
        corrections.fold(R::splat(0.0), |size, (l, d_lam)| {
            solver
                .mass
                .velocity_of(solver.r_lam.row(l), d_lam)
                .zip(size, f64::max)
        })
    }
}

impl<R: Real> CorrectStages<R> for SchurEquations<'_, R> {
    fn correct_unknowns(&mut self) -> Result<R, StepError> {
        if !self.is_linearized {
            self.linearize()?;
            self.solver.reactions.restart();
            self.is_linearized = true;
        }
        if self.solver.reactions.is_wanted() {
            self.evaluate_r_y()?;
        }
        let size = dispatch_simd_long::<R, _>(
            self.solver.problem.n,
            #[inline(always)]
            || {
                let size = self.correct_stages();
                let size = size.zip(self.multiplier_size(), f64::max);
                self.stages.relative(size, self.step)
            },
        );
        let tolerance = self.stages.stop.tolerance;
        self.solver.reactions.judge(size, tolerance);
        Ok(size)
    }

    #[inline(always)]
    fn keep_members(&mut self, members: R) {
        if let Some(kept) = &mut self.solver.kept {
            kept.copy_members(&self.stages.unknowns, members);
        }
    }

    #[inline(always)]
    fn put_members_back(&mut self, members: R) {
        if let Some(kept) = &self.solver.kept {
            self.stages.unknowns.copy_members(kept, members);
        }
    }
}
