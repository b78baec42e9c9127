//! Broyden's update of corrections by one matrix.
//!
//! With δ the correction by the matrix and s_0, …, s_k those already made,
//!
//!     δ ← δ + s_{j+1} (s_j, δ)/(s_j, s_j)   for j < k,      s_{k+1} = δ / (1 − (s_k, δ)/(s_k, s_k))
//!
//! which converges superlinearly where the matrix alone converges linearly. Source: kelley1995, algorithm 7.3.1.

use crate::linalg::{add_scaled, copy, dot};

/// Corrections remembered; then the memory starts anew.
const DEPTH: usize = 8;
/// Largest factor 1 / (1 − (s_k, δ)/(s_k, s_k)).
const MOST_STRETCH: f64 = 4.0;

/// The corrections of one iteration.
#[derive(Clone, Debug)]
pub struct Broyden {
    made: Vec<Vec<f64>>,
    squares: [f64; DEPTH],
    count: usize,
    /// The number of leading elements in inner products.
    width: usize,
}

impl Broyden {
    /// Memory for corrections of this size, whose inner products are over their first `width` elements.
    pub fn new(size: usize, width: usize) -> Self {
        Self {
            made: vec![vec![0.0; size]; DEPTH],
            squares: [0.0; DEPTH],
            count: 0,
            width,
        }
    }

    /// Forgets all corrections, where another iteration begins.
    pub fn restart(&mut self) {
        self.count = 0;
    }

    /// Improves a correction in place, and remembers it.
    pub fn improve(&mut self, correction: &mut [f64]) {
        let width = self.width;
        let share = |made: &[f64], square: f64, correction: &[f64]| {
            dot(&made[..width], &correction[..width]) / square
        };
        if self.count == DEPTH {
            self.count = 0;
        }
        if let Some(last) = self.count.checked_sub(1) {
            for j in 0..last {
                let along = share(&self.made[j], self.squares[j], correction);
                add_scaled(correction, along, &self.made[j + 1]);
            }
            let stretch = 1.0 / (1.0 - share(&self.made[last], self.squares[last], correction));
            if stretch > 0.0 && stretch < MOST_STRETCH {
                for x in correction.iter_mut() {
                    *x *= stretch;
                }
            } else {
                self.count = 0;
            }
        }
        let square = dot(&correction[..width], &correction[..width]);
        if square > 0.0 && square.is_finite() {
            copy(&mut self.made[self.count], correction);
            self.squares[self.count] = square;
            self.count += 1;
        }
    }
}
