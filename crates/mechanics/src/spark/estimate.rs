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

use super::Spark;
use crate::problem::State;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Tolerance};
use liouville_base::tableau;

/// What an estimate is made of, and what is kept to undo a step.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub(super) tolerance: Tolerance,
    /// 1 and −ℓ_j(0), then −ℓ_j(1) and 1: of v0, V_1..V_s, v1.
    weights: [Vec<f64>; 2],
    constant: f64,
    /// How many times an error's power of ωh is that of e; and the power of h in the estimate.
    power: f64,
    order: f64,
    before: State,
    error: f64,
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

impl Estimate {
    fn new(tableau: &tableau::Spark, tolerance: Tolerance) -> Self {
        let all: Vec<usize> = (0..tableau.stages).collect();
        let mut ends = Matrix::zeros(2, tableau.stages);
        tableau::lagrange(&tableau.c, &all, [0.0, 1.0].into_iter(), &mut ends);
        let basis = |end: usize| ends.row(end).iter().map(|weight| -weight);
        let first = std::iter::once(1.0).chain(basis(0)).chain([0.0]);
        let last = std::iter::once(0.0).chain(basis(1)).chain([1.0]);
        let is_radau = tableau.c[0] > 0.0 && tableau.c.last() == Some(&1.0);
        let order = (2 * tableau.intervals - usize::from(is_radau)) as f64;
        let none = || vec![0.0; tolerance.atol.len()];
        Self {
            weights: [first.collect(), last.collect()],
            constant: constant(tableau),
            power: order / tableau.intervals as f64,
            order: order + 1.0,
            before: State {
                y: none(),
                z: none(),
                p: none(),
                y_low: none(),
                p_low: none(),
            },
            tolerance,
            error: f64::INFINITY,
        }
    }

    pub(super) fn keep(&mut self, state: &State) {
        self.before.clone_from(state);
    }

    pub(super) fn measure(&mut self, velocities: &Matrix, h: f64, state: &State) {
        let ends = [&self.before.y[..], &state.y];
        let (rows, n) = (velocities.rows(), state.y.len());
        let off = |weights: &[f64]| {
            let of = |k: usize| (0..rows).map(|i| weights[i] * velocities[(i, k)]).sum();
            self.tolerance.weigh(ends, (0..n).map(of))
        };
        let off = off(&self.weights[0]).max(off(&self.weights[1]));
        let speeds = (0..rows).map(|i| {
            self.tolerance
                .weigh(ends, velocities.row(i).iter().copied())
        });
        let speed = speeds.fold(0.0, f64::max);
        self.error = if off == 0.0 {
            0.0
        } else {
            self.constant * h.abs() * speed * (off / speed).powf(self.power)
        };
        if self.error.is_nan() {
            self.error = f64::INFINITY;
        }
    }
}

impl Spark {
    /// The same, with errors estimated in units of a tolerance.
    #[must_use]
    pub fn estimating(mut self, tolerance: Tolerance) -> Self {
        let estimate = Estimate::new(&self.stages.tableau, tolerance);
        self.estimate = Some(Box::new(estimate));
        self
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance.
    ///
    /// # Errors
    /// The acceleration cannot be solved for.
    pub fn first_step(&mut self, t: f64, state: &State, span: f64) -> Result<f64, StepError> {
        let longest = span.abs() / 100.0;
        let Some(estimate) = &self.estimate else {
            return Ok(longest);
        };
        let acceleration = self.predictor.acceleration(&mut self.model, t, state)?;
        Ok(estimate
            .tolerance
            .first_step(&state.y, [acceleration; 2], span))
    }
}

impl Estimating for Spark {
    fn error(&self) -> f64 {
        self.estimate.as_ref().map_or(f64::INFINITY, |x| x.error)
    }

    fn error_order(&self) -> f64 {
        self.estimate.as_ref().map_or(1.0, |x| x.order)
    }

    fn undo(&mut self, state: &mut State) {
        if let Some(estimate) = &self.estimate {
            state.clone_from(&estimate.before);
            self.predictor.undo();
        }
    }
}
