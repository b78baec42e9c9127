//! How long a cheaper way rests after it has failed: each failure in a row doubles the rest.

/// Steps a way rests at most.
const LONGEST: usize = 1023;

/// The rest of one way of solving.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rest {
    left: usize,
    last: usize,
}

impl Rest {
    /// Whether the way is resting.
    pub fn is_on(self) -> bool {
        self.left > 0
    }

    /// Whether the way is resting now, which takes one from the rest.
    pub fn take(&mut self) -> bool {
        let is_on = self.is_on();
        self.left = self.left.saturating_sub(1);
        is_on
    }

    /// Begins another rest, after a failure.
    pub fn begin(&mut self) {
        self.last = (2 * self.last + 1).min(LONGEST);
        self.left = self.last;
    }

    /// Ends the row of failures.
    pub fn end_row(&mut self) {
        self.last = 0;
    }
}

crate::checkpoint!(Rest { left, last });
