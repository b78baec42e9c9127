//! Derivatives of a semi-explicit system by time and parameters, τ = (t, θ), and of the z that its hidden constraint
//! makes of a point:
//!
//!     w_z dz = −w_y dy − w_τ dτ

use super::{SemiExplicit, SemiExplicitModel, check};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, Pattern, copy};
use liouville_base::tape::{Registers, Tape};
use liouville_problem::{Mismatch, finite};
use std::sync::Arc;

/// Tapes and patterns of the derivatives; a tape's last input is always the parameters.
#[derive(Clone, Debug)]
pub struct SemiExplicitSensitivity {
    /// The system itself.
    pub system: Arc<SemiExplicit>,
    /// (t, y, z) → f_τ
    pub field: Tape,
    /// (t, y) → k_τ
    pub constraint: Tape,
    /// (t, y, z) → w_y, w_τ
    pub hidden: Tape,
    /// Where the derivatives are not zero.
    pub patterns: SemiExplicitSensitivityPatterns,
}

/// The sparsity of each derivative.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct SemiExplicitSensitivityPatterns {
    pub f_tau: Pattern,
    pub k_tau: Pattern,
    pub w_y: Pattern,
    pub w_tau: Pattern,
}

impl SemiExplicitSensitivity {
    /// The derivatives, once their parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape or pattern that has not the size the others imply.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (own, at) = (&self.system, &self.patterns);
        let (n, l) = (own.n, own.l);
        let params = own.field.inputs().last().copied().unwrap_or(0);
        let (point, place): (&[usize], &[usize]) = (&[1, n, l, params], &[1, n, params]);
        let of_hidden = at.w_y.len() + at.w_tau.len();
        let tapes = [
            ("field", &self.field, point, at.f_tau.len()),
            ("constraint", &self.constraint, place, at.k_tau.len()),
            ("hidden", &self.hidden, point, of_hidden),
        ];
        for (name, tape, inputs, outputs) in tapes {
            check(name, tape.inputs().len(), inputs.len())?;
            for (found, wanted) in tape.inputs().iter().zip(inputs) {
                check(name, *found, *wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let tau = 1 + params;
        let patterns = [
            ("f_tau", &at.f_tau, (n, tau)),
            ("k_tau", &at.k_tau, (l, tau)),
            ("w_y", &at.w_y, (l, n)),
            ("w_tau", &at.w_tau, (l, tau)),
        ];
        for (name, pattern, (rows, cols)) in patterns {
            check(name, pattern.shape().0, rows)?;
            check(name, pattern.shape().1, cols)?;
        }
        Ok(self)
    }

    /// Number of time and parameters.
    pub fn width(&self) -> usize {
        self.patterns.f_tau.shape().1
    }
}

/// The derivatives ready to be evaluated, and z at a point.
#[derive(Clone, Debug)]
pub struct SemiExplicitSensitivityModel {
    /// The derivatives themselves, shared.
    pub problem: Arc<SemiExplicitSensitivity>,
    field: Registers<f64>,
    constraint: Registers<f64>,
    hidden: Registers<f64>,
    factor: Factor,
    w_y: Vec<f64>,
    w_tau: Vec<f64>,
    right: Vec<f64>,
}

impl SemiExplicitSensitivityModel {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    pub fn new(problem: Arc<SemiExplicitSensitivity>, params: &[f64]) -> Self {
        let at = &problem.patterns;
        Self {
            field: problem.field.bind(params),
            constraint: problem.constraint.bind(params),
            hidden: problem.hidden.bind(params),
            factor: Factor::new(&problem.system.patterns.w_z),
            w_y: vec![0.0; at.w_y.len()],
            w_tau: vec![0.0; at.w_tau.len()],
            right: vec![0.0; problem.system.l],
            problem,
        }
    }

    /// f_τ at (t, y, z).
    pub fn field(&mut self, t: f64, y: &[f64], z: &[f64]) -> &[f64] {
        self.problem.field.eval(&mut self.field, [&[t], y, z])
    }

    /// k_τ at (t, y).
    pub fn constraint(&mut self, t: f64, y: &[f64]) -> &[f64] {
        let tape = &self.problem.constraint;
        tape.eval(&mut self.constraint, [&[t], y])
    }

    /// Linearises the hidden constraint at (t, y, z); returns w_y and w_τ.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular `w_z`.
    pub fn linearize(
        &mut self,
        model: &mut SemiExplicitModel,
        t: f64,
        (y, z): (&[f64], &[f64]),
    ) -> Result<[&[f64]; 2], StepError> {
        let (w_z, _) = model.hidden_jacobian(t, y, z);
        finite(w_z, Quantity::Derivative, t)?;
        let factored = self.factor.factor(&self.problem.system.patterns.w_z, w_z);
        factored.map_err(|singular| StepError::SingularHidden {
            unknown: singular.column,
        })?;
        let values = self.problem.hidden.eval(&mut self.hidden, [&[t], y, z]);
        finite(values, Quantity::Derivative, t)?;
        let (w_y, w_tau) = values.split_at(self.w_y.len());
        copy(&mut self.w_y, w_y);
        copy(&mut self.w_tau, w_tau);
        Ok([&self.w_y, &self.w_tau])
    }

    /// Solves with w_z, where it was made, in place.
    pub(crate) fn solve(&mut self, x: &mut [f64]) {
        self.factor.solve(x);
    }

    /// The same with w_zᵀ.
    pub(crate) fn solve_transposed(&mut self, x: &mut [f64]) {
        self.factor.solve_transposed(x);
    }

    /// Writes dz where the hidden constraint was linearised.
    pub fn push(&mut self, dy: &[f64], tau: &[f64], dz: &mut [f64]) {
        let at = &self.problem.patterns;
        dz.fill(0.0);
        at.w_y.multiply_add(&self.w_y, -1.0, dy, dz);
        at.w_tau.multiply_add(&self.w_tau, -1.0, tau, dz);
        self.factor.solve(dz);
    }

    /// Adds the cotangents of y and τ by those of z.
    pub fn pull(&mut self, of_z: &[f64], of_y: &mut [f64], of_tau: &mut [f64]) {
        let (at, back) = (&self.problem.patterns, &mut self.right);
        copy(back, of_z);
        self.factor.solve_transposed(back);
        at.w_y.multiply_add_transposed(&self.w_y, -1.0, back, of_y);
        let w_tau = &at.w_tau;
        w_tau.multiply_add_transposed(&self.w_tau, -1.0, back, of_tau);
    }
}
