//! Convergence test by the sizes of corrections, of each member.
#![allow(clippy::needless_bitwise_bool)] // short-circuiting would end the loop over members
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::{SMALL_CORRECTION, Stop};
use crate::real::Real;

/// Corrections below this fraction of the solution may be roundoff alone.
const NOISE: f64 = 1e3 * f64::EPSILON;
/// A ratio below the noise is taken for a rate where it is at most this multiple of the last rate, and at most
/// [`LARGEST_RATE`]: rates may vary, and ratios of roundoff are larger.
const GROWTH: f64 = 2.0;
const LARGEST_RATE: f64 = 0.5;
/// Above this first ratio of corrections the iteration may converge to a distant solution.
const NEARBY: f64 = 0.5;

/// The ratios of corrections so far, of each member.
#[derive(Clone, Copy, Debug)]
pub(super) struct Progress<R> {
    stop: Stop,
    last: R,
    expected: R,
    /// The rate of convergence, NaN before the second correction.
    rate: R,
    /// The least ratio of corrections: roundoff makes ratios larger than the rate, not smaller.
    least: R,
}

/// Verdicts on the corrections of a member, as numbers: they are found for all members at once.
pub(super) const ACTIVE: f64 = 0.0;
pub(super) const CONVERGED: f64 = 1.0;
pub(super) const FAILED: f64 = 2.0;

impl<R: Real> Progress<R> {
    pub(super) fn new(stop: Stop) -> Self {
        Self {
            stop,
            last: R::splat(f64::INFINITY),
            expected: R::splat(f64::INFINITY),
            rate: R::splat(f64::NAN),
            least: R::splat(f64::INFINITY),
        }
    }

    /// The verdict after another correction of this size.
    #[inline(always)]
    pub(super) fn judge(&mut self, size: R, iterations: usize, most: usize) -> R {
        let Stop {
            has_steady_rate,
            min_rate,
            ..
        } = self.stop;
        let theta = size / self.last;
        if iterations > 1 {
            self.least = self.least.zip(theta, f64::min);
        }
        // below the noise, the rate measured above it holds
        let rate = R::each(
            [size, theta, self.rate],
            #[inline(always)]
            |[size, theta, rate]| {
                let is_believed = theta <= (GROWTH * rate).min(LARGEST_RATE);
                if !(has_steady_rate & (size < NOISE)) {
                    theta.max(min_rate)
                } else if is_believed & !rate.is_nan() {
                    theta.max(rate)
                } else {
                    rate
                }
            },
        );
        if iterations > 1 {
            self.rate = rate;
        }
        self.expected = R::each(
            [size, self.rate * self.expected],
            #[inline(always)]
            |[size, rest]| {
                if has_steady_rate & (size < NOISE) {
                    size.min(rest)
                } else {
                    size
                }
            },
        );
        self.last = size;
        let slow = self.too_slow(size, theta, iterations, most);
        let verdict = self.verdict(iterations, most);
        R::each(
            [size, theta, self.least, self.rate, self.expected, slow],
            verdict,
        )
    }

    /// The verdict on one member, by the size of its correction, θ, the least θ, the rate, the expected size, and whether
    /// it is too slow.
    #[inline(always)]
    fn verdict(&self, iterations: usize, most: usize) -> impl Fn([f64; 6]) -> f64 + use<R> {
        let Stop {
            tolerance,
            has_steady_rate,
            ..
        } = self.stop;
        // the ratio at which the iteration has failed, and whether a low rate is a failure
        let (worst, checks_rate) = match iterations {
            1 => (f64::INFINITY, false),
            2 => (NEARBY.next_up(), false),
            3 => (2.0, false),
            // a Newton iteration may have needed three corrections to find its rate
            _ => (2.0, true),
        };
        let (is_first, is_third) = (iterations == 1, iterations > 2);
        let is_last = iterations == most;
        #[inline(always)]
        move |[size, theta, least, rate, expected, slow]| {
            let is_noise = size < NOISE;
            let rate_now = if rate.is_nan() { least } else { rate };
            let is_converged = (size == 0.0)
                | (!is_first & (still_to_come(rate_now, expected) < tolerance))
                | (is_noise & (rate.is_nan() | !has_steady_rate) & ((theta >= 0.5) | is_last));
            let is_stalled =
                !has_steady_rate & is_third & (size < SMALL_CORRECTION) & (theta >= 0.9);
            let has_failed = (theta >= worst) | is_stalled | (checks_rate & (slow != 0.0));
            if is_converged {
                CONVERGED
            } else if !size.is_finite() | is_last | (!is_noise & has_failed) {
                FAILED
            } else {
                ACTIVE
            }
        }
    }

    /// 1 where the remaining corrections are not enough at the present rate, if that is steady.
    #[inline(always)]
    fn too_slow(&self, size: R, theta: R, iterations: usize, most: usize) -> R {
        let Stop {
            tolerance,
            has_steady_rate,
            ..
        } = self.stop;
        if iterations < 4 || !has_steady_rate {
            return R::splat(0.0);
        }
        let to_come = theta.zip(size, still_to_come) * power(theta, most - iterations);
        to_come.map(
            #[inline(always)]
            |size| f64::from(u8::from(size > tolerance)),
        )
    }
}

/// The sum of all corrections after one of size `size`, at this rate.
#[inline(always)]
fn still_to_come(rate: f64, size: f64) -> f64 {
    let sum = rate * size / (1.0 - rate);
    if rate < 1.0 { sum } else { f64::INFINITY }
}

/// x^n, by squares.
#[inline(always)]
fn power<R: Real>(x: R, mut n: usize) -> R {
    let (mut square, mut power) = (x, R::splat(1.0));
    while n > 0 {
        if n % 2 == 1 {
            power *= square;
        }
        square *= square;
        n /= 2;
    }
    power
}
