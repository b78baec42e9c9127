//! A mechanical system whose velocities and forces do not meet: constant linear p(z) and v(z), forces
//! f(t, y) and ideal reactions, so that
//!
//!     y' = W (p − p_0) + v_0,   p' = f(t, y) − g_yᵀ λ,   0 = g(t, y),   W := v_z p_z⁻¹

use super::model::finite;
use super::{Mechanical, Mismatch, Model, check, cut};
use liouville_base::error::{Quantity, StepError};
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// The tapes of the separable form; a tape's last input is always the parameters.
#[derive(Clone, Debug)]
pub struct Separable {
    /// The same system in the general form.
    pub mechanical: Arc<Mechanical>,
    /// (t, y) → f
    pub force: Tape,
    /// (t, y) → g
    pub constraint: Tape,
    /// (t, y) → `g_y`, `g_t`
    pub gradient: Tape,
}

impl Separable {
    /// The system, once its parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape that has not the size the others imply, or blocks of p and v that are not
    /// constant.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (n, m) = (self.mechanical.n, self.mechanical.m);
        let at = &self.mechanical.patterns;
        let params = self.mechanical.stage.inputs()[3];
        let tapes = [
            ("force", &self.force, n),
            ("constraint", &self.constraint, m),
            ("gradient", &self.gradient, at.g_y.len() + m),
        ];
        for (name, tape, outputs) in tapes {
            check(name, tape.inputs().len(), 3)?;
            for (found, wanted) in tape.inputs().iter().zip([1, n, params]) {
                check(name, *found, wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let blocks = self.mechanical.stage_blocks.len();
        check("constant stage_blocks", blocks, 0)?;
        let entries = at.g_y.entries();
        let descents = entries.windows(2).filter(|pair| pair[0].1 > pair[1].1);
        check("g_y, column by column,", descents.count(), 0)?;
        Ok(self)
    }
}

/// A separable system ready to be evaluated.
#[derive(Clone, Debug)]
pub struct SeparableModel {
    /// The system itself, shared.
    pub problem: Arc<Separable>,
    /// The same in the general form, ready too.
    pub general: Model,
    force: Registers<f64>,
    constraint: Registers<f64>,
    gradient: Registers<f64>,
}

impl SeparableModel {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    pub fn new(problem: Arc<Separable>, params: &[f64]) -> Self {
        Self {
            general: Model::new(problem.mechanical.clone(), params),
            force: problem.force.bind(params),
            constraint: problem.constraint.bind(params),
            gradient: problem.gradient.bind(params),
            problem,
        }
    }

    /// f at (t, y).
    ///
    /// # Errors
    /// It is not finite.
    #[inline]
    pub fn force(&mut self, t: f64, y: &[f64]) -> Result<&[f64], StepError> {
        let values = self.problem.force.eval(&mut self.force, [&[t], y]);
        finite(values, Quantity::Force, t)?;
        Ok(values)
    }

    /// g at (t, y).
    ///
    /// # Errors
    /// It is not finite.
    #[inline]
    pub fn constraint(&mut self, t: f64, y: &[f64]) -> Result<&[f64], StepError> {
        let tape = &self.problem.constraint;
        let values = tape.eval(&mut self.constraint, [&[t], y]);
        finite(values, Quantity::Constraint, t)?;
        Ok(values)
    }

    /// `g_y` and `g_t` at (t, y).
    ///
    /// # Errors
    /// One of them is not finite.
    #[inline]
    pub fn gradient(&mut self, t: f64, y: &[f64]) -> Result<[&[f64]; 2], StepError> {
        let general = &self.problem.mechanical;
        let sizes = [general.patterns.g_y.len(), general.m];
        let values = self.problem.gradient.eval(&mut self.gradient, [&[t], y]);
        finite(values, Quantity::Derivative, t)?;
        Ok(cut(values, sizes))
    }
}
