//! The stopping rule of an iteration, and the units of its corrections.

use crate::real::{Real, Scalar};

/// Bounds of the number of steps: a run of fewer may be one of many that continue each other.
const FEW_STEPS: f64 = 1e4;
const MANY_STEPS: f64 = 1e8;

/// Errors left by corrections above this are larger than rounding errors.
const NEAR: f64 = 1e-6;
/// Corrections of a projection that fall more slowly are roundoff; so is what is below this part of a point.
const SLOWEST: f64 = 0.5;
const LAST_BIT: f64 = 0.25 * f64::EPSILON;
/// No iteration to roundoff ends with a correction of this size, and roundings are far below it.
const ROUGH: f64 = 1e-9;

/// The stopping rule of an iteration; sizes are fractions of the solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The iteration ends where the sum of all further corrections is expected below this.
    pub tolerance: f64,
    /// Whether the rate of convergence is steady, so that the one measured above the noise holds below it.
    pub has_steady_rate: bool,
    /// Lower bound of the measured rates.
    pub min_rate: f64,
}

impl Default for Stop {
    /// For an unknown number of steps, which may be large.
    fn default() -> Self {
        Self::of_run(1e7)
    }
}

impl Stop {
    /// For a symplectic method in a run of so many steps: the remaining errors of the iteration have one sign and grow
    /// with the number of steps, roundoff with its square root. At the end they are a quarter of roundoff, as measured.
    pub fn of_run(steps: f64) -> Self {
        let steps = steps.clamp(FEW_STEPS, MANY_STEPS);
        Self {
            tolerance: 0.03 * f64::EPSILON / steps.sqrt(),
            has_steady_rate: true,
            min_rate: 0.0,
        }
    }

    /// Corrections above which a step is too long for its iteration: at the length that costs least for its time an
    /// iteration makes so many, as its rate is then about 0.3 for any tolerance.
    pub fn most_corrections(&self) -> f64 {
        2.0 - self.tolerance.ln() / 5.0
    }

    /// 1 where rounding errors of a residual are to be computed, else 0, after a correction of this relative size: the error
    /// left by a large one is far above them.
    #[inline(always)]
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    pub fn wants_roundings<R: Real>(&self, size: R) -> R {
        let is_roundoff = self.is_roundoff();
        size.map(
            #[inline(always)]
            |size| f64::from(u8::from(is_roundoff & (size < NEAR))),
        )
    }

    /// The size of a correction, bounded below where rounding errors are computed later, so that another follows.
    #[inline(always)]
    #[allow(clippy::inline_always)]
    pub fn with_roundings<R: Real>(&self, size: R, wanted: R) -> R {
        let least = if self.is_roundoff() { ROUGH } else { 0.0 };
        size.zip(
            wanted,
            #[inline(always)]
            |size, wanted| {
                if wanted == 0.0 && size < least {
                    least
                } else {
                    size
                }
            },
        )
    }

    /// Whether the equations are solved to roundoff.
    pub fn is_roundoff(&self) -> bool {
        self.tolerance < f64::EPSILON
    }
}

/// The corrections with one matrix that project a point onto constraints: each member takes them until the next one is
/// expected below the last bit.
#[derive(Clone, Copy, Debug)]
pub struct Projection<R> {
    /// 1 for members that take the next correction, else 0.
    wanted: R,
    /// The size of the last correction.
    last: R,
}

impl<R: Real> Projection<R> {
    /// The projection at the end of a step whose equations are solved so far; none where they are solved to roundoff.
    pub fn new(stop: Stop) -> Self {
        Self {
            wanted: R::splat(f64::from(u8::from(!stop.is_roundoff()))),
            last: R::splat(f64::INFINITY),
        }
    }

    /// Whether a member takes another correction.
    #[inline(always)]
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    pub fn is_wanted(&self) -> bool {
        !self.wanted.all(
            #[inline(always)]
            |wanted| wanted == 0.0,
        )
    }

    /// 1 for members that take a correction of this size, else 0; points are as large as `unit`.
    #[inline(always)]
    #[allow(clippy::inline_always)]
    pub fn take(&mut self, size: R, unit: R) -> R {
        let taken = self.wanted;
        self.wanted = R::each(
            [taken, size, self.last, unit],
            #[inline(always)]
            |[taken, size, last, unit]| {
                // nothing is known of the rate at first
                let rate = if last == f64::INFINITY {
                    1.0
                } else {
                    size / last
                };
                let converges = last == f64::INFINITY || rate < SLOWEST;
                let follows = converges && size * rate > LAST_BIT * unit;
                if follows { taken } else { 0.0 }
            },
        );
        self.last = size;
        taken
    }
}

/// An acceleration and a length whose roundings the motion itself may not show.
#[derive(Clone, Copy, Debug)]
pub struct Borne<R> {
    /// The largest acceleration that forces and reactions take from one another.
    pub acceleration: R,
    /// The length whose roundings are those of constraints, negative where it is known and not needed; else 0.
    pub length: R,
}

impl Borne<f64> {
    /// The acceleration whose roundings are those of a step of h.
    pub fn rate(&self, h: f64) -> f64 {
        self.acceleration.max(self.length / (h * h))
    }
}

impl<R: Real> Borne<R> {
    /// Nothing is borne.
    pub fn nothing() -> Self {
        let [acceleration, length] = [R::splat(0.0); 2];
        Self {
            acceleration,
            length,
        }
    }

    /// The speed whose roundings are those of a step of h.
    #[inline(always)]
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    pub fn speed(&self, h: f64) -> R {
        (self.acceleration * h.abs()).zip(
            self.length / R::splat(h.abs()),
            #[inline(always)]
            |by_forces: f64, by_length| by_forces.max(by_length),
        )
    }
}

crate::checkpoint!([R: Scalar] Borne<R> { acceleration, length });

/// Motions below so many roundings of what is borne are themselves roundoff.
const BORNE: f64 = 4096.0 * f64::EPSILON;

/// The yardstick of a step by the size of the motion itself; 0, for none, where that is but roundoff of what forces and
/// reactions would each do alone.
#[inline(always)]
#[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
pub fn own_yardstick<R: Real>(motion: R, borne: R) -> R {
    motion.zip(
        borne,
        #[inline(always)]
        |motion, borne| {
            if motion > BORNE * borne { motion } else { 0.0 }
        },
    )
}

/// A size relative to a speed, in a yardstick; 0 where there is none.
#[inline(always)]
#[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
pub fn scaled_size<R: Real>(size: R, speed: R, yardstick: R) -> R {
    R::each(
        [size, speed, yardstick],
        #[inline(always)]
        |[size, speed, yardstick]| {
            let scaled = size * (speed / yardstick);
            if size == 0.0 || yardstick == 0.0 {
                0.0
            } else {
                scaled
            }
        },
    )
}
