//! When an iteration ends, and in which units its corrections are measured.

use crate::real::Real;

/// A run of fewer steps may be one of many, each of which begins where another ends.
const FEW_STEPS: f64 = 1e4;
const MANY_STEPS: f64 = 1e8;

/// What ends an iteration, as fractions of the solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Corrections still expected below this are not made.
    pub tolerance: f64,
    /// Whether corrections fall at an even rate, so that the one seen above the noise holds below it.
    pub is_even: bool,
    /// No rate below this is believed.
    pub least_rate: f64,
}

impl Default for Stop {
    /// For steps whose number is not known, but may be large.
    fn default() -> Self {
        Self::of_run(1e7)
    }
}

impl Stop {
    /// What a symplectic method needs in a run of so many steps: what is not corrected is of one sign step after step
    /// and grows with their number, roundoff with its root. At the end it is a quarter of that, as measured.
    pub fn of_run(steps: f64) -> Self {
        let steps = steps.clamp(FEW_STEPS, MANY_STEPS);
        Self {
            tolerance: 0.03 * f64::EPSILON / steps.sqrt(),
            is_even: true,
            least_rate: 0.0,
        }
    }

    /// Whether no more than roundoff is left out.
    pub fn is_roundoff(&self) -> bool {
        self.tolerance < f64::EPSILON
    }

    /// How many corrections with one matrix move y1 onto the constraints, each by a factor of about the tolerance; the
    /// same for all members.
    pub fn projections(&self) -> usize {
        if self.is_roundoff() {
            return 0;
        }
        let falls = (1..).take_while(|i| self.tolerance.powi(*i) > f64::EPSILON);
        falls.count() + 1
    }
}

/// A size relative to a speed, in a yardstick; 0 where there is none.
#[inline(always)]
#[allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for
pub fn reach<R: Real>(size: R, speed: R, yardstick: R) -> R {
    R::each(
        [size, speed, yardstick],
        #[inline(always)]
        |[size, speed, yardstick]| {
            let reach = size * (speed / yardstick);
            if size == 0.0 || yardstick == 0.0 {
                0.0
            } else {
                reach
            }
        },
    )
}
