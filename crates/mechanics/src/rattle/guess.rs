//! Where λ of a step is looked for: on the cubic through those of the four steps before.

use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::linalg::{add_scaled, copy};

/// λ of steps of one size, as many as a polynomial takes.
const POINTS: usize = 4;

/// By the number of steps known, the weights of the last, the one before it, and so on.
const WEIGHTS: [&[f64]; POINTS] = [
    &[1.0],
    &[2.0, -1.0],
    &[3.0, -3.0, 1.0],
    &[4.0, -6.0, 4.0, -1.0],
];

/// The multipliers of the last steps.
#[derive(Clone, Debug)]
pub(super) struct Guess {
    h: f64,
    /// The last first.
    known: [Vec<f64>; POINTS],
    count: usize,
}

impl Guess {
    pub(super) fn new(m: usize) -> Self {
        Self {
            h: 0.0,
            known: std::array::from_fn(|_| vec![0.0; m]),
            count: 0,
        }
    }

    /// Writes the guess for a step of `h`; says whether there is one.
    pub(super) fn extrapolate(&self, lam: &mut [f64], h: f64) -> bool {
        let is_equal = h.to_bits() == self.h.to_bits();
        let count = if is_equal {
            self.count
        } else {
            self.count.min(1)
        };
        let Some(last) = count.checked_sub(1) else {
            return false;
        };
        lam.fill(0.0);
        for (known, weight) in self.known.iter().zip(WEIGHTS[last]) {
            add_scaled(lam, *weight, known);
        }
        true
    }

    /// Keeps what a step of `h` has found.
    pub(super) fn keep(&mut self, h: f64, lam: &[f64]) {
        if h.to_bits() != self.h.to_bits() {
            (self.h, self.count) = (h, 0);
        }
        self.known.rotate_right(1);
        copy(&mut self.known[0], lam);
        self.count = (self.count + 1).min(POINTS);
    }

    /// The next step starts cold.
    pub(super) fn forget(&mut self) {
        self.count = 0;
    }
}

impl Checkpoint for Guess {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.h.save(member, out);
        self.known.save(member, out);
        self.count.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.h.restore(member, saved)?;
        self.known.restore(member, saved)?;
        self.count.restore(member, saved)?;
        if self.count > POINTS {
            return Err(CheckpointMismatch);
        }
        Ok(())
    }
}
