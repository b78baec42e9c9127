//! The one simplified-Newton iteration: corrections until roundoff, or a reason why not.
//!
//! The equations make one correction at a time; this file decides when to stop.
//! With θ the ratio of successive corrections δ (relative to the size of the solution), the
//! iteration ends when what is still to come, θ δ / (1 − θ), is below the tolerance of its [`Stop`]. Within
//! the noise of its own evaluation δ tells nothing any more: where corrections fall evenly, θ is then that
//! of those above it; where they do not, what falls no more is roundoff. A second
//! correction more than half the first ends it at once: Newton's method may converge from there, but
//! to what solution is anybody's guess. Source: hairer1996, IV.8; deuflhard2004, 2.1.
#![allow(clippy::needless_bitwise_bool)] // a way out would end the loop over members
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for
#![allow(clippy::float_cmp)] // verdicts are whole numbers

mod attempts;
mod block_matrix;
mod broyden;
mod condensed;
mod predictor;
mod reuse;

pub use attempts::{Attempts, Start, attempt};
pub use block_matrix::{BlockGrid, BlockHandle, BlockLayout, BlockMatrix};
pub use broyden::Broyden;
pub use predictor::{Polynomial, Predictor};
pub use reuse::{Renewal, Reuse};

use crate::error::StepError;
use crate::real::Real;
use crate::simd::dispatch_simd;

/// A system of equations in the middle of being solved: one, or those of several members in lock-step.
pub trait Equations<R = f64> {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<R, StepError>;

    /// When to stop.
    fn stop(&self) -> Stop {
        Stop::default()
    }

    /// Keeps what has been found for members, those where this is not zero, that take no further corrections.
    fn keep(&mut self, _members: R) {}

    /// Puts back what was kept for members.
    fn put_back(&mut self, _members: R) {}
}

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
    /// What a symplectic method needs: what is not corrected is of one sign step after step and grows with
    /// their number, roundoff with its root. A ten-thousandth of ε shows as a drift in ten million steps.
    fn default() -> Self {
        Self {
            tolerance: 1e-5 * f64::EPSILON,
            is_even: true,
            least_rate: 0.0,
        }
    }
}

/// Corrections below this fraction may be nothing but roundoff.
const NOISE: f64 = 1e3 * f64::EPSILON;
/// Corrections that fall no more below this are roundoff too, of ill-conditioned matrices.
const LOUD_NOISE: f64 = 1e6 * f64::EPSILON;
/// A first ratio of corrections above this says that the solution found need not be the nearby one.
const NEARBY: f64 = 0.5;

/// Corrects until converged and returns how many corrections that took.
///
/// # Errors
/// [`StepError::NotConverged`] as soon as `most` corrections will not be enough.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<usize, StepError> {
    let mut progress = Progress::new(equations.stop());
    for iterations in 1..=most {
        let size = equations.correct()?;
        let verdict = progress.judge(size, iterations, most);
        if verdict == CONVERGED {
            return Ok(iterations);
        } else if verdict == HOPELESS {
            return Err(StepError::NotConverged { iterations, size });
        }
    }
    Err(StepError::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    })
}

/// How a member of several stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Member {
    /// It is not looked at.
    #[default]
    Out,
    /// It needs further corrections.
    Open,
    /// It took so many corrections.
    Converged(usize),
    /// It does not converge.
    Hopeless {
        /// Corrections made.
        iterations: usize,
        /// Relative size of the last.
        size: f64,
    },
}

/// Corrects several members, those that are [`Member::Open`], until each has converged or will not: by its own
/// corrections, so that it takes as many as it would alone. There is a place for each.
///
/// # Errors
/// A correction could not be made: that may be the error of any of them.
pub fn solve_each<R: Real>(
    equations: &mut impl Equations<R>,
    most: usize,
    members: &mut [Member],
) -> Result<(), StepError> {
    let mut progress = Progress::new(equations.stop());
    let (mut kept, mut has_kept) = (R::splat(0.0), false);
    for iterations in 1..=most {
        let sizes = equations.correct()?;
        let verdicts = dispatch_simd::<R, _>(
            #[inline(always)]
            || progress.judge(sizes, iterations, most),
        );
        if verdicts.all(|verdict| verdict == OPEN) {
            continue;
        }
        let mut done = R::splat(0.0);
        for (member, stands) in members.iter_mut().enumerate() {
            let (verdict, size) = (verdicts.member(member), sizes.member(member));
            if *stands != Member::Open || verdict == OPEN {
                continue;
            }
            *stands = if verdict == CONVERGED {
                done.set_member(member, 1.0);
                Member::Converged(iterations)
            } else {
                Member::Hopeless { iterations, size }
            };
        }
        if !members.contains(&Member::Open) {
            break;
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || equations.keep(done),
        );
        kept += done;
        has_kept = true;
    }
    if has_kept {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || equations.put_back(kept),
        );
    }
    Ok(())
}

/// Never more in lock-step.
const MOST_MEMBERS: usize = 16;

/// Corrects all members until each has converged.
///
/// # Errors
/// [`StepError::NotConverged`] as soon as one of them will not.
pub fn solve_all<R: Real>(equations: &mut impl Equations<R>, most: usize) -> Result<(), StepError> {
    const { assert!(R::MEMBERS <= MOST_MEMBERS, "a place for each member") };
    let mut members = [Member::Open; MOST_MEMBERS];
    let members = &mut members[..R::MEMBERS];
    solve_each(equations, most, members)?;
    let hopeless = members.iter().find_map(|member| match member {
        Member::Hopeless { iterations, size } => Some((*iterations, *size)),
        _ => None,
    });
    hopeless.map_or(Ok(()), |(iterations, size)| {
        Err(StepError::NotConverged { iterations, size })
    })
}

/// How far corrections have come, of each member.
#[derive(Clone, Copy, Debug)]
struct Progress<R> {
    stop: Stop,
    last: R,
    expected: R,
    /// NaN before there is one.
    rate: R,
}

/// Verdicts on the corrections of a member, as numbers: they are found for all members at once.
const OPEN: f64 = 0.0;
const CONVERGED: f64 = 1.0;
const HOPELESS: f64 = 2.0;

impl<R: Real> Progress<R> {
    fn new(stop: Stop) -> Self {
        Self {
            stop,
            last: R::splat(f64::INFINITY),
            expected: R::splat(f64::INFINITY),
            rate: R::splat(f64::NAN),
        }
    }

    /// What another correction, of this size, says.
    #[inline(always)]
    fn judge(&mut self, size: R, iterations: usize, most: usize) -> R {
        let Stop {
            is_even,
            least_rate,
            ..
        } = self.stop;
        let theta = size / self.last;
        // noise hides what is still converging: the rate seen above it is believed
        self.expected = size.zip(
            self.rate * self.expected,
            #[inline(always)]
            |size, rest| {
                if is_even & (size < NOISE) {
                    size.min(rest)
                } else {
                    size
                }
            },
        );
        if iterations > 1 {
            self.rate = R::each(
                [size, theta, self.rate],
                #[inline(always)]
                |[size, theta, rate]| {
                    if is_even & (size < NOISE) {
                        rate
                    } else {
                        theta.max(least_rate)
                    }
                },
            );
        }
        self.last = size;
        let slow = self.too_slow(size, theta, iterations, most);
        let verdict = self.verdict(iterations, most);
        R::each([size, theta, self.rate, self.expected, slow], verdict)
    }

    /// Whether a correction size, θ, the rate, what is expected, and whether it is too slow are those of a
    /// member that has converged or will not.
    #[inline(always)]
    fn verdict(&self, iterations: usize, most: usize) -> impl Fn([f64; 5]) -> f64 + use<R> {
        let Stop {
            tolerance, is_even, ..
        } = self.stop;
        // growing, at its present rate too slow, or started too far away
        let (worst, minds_slow) = match iterations {
            1 => (f64::INFINITY, false),
            2 => (NEARBY.next_up(), false),
            3 => (2.0, false),
            // a Newton iteration may have needed three corrections to find its rate
            _ => (2.0, true),
        };
        let (is_first, is_third) = (iterations == 1, iterations > 2);
        let is_last = iterations == most;
        #[inline(always)]
        move |[size, theta, rate, expected, slow]| {
            let is_noise = size < NOISE;
            let rate_now = if rate.is_nan() { theta } else { rate };
            let is_converged = (size == 0.0)
                | (!is_first & (still_to_come(rate_now, expected) < tolerance))
                | (is_noise & (rate.is_nan() | !is_even) & (theta >= 0.5))
                | (!is_even & is_third & (size < LOUD_NOISE) & (theta >= 0.9))
                | (is_noise & is_last);
            let is_hopeless = (theta >= worst) | (minds_slow & (slow != 0.0));
            if is_converged {
                CONVERGED
            } else if !size.is_finite() | is_last | (!is_noise & is_hopeless) {
                HOPELESS
            } else {
                OPEN
            }
        }
    }

    /// 1 where the corrections left are not enough at the present rate, where that is asked for.
    #[inline(always)]
    fn too_slow(&self, size: R, theta: R, iterations: usize, most: usize) -> R {
        let Stop {
            tolerance, is_even, ..
        } = self.stop;
        if iterations < 4 || !is_even {
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
