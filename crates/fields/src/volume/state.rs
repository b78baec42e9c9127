//! The state of a stepper.

use liouville_base::simd::Stored;

/// The variables of a trajectory, or of several in lock-step.
#[derive(Debug, PartialEq)]
pub struct State<S> {
    /// The variables in the order of the stepper, and room for functions of them.
    pub(super) x: Vec<S>,
    /// Their rounding errors with compensated sums, empty without.
    pub(super) low: Vec<S>,
}

liouville_base::clone_in_place!([S: Clone] State<S> { x, low });

impl<S> State<S> {
    /// The variables and their rounding errors.
    #[inline]
    pub(super) fn parts(&mut self) -> (&mut [S], &mut [S]) {
        (&mut self.x, &mut self.low)
    }
}

liouville_base::checkpoint!([S: Stored] State<S> { x, low });
