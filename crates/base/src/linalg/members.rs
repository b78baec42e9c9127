//! Sparse LU of several members in lock-step: one after another, each by itself.

use super::{Pattern, Singular, Sparse};
use crate::real::Real;

/// Sparse LU of each member.
#[derive(Clone, Debug)]
pub struct SparseOf {
    members: Vec<Sparse>,
    /// Values and a vector of one member.
    values: Vec<f64>,
    x: Vec<f64>,
}

impl SparseOf {
    /// Memory for matrices of this pattern, of each member.
    pub fn new<R: Real>(pattern: &Pattern) -> Self {
        let several = usize::from(R::MEMBERS > 1);
        Self {
            members: vec![Sparse::new(pattern); R::MEMBERS],
            values: vec![0.0; several * pattern.len()],
            x: vec![0.0; several * pattern.shape().0],
        }
    }

    /// Factors the matrices with these values on the pattern.
    ///
    /// # Errors
    /// The first column of any member without a pivot.
    pub fn factor<R: Real>(&mut self, values: &[R]) -> Result<(), Singular> {
        if let Some(values) = R::alone(values) {
            return self.members[0].factor(values);
        }
        for (member, lu) in self.members.iter_mut().enumerate() {
            for (out, value) in self.values.iter_mut().zip(values) {
                *out = value.member(member);
            }
            lu.factor(&self.values)?;
        }
        Ok(())
    }

    /// Solves `A^T x = b` of each member in place.
    pub(crate) fn solve_transposed<R: Real>(&mut self, b: &mut [R]) {
        self.solve_each(b, Sparse::solve_transposed);
    }

    /// Solves `A x = b` of each member in place.
    pub fn solve<R: Real>(&mut self, b: &mut [R]) {
        self.solve_each(b, Sparse::solve);
    }

    fn solve_each<R: Real>(&mut self, b: &mut [R], solve: fn(&mut Sparse, &mut [f64])) {
        if let Some(b) = R::alone_mut(b) {
            return solve(&mut self.members[0], b);
        }
        for (member, lu) in self.members.iter_mut().enumerate() {
            for (x, b) in self.x.iter_mut().zip(&*b) {
                *x = b.member(member);
            }
            solve(lu, &mut self.x);
            for (b, x) in b.iter_mut().zip(&self.x) {
                b.set_member(member, *x);
            }
        }
    }
}
