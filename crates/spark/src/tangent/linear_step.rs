//! The equations of one step, linearised at their solution: the matrix of full Newton with all derivatives in it,
//! those by τ = (t, θ), and those at the end of the step.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::derivatives::{Derivatives, NonholonomicDerivatives, take};
use super::super::full_newton::Offsets;
use super::super::stages::Stages;
use super::equations::StepMatrix;
use super::stage_changes::StageSlopes;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern, as_is, combine, copy};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_base::tableau::{self, moments};
use liouville_problem::{
    Mechanical, Model, NonholonomicPatterns, Saddle, SensitivityModel, State, Step, finite,
};
use std::sync::Arc;

/// Derivatives of one step.
#[derive(Clone, Debug)]
pub(super) struct LinearStep<R = f64> {
    pub(super) problem: Arc<Mechanical>,
    pub(super) sensitivity: SensitivityModel<R>,
    offsets: Offsets,
    /// By y, z and λ.
    pub(super) derivatives: Derivatives<R>,
    /// Derivatives by time and parameters at the stages.
    pub(super) p_tau: Matrix<R>,
    pub(super) f_tau: Matrix<R>,
    pub(super) v_tau: Matrix<R>,
    /// Derivatives by time and parameters at the nodes.
    pub(super) g_tau: Matrix<R>,
    pub(super) r_tau: Matrix<R>,
    /// Y_i − y0, and Ŷ_j − y0 below; the differences themselves are roundoff in a very short step.
    pub(super) moved: Matrix<R>,
    moments: Matrix,
    /// Of nonholonomic constraints and their reactions, at the stages.
    pub(super) k_tau: Matrix<R>,
    pub(super) rn_tau: Matrix<R>,
    pub(super) end: End<R>,
    /// Whether those that are constants are there.
    is_ready: bool,
}

/// Derivatives at the end of the step, and the matrix that z1 and λ_k are solved with, where they are not solved for
/// with the stages.
#[derive(Clone, Debug)]
pub(super) struct End<R = f64> {
    pub(super) matrix: Saddle<R>,
    pub(super) p_y: Vec<R>,
    pub(super) p_tau: Vec<R>,
    pub(super) w_y: Vec<R>,
    pub(super) w_tau: Vec<R>,
    pub(super) k_tau: Vec<R>,
}

/// Nonholonomic constraints of a linearised step.
#[derive(Clone, Copy)]
pub(super) struct LinearNonholonomic<'a, R = f64> {
    pub(super) at: &'a NonholonomicPatterns,
    /// b_j P_{i−1}(c_j), s − 1 by s.
    pub(super) moments: &'a Matrix,
    /// Of k_τ and of the derivative of r_n by τ.
    pub(super) by_tau: &'a [Pattern; 2],
    pub(super) of: &'a NonholonomicDerivatives<R>,
    pub(super) k_tau: &'a Matrix<R>,
    pub(super) rn_tau: &'a Matrix<R>,
    pub(super) end_k_tau: &'a [R],
}

impl<R: Real> LinearStep<R> {
    pub(super) fn new(
        (model, tableau): (&Model<R>, &tableau::Spark),
        mut sensitivity: SensitivityModel<R>,
    ) -> Self {
        let problem = &model.problem;
        let (s, nodes) = (tableau.stages, tableau.intervals + 1);
        sensitivity.reserve_batch(s, nodes);
        let at = &sensitivity.problem.patterns;
        let v_tau = at.v_tau.as_ref().map_or(0, Pattern::len);
        let offsets = Offsets::new(problem, tableau);
        let values = |length: usize| vec![R::splat(0.0); length];
        let [k_tau, rn_tau] =
            (at.nonholonomic.as_ref()).map_or([0, 0], |own| [own[0].len(), own[1].len()]);
        Self {
            moved: Matrix::zeros(s + nodes, problem.n),
            moments: moments(&tableau.b, &tableau.c),
            k_tau: Matrix::zeros(s, k_tau),
            rn_tau: Matrix::zeros(s, rn_tau),
            p_tau: Matrix::zeros(s, at.p_tau.len()),
            f_tau: Matrix::zeros(s, at.f_tau.len()),
            v_tau: Matrix::zeros(s, v_tau),
            g_tau: Matrix::zeros(nodes, at.g_tau.len()),
            r_tau: Matrix::zeros(nodes, at.r_tau.len()),
            end: End {
                matrix: Saddle::new(model),
                p_y: values(problem.patterns.p_y.len()),
                p_tau: values(at.p_tau.len()),
                w_y: values(at.w_y.len()),
                w_tau: values(at.w_tau.len()),
                k_tau: values(k_tau),
            },
            derivatives: Derivatives::new(problem, tableau),
            offsets,
            problem: problem.clone(),
            sensitivity,
            is_ready: false,
        }
    }

    /// Linearises a step at the unknowns that solve it, which led to `end`, and factors its matrix.
    pub(super) fn make(
        &mut self,
        (model, stages): (&mut Model<R>, &mut Stages<R>),
        (step, end): (Step<R>, &State<R>),
        matrix: &mut impl StepMatrix<R>,
    ) -> Result<(), StepError> {
        let counted = stages.evaluations;
        stages.evaluate_values(model, step, stages.tableau.intervals);
        stages.evaluations = counted;
        let nodes = stages.tableau.intervals + 1;
        (self.derivatives).evaluate(model, stages, (step, &end.z), nodes)?;
        matrix.factor_at((model, stages), &self.derivatives, step.h)?;
        self.evaluate_stages(stages, step)?;
        self.evaluate_end(model, stages, step, end)?;
        if self.problem.m > 0 {
            self.evaluate_nodes(stages, step)?;
        }
        if self.problem.l() > 0 {
            self.evaluate_nonholonomic(stages, step, end)?;
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.move_points(stages),
        );
        self.is_ready = true;
        Ok(())
    }

    #[inline(always)]
    fn move_points(
        &mut self,
        Stages {
            y,
            tableau,
            displacements,
            ..
        }: &Stages<R>,
    ) {
        let (points, nodes) = self.moved.flat_mut().split_at_mut(y.flat().len());
        combine(points, &tableau.mu_v, displacements, as_is);
        combine(nodes, &tableau.mu_bar, displacements, as_is);
    }

    fn evaluate_stages(&mut self, stages: &Stages<R>, step: Step<R>) -> Result<(), StepError> {
        let times = stages.stage_times(step);
        let (y, z) = (&stages.y, &stages.unknowns.z);
        let out = [&mut self.p_tau, &mut self.f_tau, &mut self.v_tau];
        let points = self.sensitivity.stages((times, [y, z]));
        take(out, times, points, (y.rows(), self.is_ready))
    }

    fn evaluate_nodes(&mut self, stages: &Stages<R>, step: Step<R>) -> Result<(), StepError> {
        let times = stages.node_times(step);
        let (y, lam) = (&stages.node_y, &stages.unknowns.lam);
        let out = [&mut self.g_tau, &mut self.r_tau];
        let points = self.sensitivity.nodes((times, [y, lam]));
        take(out, times, points, (y.rows(), self.is_ready))
    }

    fn evaluate_nonholonomic(
        &mut self,
        stages: &Stages<R>,
        step: Step<R>,
        State { y, z, .. }: &State<R>,
    ) -> Result<(), StepError> {
        let s = stages.tableau.stages;
        for j in 0..s {
            let (t, unknowns) = (stages.stage_time(step, j), &stages.unknowns);
            let point = [stages.y.row(j), unknowns.z.row(j), unknowns.nu.row(j)];
            let Some([k_tau, rn_tau]) = self.sensitivity.nonholonomic(t, point) else {
                return Ok(());
            };
            finite(k_tau, Quantity::Derivative, t)?;
            finite(rn_tau, Quantity::Derivative, t)?;
            copy(self.k_tau.row_mut(j), k_tau);
            copy(self.rn_tau.row_mut(j), rn_tau);
        }
        let t = stages.node_time(step, stages.tableau.intervals);
        let point = [&y[..], z, stages.unknowns.nu.row(s - 1)];
        if let Some([k_tau, _]) = self.sensitivity.nonholonomic(t, point) {
            copy(&mut self.end.k_tau, k_tau);
        }
        finite(&self.end.k_tau, Quantity::Derivative, t)
    }

    fn evaluate_end(
        &mut self,
        model: &mut Model<R>,
        stages: &Stages<R>,
        step: Step<R>,
        State { y, z, .. }: &State<R>,
    ) -> Result<(), StepError> {
        let k = stages.tableau.intervals;
        let (t, lam) = (stages.node_time(step, k), stages.unknowns.lam.row(k));
        let end = &mut self.end;
        if self.problem.l() == 0 {
            end.matrix.update(model, t, y, z, lam)?;
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                copy(&mut end.p_y, model.stage_jacobian(t, y, z)[0]);
                copy(&mut end.p_tau, self.sensitivity.stage(t, y, z)[0]);
                if self.problem.m > 0 {
                    let [w_y, w_tau] = self.sensitivity.hidden(t, y, z);
                    copy(&mut end.w_y, w_y);
                    copy(&mut end.w_tau, w_tau);
                }
            },
        );
        for values in [&end.p_y, &end.p_tau, &end.w_y, &end.w_tau] {
            finite(values, Quantity::Derivative, t)?;
        }
        Ok(())
    }

    /// Derivatives of the stage equations of a step of this size.
    pub(super) fn slopes(&self, h: f64) -> StageSlopes<'_, R> {
        StageSlopes {
            problem: &self.problem,
            of: &self.derivatives,
            h,
        }
    }

    /// The places of equations and unknowns, and how many there are.
    pub(super) fn places(&self) -> (Offsets, usize) {
        (self.offsets, self.offsets.count())
    }

    /// The patterns of nonholonomic constraints and of their derivatives by τ, with the derivatives, if there are any.
    pub(super) fn nonholonomic(&self) -> Option<LinearNonholonomic<'_, R>> {
        Some(LinearNonholonomic {
            at: &self.problem.nonholonomic.as_ref()?.patterns,
            by_tau: self.sensitivity.problem.patterns.nonholonomic.as_ref()?,
            of: self.derivatives.own.as_deref()?,
            moments: &self.moments,
            k_tau: &self.k_tau,
            rn_tau: &self.rn_tau,
            end_k_tau: &self.end.k_tau,
        })
    }
}
