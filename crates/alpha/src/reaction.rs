//! The part of the acceleration that constraints bring, and how it enters a step.

use liouville_base::linalg::{add_scaled, copy};

/// How the constraints' reactions enter a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reactions {
    /// By A0 and A1, with the weight b; A1 at the predicted position if it is said so.
    Extended {
        /// The weight of A1 in the position.
        b: f64,
        /// Whether r is taken at y0 + h z0.
        predicted: bool,
    },
    /// As a part of φ, by the constraint on the position alone.
    Position,
}

impl Reactions {
    /// The tolerance of equations that are solved to roundoff.
    pub fn roundoff(self) -> f64 {
        match self {
            // the errors left are damped, unlike in a symplectic method
            Self::Extended { .. } => f64::EPSILON,
            // errors left in the position are divided by h in the velocity
            Self::Position => 1e-3 * f64::EPSILON,
        }
    }

    /// Whether A0 and A1 are unknowns, each with so many multipliers.
    pub(super) fn are_paired(self, multipliers: usize) -> bool {
        multipliers > 0 && self != Self::Position
    }
}

/// An acceleration by the constraints, and the multipliers it comes from.
#[derive(Clone, Debug, Default)]
pub(super) struct Reaction {
    pub(super) a: Vec<f64>,
    pub(super) lam: Vec<f64>,
}

impl Reaction {
    /// `self = last + h rate`
    pub(super) fn extrapolate(&mut self, last: &Self, rate: &Self, h: f64) {
        let ahead = |out: &mut [f64], last: &[f64], rate: &[f64]| {
            copy(out, last);
            add_scaled(out, h, rate);
        };
        ahead(&mut self.a, &last.a, &rate.a);
        ahead(&mut self.lam, &last.lam, &rate.lam);
    }

    /// `self = (new - old) / h`
    pub(super) fn between(&mut self, old: &Self, new: &Self, h: f64) {
        let slope = |out: &mut [f64], old: &[f64], new: &[f64]| {
            for (k, out) in out.iter_mut().enumerate() {
                *out = (new[k] - old[k]) / h;
            }
        };
        slope(&mut self.a, &old.a, &new.a);
        slope(&mut self.lam, &old.lam, &new.lam);
    }
}

liouville_base::checkpoint!(Reaction { a, lam });
