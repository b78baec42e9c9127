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

/// A proposed step has about this part of the length that is within the tolerance, ...
const SAFETY: f64 = 0.9;
/// ... as a power of 2^(1/4) times the last one, since a new length takes new tables; these are the least and the largest.
const POWERS: (f64, f64) = (-12.0, 8.0);
const PER_OCTAVE: f64 = 4.0;

/// Lengths that differ by so many roundings of the time are one, whose tables are there.
const SAME: f64 = 4.0 * f64::EPSILON;

/// How many times as large as the error of two halves their difference from a step made as one is, at most and as it is seen.
#[derive(Clone)]
pub(super) struct SeenOrder {
    order: f64,
    most: f64,
    ratio: f64,
    /// The last step: its start, its length and the difference.
    last: (f64, f64, f64),
}

impl SeenOrder {
    /// That of short steps by a method of an order.
    pub(super) fn new(order: usize) -> Self {
        let order = order as f64;
        let most = (order.exp2() - 1.0).min(RATIO);
        let last = (f64::NAN, 0.0, 0.0);
        Self {
            order,
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

    /// The length of the step after one whose error is to change by a factor.
    pub(super) fn next(&self, last: f64, factor: f64) -> f64 {
        let longer = SAFETY * factor.powf(1.0 / self.order);
        let (least, largest) = POWERS;
        // no number where the error is none
        let power = (PER_OCTAVE * longer.log2()).floor().max(least).min(largest);
        let power = if factor >= 1.0 {
            power.max(0.0)
        } else {
            power.min(-1.0)
        };
        last.abs() * (power / PER_OCTAVE).exp2()
    }

    /// Whether errors fall by much less than they should.
    pub(super) fn is_low(&self) -> bool {
        self.ratio * LOW <= self.most
    }
}

/// The next step from t on where so much is left: equal parts of it, and the same bits as the last one where it has its length.
pub(super) fn parted((t, left): (f64, f64), next: f64, last: f64) -> f64 {
    let parts = (left.abs() / next * (1.0 - f64::EPSILON)).ceil().max(1.0);
    let h = left / parts;
    let is_same = (h - last).abs() <= SAME * t.abs().max((t + left).abs());
    if is_same { last } else { h }
}

// No step is made again after an output, so that the last one is not saved.
liouville_base::checkpoint!(SeenOrder { ratio });
