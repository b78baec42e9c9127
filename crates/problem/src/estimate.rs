//! The error of a step, from how far the velocities at its ends are off the polynomial of its stages:
//!
//!     e0 = h (v0 − Σ_j ℓ_j(0) V_j),     e1 = h (v1 − Σ_j ℓ_j(1) V_j)
//!
//! are O(h^(s+1)), a velocity times h (ωh)^s; the local error of y is that times another (ωh)^s. With
//! ‖x‖ the root mean square in units of the tolerance, the estimate is therefore
//!
//!     c_s max(‖e0‖, ‖e1‖)² / max(‖h v0‖, ‖h V_1‖, …, ‖h v1‖) = O(h^(2s+1))
//!
//! and for Radau points, whose order is 2s − 1, the power (2s − 1)/s in the place of 2. c_s is
//! measured: the error of y is then mostly below the tolerance, and above it by a small factor where e
//! passes a zero.

use super::{Carried, State};
use liouville_base::linalg::Matrix;
use liouville_base::method::Tolerance;
use liouville_base::tableau;

/// The velocities of a step.
#[derive(Clone, Copy, Debug)]
pub struct StepVelocities<'a> {
    /// v0, V_1..V_s and v1, one a row.
    pub rows: &'a Matrix,
    /// Change of each coordinate's defect by roundings, or nothing: that much is no error of a step.
    pub noise: &'a [f64],
}

impl StepVelocities<'_> {
    /// The largest velocity of a coordinate.
    pub fn largest(&self, k: usize) -> f64 {
        let each = (0..self.rows.rows()).map(|i| self.rows[(i, k)].abs());
        each.fold(0.0, f64::max)
    }

    /// Each velocity in units of a tolerance, and the largest of these.
    pub fn speed(&self, tolerance: &Tolerance, y: [&[f64]; 2]) -> f64 {
        let each = |i| tolerance.weigh(y, self.rows.row(i).iter().copied());
        (0..self.rows.rows()).map(each).fold(0.0, f64::max)
    }
}

/// The embedded error estimate, and the state before the step, to undo it.
#[derive(Clone, Debug)]
pub struct Estimate<S = State> {
    /// The tolerance that errors are measured in.
    pub tolerance: Tolerance,
    /// 1 and −ℓ_j(0), then −ℓ_j(1) and 1: of v0, V_1..V_s, v1.
    weights: [Vec<f64>; 2],
    constant: f64,
    /// How many times an error's power of ωh is that of e; and the power of h in the estimate.
    power: f64,
    order: f64,
    /// The state before the step, once there is one.
    before: Option<S>,
    /// The larger of ‖e0‖/h and ‖e1‖/h.
    off: f64,
    error: f64,
    /// The power of h of an error that was raised.
    raised: Option<f64>,
}

/// c_s. Errors of methods of few stages pass zeros at other places than e does, and those of Lobatto
/// pairs are larger: they want a margin.
fn constant(tableau: &tableau::Spark) -> f64 {
    let of_gauss = match tableau.intervals {
        1 => 5.0,
        2 => 4.0,
        3 => 2.0,
        _ => 1.0,
    };
    let is_pair = tableau.stages > tableau.intervals;
    of_gauss * if is_pair { 4.0 } else { 1.0 }
}

impl<S: Carried + Clone> Estimate<S> {
    /// The estimate of a method, for states still to come.
    pub fn new(tableau: &tableau::Spark, tolerance: Tolerance) -> Self {
        let all: Vec<usize> = (0..tableau.stages).collect();
        let mut ends = Matrix::zeros(2, tableau.stages);
        tableau::lagrange(&tableau.c, &all, [0.0, 1.0].into_iter(), &mut ends);
        let basis = |end: usize| ends.row(end).iter().map(|weight| -weight);
        let first = std::iter::once(1.0).chain(basis(0)).chain([0.0]);
        let last = std::iter::once(0.0).chain(basis(1)).chain([1.0]);
        let is_radau = tableau.c[0] > 0.0 && tableau.c.last() == Some(&1.0);
        let order = (2 * tableau.intervals - usize::from(is_radau)) as f64;
        Self {
            weights: [first.collect(), last.collect()],
            constant: constant(tableau),
            power: order / tableau.intervals as f64,
            order: order + 1.0,
            before: None,
            tolerance,
            off: f64::INFINITY,
            error: f64::INFINITY,
            raised: None,
        }
    }

    /// Keeps the state at the start of a step.
    pub fn keep(&mut self, state: &S) {
        match &mut self.before {
            Some(before) => before.clone_from(state),
            none => *none = Some(state.clone()),
        }
    }

    /// Estimates the error of the step of `h` that led to `state`.
    pub fn measure(&mut self, velocities: StepVelocities, h: f64, state: &S) {
        let before = self.before.take();
        self.measure_between(
            velocities,
            h,
            [before.as_ref().unwrap_or(state), state].map(S::y),
        );
        self.before = before;
    }

    /// The same of a step between these coordinates.
    pub fn measure_between(&mut self, velocities: StepVelocities, h: f64, y: [&[f64]; 2]) {
        let off = [0, 1].map(|end| {
            let of = |k: usize| self.defect(velocities, end, k);
            self.tolerance.weigh(y, (0..y[1].len()).map(of))
        });
        let off = off[0].max(off[1]);
        let speed = velocities.speed(&self.tolerance, y);
        (self.off, self.raised) = (off, None);
        self.error = if off == 0.0 {
            0.0
        } else {
            self.constant * h.abs() * speed * (off / speed).powf(self.power)
        };
        if self.error.is_nan() {
            self.error = f64::INFINITY;
        }
    }

    /// Defect of the polynomial of the stages in a velocity at the start, 0, or at the end, 1.
    pub fn defect(&self, velocities: StepVelocities, end: usize, k: usize) -> f64 {
        let weights = self.weights[end].iter().enumerate();
        let defect: f64 = weights
            .map(|(i, weight)| weight * velocities.rows[(i, k)])
            .sum();
        match velocities.noise.get(k) {
            Some(noise) => defect.signum() * (defect.abs() - noise).max(0.0),
            None => defect,
        }
    }

    /// The error, in units of the tolerance.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// The power of h with which it falls.
    pub fn order(&self) -> f64 {
        self.raised.unwrap_or(self.order)
    }

    /// Takes another estimate of the error, which falls with this power of h, where it is larger.
    pub fn raise(&mut self, error: f64, order: f64) {
        if error > self.error {
            (self.error, self.raised) = (error, Some(order));
        }
    }

    /// The larger defect of the velocities at the ends, in units of the tolerance.
    pub fn off(&self) -> f64 {
        self.off
    }

    /// The state before the step to `state`.
    pub fn before<'a>(&'a self, state: &'a S) -> &'a S {
        self.before.as_ref().unwrap_or(state)
    }

    /// Puts a state back to where it was before the step.
    pub fn undo(&self, state: &mut S) {
        if let Some(before) = &self.before {
            state.clone_from(before);
        }
    }
}
