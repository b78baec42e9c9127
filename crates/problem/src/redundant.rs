//! Multipliers where constraints are redundant: their gradients depend on one another, and they agree.
//!
//! Constraints that others imply are left out of the equations of a step, which changes neither y nor z. With the
//! reactions c_i to a multiplier of one, those left out are combinations of the others, c_d = Σ_i C_id c_i, so that
//!
//!     λ_i − Σ_d C_id x_d,   λ_d = x_d
//!
//! gives the same reaction for any x. Taken is the least norm, in the metric of the mass: that of λ_i |c_i| with
//! |c|² = c · v_z p_z⁻¹ c, which neither the scale of a constraint nor the coordinates change:
//!
//!     (1 + Cᵀ C) x = Cᵀ λ,   C and λ scaled by |c_i|

use super::{Mechanical, Mismatch, Model, Saddle, check, check_pattern, model::finite};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Lu, Matrix, Pattern, dot, independent_rows};
use liouville_base::tape::Tape;

/// Constraints left out of a problem, because the others imply them.
#[derive(Clone, Debug)]
pub struct Redundant {
    /// (t, y, z) → reactions of all constraints, those left out too, to a multiplier of one
    pub reactions: Tape,
    /// Where they are not zero: n rows, a column for each constraint.
    pub pattern: Pattern,
    /// Which constraints are left out, in their order.
    pub left_out: Vec<usize>,
}

impl Redundant {
    /// Sees that the parts fit to a problem that keeps `kept` constraints.
    pub(super) fn check(&self, n: usize, kept: usize, params: usize) -> Result<(), Mismatch> {
        let all = kept + self.left_out.len();
        check("reactions", self.reactions.inputs().len(), 4)?;
        for (found, wanted) in self.reactions.inputs().iter().zip([1, n, n, params]) {
            check("reactions", *found, wanted)?;
        }
        check("reactions", self.reactions.outputs(), self.pattern.len())?;
        check_pattern("reactions", &self.pattern, (n, all))?;
        let is_sorted = self.left_out.is_sorted_by(|a, b| a < b);
        let last = self.left_out.last().map_or(0, |last| last + 1);
        check("left_out, in order,", usize::from(is_sorted), 1)?;
        check("left_out", last.max(all), all)
    }

    /// The constraints that are kept, in their order.
    fn kept(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.pattern.shape().1).filter(|k| self.left_out.binary_search(k).is_err())
    }
}

impl Mechanical {
    /// The first of several members, a row of y and of `params` each, of which some gradients of holonomic constraints
    /// are dependent at (t, y): of length one, one has no part of more than `cutoff` that is orthogonal to the others.
    ///
    /// # Panics
    /// When a row has another size.
    pub fn first_dependent<'a>(
        &self,
        mut members: impl Iterator<Item = (&'a [f64], &'a [f64])>,
        t: f64,
        cutoff: f64,
    ) -> Option<usize> {
        members.position(|(params, y)| !self.are_independent(params, t, y, cutoff))
    }

    fn are_independent(&self, params: &[f64], t: f64, y: &[f64], cutoff: f64) -> bool {
        let (at, lam) = (&self.patterns.g_y, vec![0.0; self.m]);
        let mut registers = self.node_blocks.bind(params);
        let blocks = self.node_blocks.eval(&mut registers, [&[t], y, &lam]);
        let mut gradients = Matrix::zeros(self.m, self.n);
        at.add_to(&blocks[..at.len()], 1.0, &mut gradients, 0, 0);
        independent_rows(gradients, cutoff).kept.len() == self.m
    }
}

/// The multipliers of all constraints, from those of the constraints that are kept.
#[derive(Clone, Debug)]
pub(super) struct LeastNorm {
    /// c_i, one a row.
    reactions: Matrix,
    /// |c_i|
    sizes: Vec<f64>,
    /// C, scaled, one column of it a row.
    combinations: Matrix,
    gram: Lu<f64>,
    x: Vec<f64>,
    column: Vec<f64>,
    /// λ, scaled.
    scaled: Vec<f64>,
    /// Multipliers of all constraints, as last found.
    pub(super) lam: Vec<f64>,
}

impl LeastNorm {
    /// Memory for the constraints left out of `problem`, if there are any.
    pub(super) fn new(problem: &Mechanical) -> Option<Self> {
        let redundant = problem.redundant.as_ref()?;
        let (n, all) = redundant.pattern.shape();
        let left = redundant.left_out.len();
        Some(Self {
            reactions: Matrix::zeros(all, n),
            sizes: vec![0.0; all],
            combinations: Matrix::zeros(left, all - left),
            gram: Lu::new(left),
            x: vec![0.0; left],
            column: vec![0.0; n],
            scaled: vec![0.0; all - left],
            lam: vec![0.0; all],
        })
    }

    /// Finds them from `kept`, with the saddle as it was factored at (t, y, z).
    ///
    /// # Errors
    /// A reaction that is not finite.
    pub(super) fn solve(
        &mut self,
        (model, saddle): (&mut Model, &mut Saddle),
        (t, y, z): (f64, &[f64], &[f64]),
        kept: &[f64],
    ) -> Result<(), StepError> {
        let problem = model.problem.clone();
        let Some(redundant) = &problem.redundant else {
            return Ok(());
        };
        let values = model.reactions(t, y, z);
        finite(values, Quantity::Derivative, t)?;
        self.reactions.clear();
        for (&(row, constraint), value) in redundant.pattern.entries().iter().zip(values) {
            self.reactions[(constraint, row)] = *value;
        }
        self.combine(redundant, model, saddle);
        self.share(redundant, kept)
    }

    /// Finds |c_i| and C.
    fn combine(&mut self, redundant: &Redundant, model: &Model, saddle: &mut Saddle) {
        for (size, row) in self.sizes.iter_mut().zip(0..self.reactions.rows()) {
            let reaction = self.reactions.row(row);
            self.column.copy_from_slice(reaction);
            saddle.mass.solve_velocity(&mut self.column);
            let square = dot(reaction, &self.column);
            *size = if square > 0.0 { square.sqrt() } else { 1.0 };
        }
        for (row, left) in redundant.left_out.iter().enumerate() {
            self.column.copy_from_slice(self.reactions.row(*left));
            let combination = self.combinations.row_mut(row);
            combination.fill(0.0);
            // p_z x − Σ_i c_i μ_i = c_d without a motion: μ is −C
            saddle.solve(model, &mut self.column, combination);
            for (c, kept) in combination.iter_mut().zip(redundant.kept()) {
                *c *= -self.sizes[kept] / self.sizes[*left];
            }
        }
    }

    /// Finds all multipliers of least norm from those of the constraints that are kept.
    fn share(&mut self, redundant: &Redundant, kept: &[f64]) -> Result<(), StepError> {
        for ((scaled, k), lam) in self.scaled.iter_mut().zip(redundant.kept()).zip(kept) {
            *scaled = lam * self.sizes[k];
        }
        let gram = self.gram.matrix_mut();
        for i in 0..self.x.len() {
            for j in 0..self.x.len() {
                let product = dot(self.combinations.row(i), self.combinations.row(j));
                gram[(i, j)] = product + f64::from(u8::from(i == j));
            }
            self.x[i] = dot(self.combinations.row(i), &self.scaled);
        }
        self.gram.factor().map_err(|_| StepError::SingularNewton)?;
        self.gram.solve(&mut self.x);
        for (position, (k, lam)) in redundant.kept().zip(&self.scaled).enumerate() {
            let parts = self.x.iter().enumerate();
            let implied: f64 = parts
                .map(|(row, x)| self.combinations[(row, position)] * x)
                .sum();
            self.lam[k] = (lam - implied) / self.sizes[k];
        }
        for (left, x) in redundant.left_out.iter().zip(&self.x) {
            self.lam[*left] = x / self.sizes[*left];
        }
        Ok(())
    }
}
