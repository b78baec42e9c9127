//! The policy by which factors of a modified-Newton matrix are kept from step to step.

use super::BlockMatrix;
use crate::real::Real;

/// Cost of the factors of a sparse matrix, in corrections.
const SPARSE_COST: f64 = 10.0;
/// The same of a dense one, for each row.
const DENSE_COST: f64 = 1.0 / 6.0;
/// Corrections with the same factors that a step may take, beside the cost of new ones.
const LEAST_ITERATIONS: f64 = 10.0;
/// Steps whose sizes differ by a smaller fraction share the factors of a sparse matrix.
const SIMILAR: f64 = 0.25;

/// The number of corrections at which factors are renewed, though the iteration still converges with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Renewal {
    /// More than the average of a step since the factors were made, their own cost included.
    AboveAverage,
    /// This number more than in the first step with them: for corrections by Broyden's update, whose number varies from
    /// step to step.
    AboveFirst(usize),
}

/// The step size that factors were made for, and their cost since.
#[derive(Clone, Debug)]
pub struct Reuse {
    renewal: Renewal,
    factor_cost: f64,
    is_sparse: bool,
    /// The step size they are for; 0 without factors.
    h: f64,
    /// Corrections since they were made, with their own cost, and steps.
    cost: f64,
    steps: f64,
    /// Corrections in the first step with them.
    first: usize,
}

impl Reuse {
    /// The policy for this matrix, which has no factors yet.
    pub fn new<R: Real>(matrix: &BlockMatrix<R>, renewal: Renewal) -> Self {
        let sparse = Self::sparse(renewal);
        if matrix.is_sparse() {
            return sparse;
        }
        Self {
            factor_cost: DENSE_COST * matrix.order() as f64,
            is_sparse: false,
            ..sparse
        }
    }

    /// The policy for a sparse matrix, which has no factors yet.
    pub fn sparse(renewal: Renewal) -> Self {
        Self {
            renewal,
            factor_cost: SPARSE_COST,
            is_sparse: true,
            h: 0.0,
            cost: 0.0,
            steps: 0.0,
            first: 0,
        }
    }

    /// The step size the factors were made for; 0 without factors.
    pub fn h(&self) -> f64 {
        self.h
    }

    /// Whether the factors were made for steps of just this size.
    pub fn is_for(&self, h: f64) -> bool {
        h.to_bits() == self.h.to_bits()
    }

    /// Whether the factors are good enough to begin a step of this size with.
    pub fn is_reusable(&self, h: f64) -> bool {
        self.is_for(h) || self.is_sparse && (h / self.h - 1.0).abs() <= SIMILAR
    }

    /// Corrections in a step after which new factors are worth their cost.
    pub fn max_iterations(&self) -> f64 {
        LEAST_ITERATIONS + self.factor_cost
    }

    /// Discards the factors.
    pub fn discard(&mut self) {
        self.h = 0.0;
    }

    /// Records new factors, for steps of this size.
    pub fn renew(&mut self, h: f64) {
        (self.h, self.cost, self.steps) = (h, self.factor_cost, 0.0);
    }

    /// Records the corrections of a step; slow factors are discarded.
    pub fn record(&mut self, iterations: usize) {
        if self.steps == 0.0 {
            self.first = iterations;
        }
        self.cost += iterations as f64;
        self.steps += 1.0;
        let is_slow = match self.renewal {
            Renewal::AboveAverage => iterations as f64 * self.steps > self.cost,
            Renewal::AboveFirst(more) => iterations > self.first + more,
        };
        if is_slow {
            self.discard();
        }
    }
}

crate::checkpoint!(Reuse {
    h,
    cost,
    steps,
    first
});
