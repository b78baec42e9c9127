//! The start value of λ: extrapolated by the cubic through λ of the four steps before.

use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::linalg::copy;
use liouville_base::newton::{Polynomial, Predictor};

/// λ of steps of one size, the last first, in units of that size before it.
const NODES: [f64; 4] = [0.0, -1.0, -2.0, -3.0];

/// The multipliers of the last steps.
#[derive(Clone, Debug)]
pub(super) struct Guess {
    held: Predictor,
    count: usize,
}

impl Guess {
    pub(super) fn new(m: usize) -> Self {
        Self {
            held: Predictor::new(vec![Polynomial::new(&NODES, &[0.0], m)]),
            count: 0,
        }
    }

    /// Writes the guess for a step of `h`; says whether there is one.
    pub(super) fn extrapolate(&mut self, lam: &mut [f64], h: f64) -> bool {
        let is_equal = self
            .held
            .h()
            .is_some_and(|last| last.to_bits() == h.to_bits());
        let count = if is_equal {
            self.count
        } else {
            self.count.min(1)
        };
        self.held.pass_through(count);
        let is_held = count > 0 && self.held.update_weights(h);
        if is_held {
            self.held.curves[0].extrapolate(lam);
        }
        is_held
    }

    /// Keeps λ of a step of `h`.
    pub(super) fn keep(&mut self, h: f64, lam: &[f64]) {
        let is_equal = self
            .held
            .h()
            .is_some_and(|last| last.to_bits() == h.to_bits());
        let known = if is_equal { self.count } else { 0 };
        let values = &mut self.held.curves[0].values;
        values.flat_mut().rotate_right(lam.len());
        copy(values.row_mut(0), lam);
        self.held.hold(h);
        self.count = (known + 1).min(NODES.len());
    }

    /// The next step starts cold.
    pub(super) fn forget(&mut self) {
        self.count = 0;
    }
}

liouville_base::checkpoint!(Guess { held, count } then |guess| {
    if guess.count > NODES.len() {
        return Err(CheckpointMismatch);
    }
    Ok(())
});
