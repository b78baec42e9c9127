//! Whether a grid resolves a wave function whose equation is not linear.
//!
//! The norm says nothing of it: each flow keeps the norm, also of a state that collapses between two points. The share
//! of |ψ|² in the upper third of the wave numbers does.

use super::super::{Wave, squares};
use liouville_base::error::StepError;
use liouville_fourier::Complex;

/// Steps from one look to the next.
const EVERY: usize = 16;

/// The share that ends a run, ...
const SHARE: f64 = 1e-6;

/// ... where it is so many times that of the start.
const TIMES: f64 = 100.0;

/// A squared norm that is off by more than the first of these is put back; by more than the second it is not roundings
/// alone that have moved it.
const ROUNDINGS: (f64, f64) = (5e-14, 1e-12);

/// The lower two thirds of the wave numbers, and the largest share allowed beyond them.
#[derive(Clone)]
pub(super) struct Resolution {
    /// Factors that leave the lower wave numbers: along the outermost axis, and in a plane.
    pub(super) factors: (Vec<Complex>, Vec<Complex>),
    most: Option<f64>,
    steps: usize,
}

impl Resolution {
    pub(super) fn new(factors: (Vec<Complex>, Vec<Complex>)) -> Self {
        Self {
            factors,
            most: None,
            steps: 0,
        }
    }

    /// Whether it is time to look at the state before the next step.
    pub(super) fn is_due(&mut self) -> bool {
        self.steps += 1;
        self.most.is_none() || self.steps >= EVERY
    }

    /// Refuses a state at `t` of which more is beyond the lower wave numbers, `low`, than is allowed.
    pub(super) fn check(
        &mut self,
        t: f64,
        low: &[Complex],
        state: &mut Wave<f64>,
    ) -> Result<(), StepError> {
        self.steps = 0;
        let now = squares(&state.q, &state.p);
        let share = share_beyond(low, state);
        let most = *self.most.get_or_insert(SHARE.max(TIMES * share));
        if share > most {
            return Err(StepError::Unresolved { share, t });
        }
        put_back(now, state);
        Ok(())
    }
}

/// The share of |ψ|² that a state has beyond wave numbers that are left in `low`.
pub(super) fn share_beyond(low: &[Complex], state: &Wave<f64>) -> f64 {
    let parts = low.iter().zip(state.q.iter().zip(&state.p));
    let beyond = parts.map(|(low, (q, p))| (Complex::new(*q, *p) - low).norm_sqr());
    beyond.sum::<f64>() / squares(&state.q, &state.p)
}

/// Scales a state whose sum of squares roundings have moved.
fn put_back(now: f64, state: &mut Wave<f64>) {
    let off = (now / state.start - 1.0).abs();
    if (ROUNDINGS.0..ROUNDINGS.1).contains(&off) {
        let factor = (state.start / now).sqrt();
        for value in state.q.iter_mut().chain(&mut state.p) {
            *value *= factor;
        }
    }
}
