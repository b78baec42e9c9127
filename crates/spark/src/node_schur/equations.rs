//! The stage equations of one step, corrected by node Schur.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::probe;
use super::super::stages::Stages;
use super::{NodeSchur, Residuals};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy, max_norm};
use liouville_base::newton::{Equations, Stop};
use liouville_base::real::Real;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_problem::{Model, Step, diagnose_rank, finite};

/// The stage equations of one step, solved by node Schur.
pub(crate) struct SchurEquations<'a, R = f64> {
    solver: &'a mut NodeSchur<R>,
    pub(crate) stages: &'a mut Stages<R>,
    model: &'a mut Model<R>,
    pub(crate) step: Step<'a, R>,
    is_linearized: bool,
}

impl<R: Real> NodeSchur<R> {
    /// The equations of one step, still to be linearised.
    pub(crate) fn start<'a>(
        &'a mut self,
        stages: &'a mut Stages<R>,
        model: &'a mut Model<R>,
        step: Step<'a, R>,
    ) -> SchurEquations<'a, R> {
        SchurEquations {
            solver: self,
            stages,
            model,
            step,
            is_linearized: false,
        }
    }
}

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
        let mut blocks = model.nodes_blocks(times, &stages.node_y, &stages.unknowns.lam);
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

    /// What is corrected in the multipliers need not show in the velocities where r is not linear.
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

impl<R: Real> Equations<R> for SchurEquations<'_, R> {
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    #[inline(always)]
    fn scaled_size(&self, size: R) -> R {
        self.stages.scaled_size(size)
    }

    #[inline(always)]
    fn deviation(&self) -> R {
        self.stages.deviation(self.step)
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.stages.is_residual_roundoff(self.model, self.step)
    }

    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        probe::roundoff_floor(self)
    }

    fn correct(&mut self) -> Result<R, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        if !self.is_linearized {
            self.linearize()?;
            self.is_linearized = true;
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
        Ok(size)
    }

    #[inline(always)]
    fn keep(&mut self, members: R) {
        if let Some(kept) = &mut self.solver.kept {
            kept.copy_members(&self.stages.unknowns, members);
        }
    }

    #[inline(always)]
    fn put_back(&mut self, members: R) {
        if let Some(kept) = &self.solver.kept {
            self.stages.unknowns.copy_members(kept, members);
        }
    }
}
