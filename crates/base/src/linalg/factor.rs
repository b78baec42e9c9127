//! Factorisations that the pattern of a matrix allows.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::choice::prefers_sparse;
use super::scale_each;
use super::{BlockPlan, Blocks, Lu, Pattern, Singular, SparseOf};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd;
use std::sync::{Arc, OnceLock};

/// A square matrix ready to be solved with, as its pattern allows; the choice is made once.
#[derive(Clone, Debug)]
pub enum Factor<R = f64> {
    /// Reciprocals of the diagonal.
    Diagonal(Vec<R>),
    /// Small blocks inverted.
    Blocks(Box<Blocks<R>>),
    /// Dense LU.
    Dense(Lu<R>),
    /// Sparse LU.
    Sparse(Box<SparseOf>),
}

/// The inverse of a diagonal matrix.
#[inline(always)]
fn invert<R: Real>(inverse: &mut [R], pattern: &Pattern, values: &[R]) -> Result<(), Singular> {
    inverse.fill(R::splat(0.0));
    for (&(row, _), value) in pattern.entries().iter().zip(values) {
        inverse[row] = R::splat(1.0) / *value;
    }
    for (column, x) in inverse.iter().enumerate() {
        if !x.all(|x| x != 0.0 && x.is_finite()) {
            return Err(Singular { column });
        }
    }
    Ok(())
}

impl<R: Real> Factor<R> {
    /// Memory for matrices of this pattern.
    pub fn new(pattern: &Pattern) -> Self {
        Self::planned(pattern, &OnceLock::new())
    }

    /// The same, where the blocks of the pattern are kept.
    #[inline(never)]
    pub fn planned(pattern: &Pattern, plan: &OnceLock<Option<Arc<BlockPlan>>>) -> Self {
        let (n, _) = pattern.shape();
        if pattern.is_diagonal() {
            return Self::Diagonal(vec![R::splat(0.0); n]);
        }
        let plan = plan.get_or_init(|| BlockPlan::new(pattern).map(Arc::new));
        if let Some(plan) = plan {
            Self::Blocks(Box::new(Blocks::of(plan.clone())))
        } else if prefers_sparse(n, pattern.len()) {
            Self::Sparse(Box::new(SparseOf::new::<R>(pattern)))
        } else {
            Self::Dense(Lu::new(n))
        }
    }

    /// Factors the matrix with these values on its pattern.
    ///
    /// # Errors
    /// The first column without a pivot.
    #[inline(never)]
    pub fn factor(&mut self, pattern: &Pattern, values: &[R]) -> Result<(), Singular> {
        match self {
            Self::Diagonal(inverse) => dispatch_simd::<R, _>(
                #[inline(always)]
                || invert(inverse, pattern, values),
            ),
            Self::Blocks(blocks) => blocks.factor(values),
            Self::Dense(lu) => {
                lu.matrix_mut().clear();
                pattern.add_to(values, 1.0, lu.matrix_mut(), 0, 0);
                lu.factor()
            }
            Self::Sparse(lu) => lu.factor(values),
        }
    }

    /// Solves `A x = b` in place.
    #[inline(always)]
    pub fn solve(&mut self, b: &mut [R]) {
        match self {
            Self::Diagonal(inverse) => scale_each(b, inverse),
            Self::Blocks(blocks) => blocks.solve(b),
            Self::Dense(lu) => lu.solve(b),
            Self::Sparse(lu) => lu.solve(b),
        }
    }

    /// Whether the determinant of the matrix is negative, of the first of several members; `None` where that is not known.
    pub fn is_negative(&self) -> Option<bool> {
        match self {
            Self::Diagonal(inverse) => {
                let negative = inverse.iter().filter(|x| x.member(0) < 0.0);
                Some(negative.count() % 2 == 1)
            }
            Self::Blocks(blocks) => Some(blocks.is_negative()),
            Self::Dense(lu) => Some(lu.is_negative()),
            Self::Sparse(_) => None,
        }
    }

    /// Where the inverse is not zero, if that is known.
    pub fn inverse_pattern(&self) -> Option<Pattern> {
        match self {
            Self::Diagonal(inverse) => Some(Pattern::diagonal(inverse.len())),
            Self::Blocks(blocks) => Some(blocks.pattern().clone()),
            Self::Dense(_) | Self::Sparse(_) => None,
        }
    }

    /// The inverse on that pattern.
    pub fn inverse_values(&self) -> &[R] {
        match self {
            Self::Diagonal(inverse) => inverse,
            Self::Blocks(blocks) => blocks.values(),
            Self::Dense(_) | Self::Sparse(_) => &[],
        }
    }

    /// Solves `A^T x = b` in place.
    pub fn solve_transposed(&mut self, b: &mut [R]) {
        match self {
            Self::Diagonal(inverse) => scale_each(b, inverse),
            Self::Blocks(blocks) => blocks.solve_transposed(b),
            Self::Dense(lu) => lu.solve_transposed(b),
            Self::Sparse(lu) => lu.solve_transposed(b),
        }
    }
}

crate::compiled!(R in [f64, Lanes<BATCH>] {
    Factor::<R>::planned as fn(_, _) -> _,
    Factor::<R>::factor as fn(_, _, _) -> _,
});
