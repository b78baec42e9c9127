//! Slow corrections of node Schur: derivatives of reactions by positions, r_y, on the right-hand side.
//!
//! Node Schur A drops E, with (E δ)_i = h² Σ_l â_il r_y(l) Σ_j ā_lj dV_j. Under tension that is its largest error. With r_y at
//! the nodes, evaluated once, a correction is improved by δ ← −A⁻¹ (F − E δ), which takes no other residual.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::{NodeSchur, Residuals};
use liouville_base::linalg::{Matrix, add_scaled, as_is, combine, copy, max_norm};
use liouville_base::real::Real;

/// Corrections whose ratio is above this are improved from then on, while that changes the first of them by at least this
/// part of the ratio.
const SLOW: f64 = 0.03;
const SHARE: f64 = 0.25;
/// A ratio needs so many corrections, and says nothing below the noise.
const FIRST: usize = 2;
const NOISE: f64 = 1e3 * f64::EPSILON;
/// Improvements of each correction.
const IMPROVEMENTS: usize = 2;

/// Whether the corrections of a member are improved.
const NOT_YET: f64 = 0.0;
const IMPROVED: f64 = 1.0;
const NEVER: f64 = 2.0;

/// r_y at the nodes 0..k−1, and which members' corrections are improved by it.
#[derive(Clone, Debug)]
pub(super) struct Reactions<R> {
    pub(super) r_y: Matrix<R>,
    /// The residual of momenta less E δ.
    momentum: Matrix<R>,
    /// dZ before it is improved.
    d_z: Matrix<R>,
    corrections: usize,
    /// The size of the last correction, and its ratio to the one before.
    size: R,
    rate: R,
    state: R,
    /// 1 for members whose next correction is the first to be improved, else 0.
    pub(super) is_new: R,
}

impl<R: Real> Reactions<R> {
    /// Memory for so many nodes and entries of r_y, and for vectors at the stages.
    pub(super) fn new((nodes, entries): (usize, usize), at_stages: &Matrix<R>) -> Self {
        Self {
            r_y: Matrix::zeros(nodes, entries),
            momentum: at_stages.clone(),
            d_z: at_stages.clone(),
            corrections: 0,
            size: R::splat(f64::INFINITY),
            rate: R::splat(0.0),
            state: R::splat(NOT_YET),
            is_new: R::splat(0.0),
        }
    }

    /// Begins an iteration.
    pub(super) fn restart(&mut self) {
        self.corrections = 0;
        self.size = R::splat(f64::INFINITY);
        self.state = R::splat(NOT_YET);
        self.is_new = R::splat(0.0);
    }

    /// Whether r_y is to be evaluated.
    pub(super) fn is_wanted(&self) -> bool {
        !self.is_new.all(|is_new| is_new == 0.0)
    }

    /// Decides, after a correction of this size, whether the next ones are improved: where they are slow, and three more at
    /// this rate do not meet the tolerance.
    pub(super) fn judge(&mut self, size: R, tolerance: f64) {
        if self.r_y.cols() == 0 {
            return;
        }
        self.corrections += 1;
        (self.rate, self.size) = (size / self.size, size);
        if self.corrections < FIRST {
            return;
        }
        self.is_new = R::each(
            [size, self.rate, self.state],
            #[inline(always)]
            |[size, rate, state]| {
                let is_slow = size > NOISE && rate > SLOW && rate < 1.0;
                let is_far = size * rate * rate * rate > tolerance;
                f64::from(u8::from(is_slow && is_far && state == NOT_YET))
            },
        );
        self.state = self.is_new.choose(R::splat(IMPROVED), self.state);
    }

    /// 1 for members whose corrections are improved, else 0.
    #[inline(always)]
    fn improved(&self) -> R {
        self.state.map(
            #[inline(always)]
            |state| f64::from(u8::from(state == IMPROVED)),
        )
    }

    /// Leaves out members whose first improved correction is nearly what it was.
    #[inline(always)]
    fn leave_out(&mut self, d_z: &Matrix<R>) {
        add_scaled(self.d_z.flat_mut(), -1.0, d_z.flat());
        let change = max_norm(self.d_z.flat()) / max_norm(d_z.flat());
        let is_small = change.zip(
            self.rate,
            #[inline(always)]
            |change, rate| f64::from(u8::from(change < SHARE * rate)),
        );
        self.state = (is_small * self.is_new).choose(R::splat(NEVER), self.state);
        self.is_new = R::splat(0.0);
    }
}

impl<R: Real> NodeSchur<R> {
    /// Improves the corrections of members where they are slow; those of others keep their bits.
    #[inline(always)]
    pub(super) fn improve(&mut self, of: Residuals<R>, h: f64) {
        let improved = self.reactions.improved();
        if improved.all(|improved| improved == 0.0) {
            return;
        }
        let is_first = self.reactions.is_wanted();
        if is_first {
            copy(self.reactions.d_z.flat_mut(), self.d_z.flat());
        }
        for _ in 0..IMPROVEMENTS {
            self.solve_with_reactions(of, h, improved);
        }
        if is_first {
            self.reactions.leave_out(&self.d_z);
        }
    }

    /// Solves for −A⁻¹ (F − E δ), δ being the corrections so far, and for −A⁻¹ F where `improved` is 0.
    #[inline(always)]
    fn solve_with_reactions(&mut self, of: Residuals<R>, h: f64, improved: R) {
        let at = &self.problem.patterns;
        let d_v = if at.v_z.is_some() {
            &self.d_v
        } else {
            &self.d_z
        };
        combine(self.node_velocity.flat_mut(), &self.a_bar, d_v, as_is);
        self.impulse.clear();
        for l in 1..self.product.rows() {
            let moved = self.node_velocity.row_mut(l - 1); // node 0 does not move
            for x in moved.iter_mut() {
                *x *= improved;
            }
            let (r_y, impulse) = (self.reactions.r_y.row(l), self.impulse.row_mut(l));
            at.r_y.multiply_add(r_y, h * h, moved, impulse);
        }
        let mut momentum = std::mem::replace(&mut self.reactions.momentum, Matrix::zeros(0, 0));
        combine(
            momentum.flat_mut(),
            &self.a_hat,
            &self.impulse,
            #[inline(always)]
            |i, k, sums| {
                let residual = &of.momentum.row(i)[k..k + sums.len()];
                for (sum, residual) in sums.iter_mut().zip(residual) {
                    *sum = *residual - *sum;
                }
            },
        );
        let residuals = Residuals {
            momentum: &momentum,
            ..of
        };
        self.solve(residuals, h);
        self.reactions.momentum = momentum;
    }
}
