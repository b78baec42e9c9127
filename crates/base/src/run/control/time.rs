//! Time as a compensated sum of steps.

use super::StepSizes;

/// The present time, and the steps that led to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CompensatedTime {
    t: f64,
    low: f64,
    t1: f64,
    smallest: f64,
    largest: f64,
}

impl CompensatedTime {
    pub(super) fn new(t0: f64, t1: f64) -> Self {
        Self {
            t: t0,
            low: 0.0,
            t1,
            smallest: f64::INFINITY,
            largest: 0.0,
        }
    }

    pub(super) fn time(&self) -> f64 {
        self.t
    }

    #[allow(clippy::float_cmp)] // the end is set, not computed
    pub(super) fn is_over(&self) -> bool {
        self.t == self.t1
    }

    /// The time left, signed.
    pub(super) fn left(&self) -> f64 {
        (self.t1 - self.t) - self.low
    }

    /// Goes on by a signed step; a step at least as long as the time left reaches the end.
    pub(super) fn advance(&mut self, h: f64) {
        self.smallest = self.smallest.min(h.abs());
        self.largest = self.largest.max(h.abs());
        if h.abs() >= self.left().abs() {
            (self.t, self.low) = (self.t1, 0.0);
            return;
        }
        let step = h + self.low;
        let t = self.t + step;
        let part = t - self.t;
        self.low = (self.t - (t - part)) + (step - part);
        self.t = t;
    }

    /// Goes back, to within the last step.
    pub(super) fn go_back(&mut self, t: f64) {
        if t.to_bits() != self.t.to_bits() {
            (self.t, self.low) = (t, 0.0);
        }
    }

    pub(super) fn sizes(&self, next: f64) -> StepSizes {
        StepSizes {
            smallest: self.smallest,
            largest: self.largest,
            next,
        }
    }
}

crate::checkpoint!(CompensatedTime {
    t,
    low,
    smallest,
    largest
});
