//! Exponential back-off: a cheaper solver is left out after a failure, for twice as many steps with each further one.

/// The most steps for which a solver is left out.
const LONGEST: usize = 1023;

/// The back-off of one solver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Backoff {
    left: usize,
    last: usize,
}

impl Backoff {
    /// Whether the solver is left out.
    pub fn is_active(self) -> bool {
        self.left > 0
    }

    /// Whether the solver is left out in this step, which is counted.
    pub fn skip(&mut self) -> bool {
        let is_active = self.is_active();
        self.left = self.left.saturating_sub(1);
        is_active
    }

    /// Records a failure: the solver is left out for twice as many steps as last time.
    pub fn fail(&mut self) {
        self.last = (2 * self.last + 1).min(LONGEST);
        self.left = self.last;
    }

    /// Records a success: the next failure is again the first.
    pub fn succeed(&mut self) {
        self.last = 0;
    }
}

crate::checkpoint!(Backoff { left, last });
