//! Units of the equations and unknowns of a Newton matrix whose own are too far apart to tell whether it is singular:
//!
//!     [ A  −R ]      with A of masses and stiffness, R of reactions, G of constraints
//!     [ G   0 ]
//!
//! In kilograms and newtons a mass of 1e-16 is roundoff beside the reactions in its row, and beside the constraints in
//! its column. Rows and columns of A are divided by the roots of their largest entries, again and again, which brings
//! these to one; then columns of R and rows of G are divided by their largest entries in those units. Multipliers are
//! the unknowns that have no entry on the diagonal. All units are powers of two and round nothing.
//! Source: Ruiz, RAL-TR-2001-034.

use crate::linalg::{Pattern, inverse_power, scale_each};
use crate::real::Real;

/// How often rows and columns of A are divided; the distance of their sizes from one halves (in logarithms) each time.
const PASSES: usize = 6;

/// The matrix in other units, and these.
#[derive(Clone, Debug)]
pub(super) struct Units<R> {
    /// Factors of rows and of columns.
    row: Vec<R>,
    col: Vec<R>,
    /// Largest entries of rows and of columns.
    row_size: Vec<R>,
    col_size: Vec<R>,
    is_multiplier: Vec<bool>,
    values: Vec<R>,
}

impl<R: Real> Units<R> {
    /// Memory for matrices of this pattern.
    pub(super) fn new(pattern: &Pattern) -> Self {
        let (n, _) = pattern.shape();
        let ones = || vec![R::splat(1.0); n];
        let mut is_multiplier = vec![true; n];
        for (row, col) in pattern.entries() {
            is_multiplier[*row] &= row != col;
        }
        Self {
            row: ones(),
            col: ones(),
            row_size: ones(),
            col_size: ones(),
            is_multiplier,
            values: vec![R::splat(0.0); pattern.len()],
        }
    }

    /// Finds the units of a matrix with these values; returns its values in them.
    pub(super) fn measure(&mut self, pattern: &Pattern, values: &[R]) -> &[R] {
        for x in self.row.iter_mut().chain(&mut self.col) {
            *x = R::splat(1.0);
        }
        for _ in 0..PASSES {
            self.measure_entries(pattern, values, false);
            for i in 0..self.row.len() {
                if !self.is_multiplier[i] {
                    self.row[i] *= self.row_size[i].map(|size| unit(size.sqrt()));
                    self.col[i] *= self.col_size[i].map(|size| unit(size.sqrt()));
                }
            }
        }
        self.measure_entries(pattern, values, true);
        for i in 0..self.row.len() {
            if self.is_multiplier[i] {
                self.row[i] = self.row_size[i].map(unit);
                self.col[i] = self.col_size[i].map(unit);
            }
        }
        for ((out, value), (row, col)) in self.values.iter_mut().zip(values).zip(pattern.entries())
        {
            *out = *value * self.row[*row] * self.col[*col];
        }
        &self.values
    }

    /// The largest entries of rows and columns of A, or of G and R.
    fn measure_entries(&mut self, pattern: &Pattern, values: &[R], is_bordering: bool) {
        for size in self.row_size.iter_mut().chain(&mut self.col_size) {
            *size = R::splat(0.0);
        }
        for (&(row, col), value) in pattern.entries().iter().zip(values) {
            let (below, right) = (self.is_multiplier[row], self.is_multiplier[col]);
            if below && right || (below || right) != is_bordering {
                continue;
            }
            let size = (*value * self.row[row] * self.col[col]).map(f64::abs);
            self.row_size[row] = self.row_size[row].zip(size, f64::max);
            self.col_size[col] = self.col_size[col].zip(size, f64::max);
        }
    }

    /// The values in these units.
    pub(super) fn values(&self) -> &[R] {
        &self.values
    }

    /// Multiplies by the factors of the equations: right-hand sides come to their units.
    pub(super) fn scale_equations(&self, b: &mut [R]) {
        scale_each(b, &self.row);
    }

    /// Multiplies by the factors of the unknowns: solutions leave their units.
    pub(super) fn scale_unknowns(&self, x: &mut [R]) {
        scale_each(x, &self.col);
    }
}

/// The factor that brings this size near one; where nothing is there, one.
fn unit(size: f64) -> f64 {
    if size > 0.0 { inverse_power(size) } else { 1.0 }
}
