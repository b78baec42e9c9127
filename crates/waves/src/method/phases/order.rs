//! The order by which errors of a split operator fall, as its steps show it.
//!
//! Where V or ψ is rough they fall by less than the order of the method. A step that was refused and is made again by a shorter
//! one shows that.

/// The error of two halves is that part of their difference from a step made as one, at least. With 1/30 errors were at most 0.1
/// of tolerances of 1e-4 and 1e-8 in five smooth potentials; with 1/63, as orders of 6 have it, 5.3 times one of 1e-2 in a pulse.
const RATIO: f64 = 15.0;

/// At the start nothing is seen, and the ratio is this.
const LEAST: f64 = 2.0;

/// No order is seen to be lower than the first of these, and the ratio grows by the second at each step until it is seen again.
const LOWEST: f64 = 0.5;
const FORGOTTEN: f64 = 1.5;

/// The step before one whose ratio is so many times below the largest was too long as well.
const LOW: f64 = 8.0;

/// How many times as large as the error of two halves their difference from a step made as one is, at most and as it is seen.
#[derive(Clone)]
pub(super) struct SeenOrder {
    most: f64,
    ratio: f64,
    /// The last step: its start, its length and the difference.
    last: (f64, f64, f64),
}

impl SeenOrder {
    /// That of short steps by a method of an order.
    pub(super) fn new(order: usize) -> Self {
        let most = (2.0_f64.powf(order as f64) - 1.0).min(RATIO);
        let last = (f64::NAN, 0.0, 0.0);
        Self {
            ratio: LEAST.min(most),
            most,
            last,
        }
    }

    /// The error of halves of a step that differ so much.
    pub(super) fn error(&mut self, (t, h): (f64, f64), apart: f64) -> f64 {
        let (at, longer, more) = self.last;
        self.ratio = (self.ratio * FORGOTTEN).min(self.most);
        if at.to_bits() == t.to_bits() && h.abs() < longer.abs() && apart > 0.0 {
            let order = (more / apart).ln() / (longer / h).ln() - 1.0;
            self.ratio = (order.max(LOWEST).exp2() - 1.0).min(self.most);
        }
        self.last = (t, h, apart);
        apart / self.ratio
    }

    /// Whether errors fall by much less than they should.
    pub(super) fn is_low(&self) -> bool {
        self.ratio * LOW <= self.most
    }
}

// No step is made again after an output, so that the last one is not saved.
liouville_base::checkpoint!(SeenOrder { ratio });
