//! A semi-explicit system with its parameters bound, and the memory its tapes work in.

use super::{Algebraic, SemiExplicit, SemiExplicitState};
use liouville_base::error::StepError;
use liouville_base::linalg::max_norm;
use liouville_base::tape::Registers;
use std::sync::Arc;

/// A system ready to be evaluated.
#[derive(Clone, Debug)]
pub struct SemiExplicitModel {
    /// The system itself, shared.
    pub problem: Arc<SemiExplicit>,
    field: Registers<f64>,
    field_jacobian: Registers<f64>,
    constraint: Registers<f64>,
    constraint_jacobian: Registers<f64>,
    hidden: Registers<f64>,
    hidden_jacobian: Registers<f64>,
    rates: Registers<f64>,
}

impl SemiExplicitModel {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    pub fn new(problem: Arc<SemiExplicit>, params: &[f64]) -> Self {
        Self {
            field: problem.field.bind(params),
            field_jacobian: problem.field_jacobian.bind(params),
            constraint: problem.constraint.bind(params),
            constraint_jacobian: problem.constraint_jacobian.bind(params),
            hidden: problem.hidden.bind(params),
            hidden_jacobian: problem.hidden_jacobian.bind(params),
            rates: problem.rates.bind(params),
            problem,
        }
    }

    /// f at (t, y, z).
    #[inline]
    pub fn field(&mut self, t: f64, y: &[f64], z: &[f64]) -> &[f64] {
        self.problem.field.eval(&mut self.field, [&[t], y, z])
    }

    /// `f_y` and `f_z` at (t, y, z).
    pub fn field_jacobian(&mut self, t: f64, y: &[f64], z: &[f64]) -> (&[f64], &[f64]) {
        let problem = &self.problem;
        problem
            .field_jacobian
            .eval(&mut self.field_jacobian, [&[t], y, z])
            .split_at(problem.patterns.f_y.len())
    }

    /// k at (t, y).
    #[inline]
    pub fn constraint(&mut self, t: f64, y: &[f64]) -> &[f64] {
        self.problem
            .constraint
            .eval(&mut self.constraint, [&[t], y])
    }

    /// `k_y` at (t, y).
    pub fn constraint_jacobian(&mut self, t: f64, y: &[f64]) -> &[f64] {
        self.problem
            .constraint_jacobian
            .eval(&mut self.constraint_jacobian, [&[t], y])
    }

    /// w = `k_t` + `k_y` f, and f, at (t, y, z).
    pub fn hidden(&mut self, t: f64, y: &[f64], z: &[f64]) -> (&[f64], &[f64]) {
        let problem = &self.problem;
        problem
            .hidden
            .eval(&mut self.hidden, [&[t], y, z])
            .split_at(problem.l)
    }

    /// `w_z` = `k_y` `f_z`, and `f_z`, at (t, y, z).
    pub fn hidden_jacobian(&mut self, t: f64, y: &[f64], z: &[f64]) -> (&[f64], &[f64]) {
        let problem = &self.problem;
        problem
            .hidden_jacobian
            .eval(&mut self.hidden_jacobian, [&[t], y, z])
            .split_at(problem.patterns.w_z.len())
    }

    /// `w_t + w_y f` and `f_t + f_y f` at (t, y, z).
    pub fn rates(&mut self, t: f64, y: &[f64], z: &[f64]) -> (&[f64], &[f64]) {
        let problem = &self.problem;
        problem
            .rates
            .eval(&mut self.rates, [&[t], y, z])
            .split_at(problem.l)
    }

    /// The state at (t, y), its z found near a guess, for steps of about h.
    ///
    /// # Errors
    /// No z is found there.
    pub fn state(
        &mut self,
        t: f64,
        y: &[f64],
        z: &[f64],
        h: f64,
    ) -> Result<SemiExplicitState, StepError> {
        let mut found = z.to_vec();
        let speed = max_norm(y) / h.abs();
        Algebraic::new(self).solve(self, t, y, &mut found, speed)?;
        Ok(SemiExplicitState {
            y: y.to_vec(),
            z: found,
            y_low: vec![0.0; y.len()],
        })
    }
}
