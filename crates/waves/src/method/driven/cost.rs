//! The cost of a run by series in time, in advance.

use super::choice::{Form, Share};
use super::fit::Sampler;
use crate::method::TermBounds;
use crate::problem::Hamiltonian;
use liouville_base::error::StepError;
use std::sync::Arc;

/// The parts of a Hamiltonian, and the tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct Driven {
    /// The parts, and bounds of their eigenvalues.
    pub bounds: TermBounds,
    /// Whether parts after the first are B_k less the first, of which products are made with B_k.
    pub by_differences: bool,
    /// Times where windows end, besides, in order along the run.
    pub breaks: Vec<f64>,
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// Of the norm.
    pub tolerance: f64,
}

/// The cost of windows: series of powers and of Bessel functions, and the products of all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrivenCost {
    /// Windows with a series of powers.
    pub powers: usize,
    /// Windows with a series of Bessel functions.
    pub bessel: usize,
    /// Products: at most of powers, about of Bessel functions.
    pub products: usize,
    /// The longest window, in units of 1/β.
    pub theta: f64,
}

impl Driven {
    pub(super) fn sampler(&self, hamiltonian: &Arc<Hamiltonian>) -> Option<Sampler> {
        let sampler = Sampler::new(hamiltonian.clone(), self.bounds.clone())?;
        Some(sampler.with_differences(self.by_differences))
    }

    /// The cost of a run from `t` to `end`; none where the parts do not fit.
    ///
    /// # Errors
    /// H is not finite.
    pub fn cost(
        &self,
        hamiltonian: &Arc<Hamiltonian>,
        (t, end): (f64, f64),
    ) -> Option<Result<DrivenCost, StepError>> {
        let mut sampler = self.sampler(hamiltonian)?;
        let share = Share {
            rate: self.rate,
            whole: self.rate * (end - t).abs(),
        };
        let (mut cost, mut t) = (DrivenCost::default(), t);
        while t.to_bits() != end.to_bits() {
            let window = match sampler.window(t, self.end(t, end) - t, share, false) {
                Ok(window) => window,
                Err(error) => return Some(Err(error)),
            };
            match window.form {
                Form::Powers => cost.powers += 1,
                Form::Bessel => cost.bessel += 1,
            }
            cost.products += window.last * hamiltonian.products();
            cost.theta = cost.theta.max(window.beta * window.h.abs());
            t = next_time(t, window.h, self.end(t, end));
        }
        Some(Ok(cost))
    }

    /// The end of the windows from t on: that of the run, or a time before where they end besides.
    pub(super) fn end(&self, t: f64, end: f64) -> f64 {
        let is_between = |time: f64| (time - t) * (end - t) > 0.0 && (time - end) * (t - end) > 0.0;
        let mut between = self.breaks.iter().copied().filter(|time| is_between(*time));
        between.next().unwrap_or(end)
    }
}

/// The end of a window or of a step, which is that of the run where it is as near as rounding errors.
pub(in crate::method) fn next_time(t: f64, h: f64, end: f64) -> f64 {
    let next = t + h;
    if (end - next).abs() <= 1e-9 * h.abs() || next.to_bits() == t.to_bits() {
        end
    } else {
        next
    }
}
