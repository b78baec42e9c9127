//! A mechanical system as its accelerations see it, where v = z and p is linear in z:
//!
//!     M(t, y) z' = F(t, y, z) + r(t, y, λ),   M := p_z,   F := f − p_t − p_y z

use super::model::finite;
use super::{Mechanical, Mismatch, Model, check, cut};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::Pattern;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// The tapes and patterns of the second-order form; a tape's last input is always the parameters.
#[derive(Clone, Debug)]
pub struct SecondOrder {
    /// The same system in the general form.
    pub mechanical: Arc<Mechanical>,
    /// (t, y, z, u) → F − M u, g, w
    pub residual: Tape,
    /// (t, y, z, u) → M, (F − M u)_y, F_z, w_y
    pub jacobian: Tape,
    /// (t, y, a, λ) → M a − r
    pub reaction: Tape,
    /// (t, y, a, λ) → (M a − r)_y
    pub reaction_jacobian: Tape,
    /// (t, y, z, λ) → the rate at which forces without a potential put energy in.
    pub power: Option<Tape>,
    /// Whether `power` depends on λ.
    pub power_of_lam: bool,
    /// Where the derivatives are not zero.
    pub patterns: SecondOrderPatterns,
}

/// The sparsity of M, (F − M u)_y, F_z, w_y and (M a − r)_y.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct SecondOrderPatterns {
    pub mass: Pattern,
    pub j_y: Pattern,
    pub j_z: Pattern,
    pub w_y: Pattern,
    pub n_y: Pattern,
}

impl SecondOrder {
    /// The system, once its parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape or pattern that has not the size the others imply, a velocity that is not z, or
    /// nonholonomic constraints.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (n, m, at) = (self.mechanical.n, self.mechanical.m, &self.patterns);
        let params = self.mechanical.stage.inputs()[3];
        check(
            "v_z",
            self.mechanical
                .patterns
                .v_z
                .as_ref()
                .map_or(0, Pattern::len),
            0,
        )?;
        check("nonholonomic", self.mechanical.l(), 0)?;
        let tapes = [
            ("residual", &self.residual, n, n + m + m),
            (
                "jacobian",
                &self.jacobian,
                n,
                at.mass.len() + at.j_y.len() + at.j_z.len() + at.w_y.len(),
            ),
            ("reaction", &self.reaction, m, n),
            (
                "reaction_jacobian",
                &self.reaction_jacobian,
                m,
                at.n_y.len(),
            ),
        ];
        let power = self.power.iter().map(|tape| ("power", tape, m, 1));
        for (name, tape, fourth, outputs) in tapes.into_iter().chain(power) {
            check(name, tape.inputs().len(), 5)?;
            for (found, wanted) in tape.inputs().iter().zip([1, n, n, fourth, params]) {
                check(name, *found, wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        for (name, pattern, rows) in [
            ("mass", &at.mass, n),
            ("j_y", &at.j_y, n),
            ("j_z", &at.j_z, n),
            ("w_y", &at.w_y, m),
            ("n_y", &at.n_y, n),
        ] {
            check(name, pattern.shape().0, rows)?;
            check(name, pattern.shape().1, n)?;
        }
        Ok(self)
    }

    /// Whether M depends on parameters alone.
    pub fn has_constant_mass(&self) -> bool {
        self.mechanical.stage_blocks.is_empty()
    }

    /// Whether M, all forces and the constraints are linear in the coordinates, with constant factors.
    pub fn is_affine(&self) -> bool {
        let tapes = [&self.jacobian, &self.mechanical.node_blocks];
        tapes.iter().all(|tape| tape.is_empty()) && self.patterns.n_y.is_empty()
    }
}

/// A second-order system ready to be evaluated.
#[derive(Clone, Debug)]
pub struct SecondOrderModel {
    /// The system itself, shared.
    pub problem: Arc<SecondOrder>,
    /// The same in the general form, ready too.
    pub general: Model,
    residual: Registers<f64>,
    jacobian: Registers<f64>,
    reaction: Registers<f64>,
    reaction_jacobian: Registers<f64>,
    power: Option<Registers<f64>>,
}

impl SecondOrderModel {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    pub fn new(problem: Arc<SecondOrder>, params: &[f64]) -> Self {
        Self {
            general: Model::new(problem.mechanical.clone(), params),
            residual: problem.residual.bind(params),
            jacobian: problem.jacobian.bind(params),
            reaction: problem.reaction.bind(params),
            reaction_jacobian: problem.reaction_jacobian.bind(params),
            power: problem.power.as_ref().map(|tape| tape.bind(params)),
            problem,
        }
    }

    /// F − M u, g, w at (t, y, z).
    ///
    /// # Errors
    /// One of them is not finite.
    pub fn residual(
        &mut self,
        t: f64,
        y: &[f64],
        z: &[f64],
        u: &[f64],
    ) -> Result<[&[f64]; 3], StepError> {
        let (n, m) = (self.problem.mechanical.n, self.problem.mechanical.m);
        let tape = &self.problem.residual;
        let parts = cut(tape.eval(&mut self.residual, [&[t], y, z, u]), [n, m, m]);
        finite(parts[0], Quantity::Force, t)?;
        finite(parts[1], Quantity::Constraint, t)?;
        finite(parts[2], Quantity::Hidden, t)?;
        Ok(parts)
    }

    /// M a − r at (t, y, λ).
    ///
    /// # Errors
    /// It is not finite.
    pub fn reaction(
        &mut self,
        t: f64,
        y: &[f64],
        a: &[f64],
        lam: &[f64],
    ) -> Result<&[f64], StepError> {
        let tape = &self.problem.reaction;
        let values = tape.eval(&mut self.reaction, [&[t], y, a, lam]);
        finite(values, Quantity::Reaction, t)?;
        Ok(values)
    }

    /// M, (F − M u)_y, F_z, w_y at (t, y, z).
    ///
    /// # Errors
    /// One of them is not finite.
    pub fn jacobian(
        &mut self,
        t: f64,
        y: &[f64],
        z: &[f64],
        u: &[f64],
    ) -> Result<[&[f64]; 4], StepError> {
        let at = &self.problem.patterns;
        let sizes = [at.mass.len(), at.j_y.len(), at.j_z.len(), at.w_y.len()];
        let values = self
            .problem
            .jacobian
            .eval(&mut self.jacobian, [&[t], y, z, u]);
        finite(values, Quantity::Derivative, t)?;
        Ok(cut(values, sizes))
    }

    /// g_y, r_λ at (t, y, λ).
    ///
    /// # Errors
    /// One of them is not finite.
    pub fn node_blocks(
        &mut self,
        t: f64,
        y: &[f64],
        lam: &[f64],
    ) -> Result<[&[f64]; 2], StepError> {
        let blocks = self.general.node_blocks(t, y, lam);
        finite(blocks[0], Quantity::Derivative, t)?;
        finite(blocks[1], Quantity::Derivative, t)?;
        Ok(blocks)
    }

    /// (M a − r)_y at (t, y, λ).
    ///
    /// # Errors
    /// It is not finite.
    pub fn reaction_jacobian(
        &mut self,
        t: f64,
        y: &[f64],
        a: &[f64],
        lam: &[f64],
    ) -> Result<&[f64], StepError> {
        let tape = &self.problem.reaction_jacobian;
        let values = tape.eval(&mut self.reaction_jacobian, [&[t], y, a, lam]);
        finite(values, Quantity::Derivative, t)?;
        Ok(values)
    }

    /// The power of the forces without a potential at (t, y, z, λ).
    ///
    /// # Errors
    /// It is not finite.
    pub fn power(&mut self, t: f64, y: &[f64], z: &[f64], lam: &[f64]) -> Result<f64, StepError> {
        let (Some(tape), Some(registers)) = (&self.problem.power, &mut self.power) else {
            return Ok(0.0);
        };
        let values = tape.eval(registers, [&[t], y, z, lam]);
        finite(values, Quantity::Power, t)?;
        Ok(values[0])
    }
}
