//! The equations of one step, linearised at their solution: the matrix of full Newton with all derivatives in it,
//! those by τ = (t, θ), and those at the end of the step.

use super::super::Spark;
use super::super::full_newton::{Derivatives, FullNewton, Offsets};
use super::super::stages::Stages;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern, copy};
use liouville_problem::{Kkt, Mechanical, Model, SensitivityModel, State, Step, finite};
use std::sync::Arc;

/// Derivatives of one step.
#[derive(Clone, Debug)]
pub(super) struct LinearStep {
    pub(super) problem: Arc<Mechanical>,
    pub(super) sensitivity: SensitivityModel,
    full: FullNewton,
    /// Of the stages.
    pub(super) p_tau: Matrix,
    pub(super) f_tau: Matrix,
    pub(super) v_tau: Matrix,
    /// Of the nodes.
    pub(super) g_tau: Matrix,
    pub(super) r_tau: Matrix,
    pub(super) end: End,
}

/// Derivatives at the end of the step, and the matrix that z1 and λ_k are solved with.
#[derive(Clone, Debug)]
pub(super) struct End {
    pub(super) matrix: Kkt,
    pub(super) p_y: Vec<f64>,
    pub(super) p_tau: Vec<f64>,
    pub(super) w_y: Vec<f64>,
    pub(super) w_tau: Vec<f64>,
    r_y: Vec<f64>,
}

impl LinearStep {
    pub(super) fn new(spark: &Spark, sensitivity: SensitivityModel) -> Self {
        let (model, stages) = (&spark.model, &spark.stages);
        let (problem, tableau) = (&model.problem, &stages.tableau);
        let at = &sensitivity.problem.patterns;
        let (s, nodes) = (tableau.stages, tableau.intervals + 1);
        let v_tau = at.v_tau.as_ref().map_or(0, Pattern::len);
        let values = |length: usize| vec![0.0; length];
        Self {
            p_tau: Matrix::zeros(s, at.p_tau.len()),
            f_tau: Matrix::zeros(s, at.f_tau.len()),
            v_tau: Matrix::zeros(s, v_tau),
            g_tau: Matrix::zeros(nodes, at.g_tau.len()),
            r_tau: Matrix::zeros(nodes, at.r_tau.len()),
            end: End {
                matrix: Kkt::new(problem),
                p_y: values(problem.patterns.p_y.len()),
                p_tau: values(at.p_tau.len()),
                w_y: values(at.w_y.len()),
                w_tau: values(at.w_tau.len()),
                r_y: values(problem.patterns.r_y.len()),
            },
            full: FullNewton::new(model, stages),
            problem: problem.clone(),
            sensitivity,
        }
    }

    /// Linearises a step at the unknowns that solve it, which led to `end`.
    pub(super) fn make(
        &mut self,
        (model, stages): (&mut Model, &mut Stages),
        step: Step,
        end: &State,
        z1: &mut [f64],
    ) -> Result<(), StepError> {
        let counted = stages.evaluations;
        stages.evaluate_values(model, step, stages.tableau.intervals);
        stages.evaluations = counted;
        self.full.linearize_at(stages, model, z1, step)?;
        self.evaluate_stages(stages, step)?;
        self.evaluate_end(model, stages, step, end)?;
        if self.problem.m > 0 {
            self.evaluate_nodes(stages, step)?;
        }
        Ok(())
    }

    fn evaluate_stages(&mut self, stages: &Stages, step: Step) -> Result<(), StepError> {
        for i in 0..self.p_tau.rows() {
            let (t, y) = (stages.stage_time(step, i), stages.y.row(i));
            let values = self.sensitivity.stage(t, y, stages.unknowns.z.row(i));
            let out = [&mut self.p_tau, &mut self.f_tau, &mut self.v_tau];
            for (out, values) in out.into_iter().zip(values) {
                finite(values, Quantity::Derivative, t)?;
                copy(out.row_mut(i), values);
            }
        }
        Ok(())
    }

    fn evaluate_nodes(&mut self, stages: &Stages, step: Step) -> Result<(), StepError> {
        for j in 0..self.g_tau.rows() {
            let (t, y) = (stages.node_time(step, j), stages.node_y.row(j));
            let values = self.sensitivity.node(t, y, stages.unknowns.lam.row(j));
            for (out, values) in [&mut self.g_tau, &mut self.r_tau].into_iter().zip(values) {
                finite(values, Quantity::Derivative, t)?;
                copy(out.row_mut(j), values);
            }
        }
        Ok(())
    }

    fn evaluate_end(
        &mut self,
        model: &mut Model,
        stages: &Stages,
        step: Step,
        State { y, z, .. }: &State,
    ) -> Result<(), StepError> {
        let k = stages.tableau.intervals;
        let (t, lam) = (stages.node_time(step, k), stages.unknowns.lam.row(k));
        let end = &mut self.end;
        end.matrix.update(model, t, [y, z, lam])?;
        copy(&mut end.p_y, model.stage_jacobian(t, y, z)[0]);
        copy(&mut end.p_tau, self.sensitivity.stage(t, y, z)[0]);
        if self.problem.m > 0 {
            let [w_y, w_tau] = self.sensitivity.hidden(t, y, z);
            copy(&mut end.w_y, w_y);
            copy(&mut end.w_tau, w_tau);
            copy(&mut end.r_y, model.node_jacobian(t, y, lam));
        }
        for values in [&end.p_y, &end.p_tau, &end.w_y, &end.w_tau, &end.r_y] {
            finite(values, Quantity::Derivative, t)?;
        }
        Ok(())
    }

    /// The places of equations and unknowns, and how many there are.
    pub(super) fn places(&self) -> (Offsets, usize) {
        (self.full.offsets(), self.full.order())
    }

    /// Solves the stage equations in place.
    pub(super) fn solve(&mut self, x: &mut [f64]) {
        self.full.solve(x);
    }

    /// Solves the transposed stage equations in place.
    pub(super) fn solve_transposed(&mut self, x: &mut [f64]) {
        self.full.solve_transposed(x);
    }

    /// Derivatives by y and z at the stages, and of g at the nodes.
    pub(super) fn derivatives(&self) -> &Derivatives {
        self.full.derivatives()
    }

    /// `f_y` at the stages.
    pub(super) fn f_y(&self, i: usize) -> &[f64] {
        self.full.f_y().row(i)
    }

    /// `r_λ` at a node.
    pub(super) fn r_lam(&self, j: usize) -> &[f64] {
        self.full.r_lam().row(j)
    }

    /// `r_y` at a node.
    pub(super) fn r_y(&self, j: usize) -> &[f64] {
        let inner = self.full.r_y();
        if j < inner.rows() {
            inner.row(j)
        } else {
            &self.end.r_y
        }
    }
}
