//! The matrix of every index-1 solve, by its Schur complement:
//!
//!     [ p_z      −r_λ ] [ x ]   [ a ]
//!     [ g_y v_z    0  ] [ μ ] = [ b ],     S = g_y v_z p_z⁻¹ r_λ   (m by m)

use super::model::finite;
use super::{Mechanical, Model};
use crate::linalg::{Factor, Lu, Matrix, Pattern, copy, dependent_rows, max_norm};
use crate::trouble::{Quantity, Trouble};
use std::sync::Arc;

/// `p_z` factored, and `v_z`; made once when both depend on parameters alone.
#[derive(Clone, Debug)]
pub struct Mass {
    problem: Arc<Mechanical>,
    factor: Factor,
    v_z: Option<(Pattern, Vec<f64>)>,
    is_constant: bool,
    is_ready: bool,
    column: Vec<f64>,
    impulse: Vec<f64>,
}

impl Mass {
    /// Memory for the mass of this model.
    pub fn new(model: &Model) -> Self {
        let at = &model.problem.patterns;
        Self {
            problem: model.problem.clone(),
            factor: Factor::new(&at.p_z),
            v_z: at
                .v_z
                .clone()
                .map(|pattern| (pattern.clone(), vec![0.0; pattern.len()])),
            is_constant: model.problem.stage_blocks.is_empty(),
            is_ready: false,
            column: vec![0.0; model.problem.n],
            impulse: vec![0.0; model.problem.n],
        }
    }

    /// Brings the factors to (t, y, z).
    ///
    /// # Errors
    /// [`Trouble::SingularMass`], or a derivative that is not finite.
    pub fn update(
        &mut self,
        model: &mut Model,
        t: f64,
        y: &[f64],
        z: &[f64],
    ) -> Result<(), Trouble> {
        if self.is_ready && self.is_constant {
            return Ok(());
        }
        let [p_z, v_z] = model.stage_blocks(t, y, z);
        finite(p_z, Quantity::Derivative, t)?;
        finite(v_z, Quantity::Derivative, t)?;
        if let Some((_, values)) = &mut self.v_z {
            values.copy_from_slice(v_z);
        }
        self.factor
            .factor(&self.problem.patterns.p_z, p_z)
            .map_err(|singular| Trouble::SingularMass {
                coordinate: singular.column,
            })?;
        self.is_ready = true;
        Ok(())
    }

    /// `x = p_z⁻¹ x`
    #[inline]
    pub fn solve(&mut self, x: &mut [f64]) {
        self.factor.solve(x);
    }

    /// `out += v_z x`
    #[inline]
    pub fn add_velocity(&self, x: &[f64], out: &mut [f64]) {
        match &self.v_z {
            Some((pattern, values)) => pattern.multiply_add(values, 1.0, x, out),
            None => out.iter_mut().zip(x).for_each(|(out, x)| *out += x),
        }
    }

    /// `x = v_z p_z⁻¹ x`
    pub fn solve_velocity(&mut self, x: &mut [f64]) {
        self.factor.solve(x);
        if self.v_z.is_some() {
            copy(&mut self.column, x);
            x.fill(0.0);
            self.add_velocity(&self.column, x);
        }
    }

    /// The largest velocity that the impulse `r_λ dΛ` gives.
    pub fn velocity_of(&mut self, r_lam: &[f64], d_lam: &[f64]) -> f64 {
        let mut velocity = std::mem::take(&mut self.impulse);
        velocity.fill(0.0);
        let pattern = &self.problem.patterns.r_lam;
        pattern.multiply_add(r_lam, 1.0, d_lam, &mut velocity);
        self.solve_velocity(&mut velocity);
        self.impulse = velocity;
        max_norm(&self.impulse)
    }

    /// `(v_z p_z⁻¹ A)ᵀ`, one row for each column of A.
    pub fn compliance(&mut self, pattern: &Pattern, values: &[f64], out: &mut Matrix) {
        out.clear();
        for (&(row, col), value) in pattern.entries().iter().zip(values) {
            out[(col, row)] += value;
        }
        for col in 0..pattern.shape().1 {
            self.solve_velocity(out.row_mut(col));
        }
    }
}

/// `target[row.., col..] += factor * A Cᵀ` for a sparse A and the rows of C.
pub(crate) fn add_product(
    pattern: &Pattern,
    values: &[f64],
    factor: f64,
    rows: &Matrix,
    target: &mut Matrix,
    (row, col): (usize, usize),
) {
    let width = rows.rows();
    for (&(i, j), value) in pattern.entries().iter().zip(values) {
        for (k, out) in target.row_mut(row + i)[col..col + width]
            .iter_mut()
            .enumerate()
        {
            *out += factor * value * rows[(k, j)];
        }
    }
}

/// The constraints whose gradients are dependent, if any are; otherwise `trouble` itself.
pub(crate) fn explain(pattern: &Pattern, g_y: &[f64], trouble: Trouble) -> Trouble {
    let (m, n) = pattern.shape();
    let mut dense = Matrix::zeros(m, n);
    pattern.add_to(g_y, 1.0, &mut dense, 0, 0);
    dependent_rows(dense).map_or(trouble, |constraints| Trouble::Redundant { constraints })
}

/// The saddle-point matrix, factored.
#[derive(Clone, Debug)]
pub struct Saddle {
    /// `p_z` and `v_z`.
    pub mass: Mass,
    compliance: Matrix,
    schur: Lu,
    velocity: Vec<f64>,
    g_y: Vec<f64>,
    r_lam: Vec<f64>,
}

impl Saddle {
    /// Memory for the saddle of this model.
    pub fn new(model: &Model) -> Self {
        let problem = &model.problem;
        Self {
            mass: Mass::new(model),
            compliance: Matrix::zeros(problem.m, problem.n),
            schur: Lu::new(problem.m),
            velocity: vec![0.0; problem.n],
            g_y: vec![0.0; problem.patterns.g_y.len()],
            r_lam: vec![0.0; problem.patterns.r_lam.len()],
        }
    }

    /// `g_y` it was last factored with.
    pub fn g_y(&self) -> &[f64] {
        &self.g_y
    }

    /// `r_λ` it was last factored with.
    pub fn r_lam(&self) -> &[f64] {
        &self.r_lam
    }

    /// Factors the matrix at (t, y, z, λ).
    ///
    /// # Errors
    /// A singular mass, redundant constraints, or a derivative that is not finite.
    pub fn update(
        &mut self,
        model: &mut Model,
        t: f64,
        y: &[f64],
        z: &[f64],
        lam: &[f64],
    ) -> Result<(), Trouble> {
        self.mass.update(model, t, y, z)?;
        if model.problem.m == 0 {
            return Ok(());
        }
        let [g_y, r_lam] = model.node_blocks(t, y, lam);
        finite(g_y, Quantity::Derivative, t)?;
        finite(r_lam, Quantity::Derivative, t)?;
        copy(&mut self.g_y, g_y);
        copy(&mut self.r_lam, r_lam);
        let at = &model.problem.patterns;
        self.mass
            .compliance(&at.r_lam, &self.r_lam, &mut self.compliance);
        self.schur.matrix_mut().clear();
        add_product(
            &at.g_y,
            &self.g_y,
            1.0,
            &self.compliance,
            self.schur.matrix_mut(),
            (0, 0),
        );
        self.schur
            .factor()
            .map_err(|_| explain(&at.g_y, &self.g_y, Trouble::SingularNewton))
    }

    /// Solves in place: `a` becomes x, `b` becomes μ.
    pub fn solve(&mut self, model: &Model, a: &mut [f64], b: &mut [f64]) {
        let at = &model.problem.patterns;
        if !b.is_empty() {
            copy(&mut self.velocity, a);
            self.mass.solve_velocity(&mut self.velocity);
            at.g_y.multiply_add(&self.g_y, -1.0, &self.velocity, b);
            self.schur.solve(b);
            at.r_lam.multiply_add(&self.r_lam, 1.0, b, a);
        }
        self.mass.solve(a);
    }
}
