//! Newton's iteration: with one matrix, or with one for each correction.
//!
//! The equations make one correction at a time; this module decides when to stop. With θ the ratio of
//! successive corrections δ (relative to the size of the solution), the iteration ends when what is still to
//! come, θ δ / (1 − θ), is below the tolerance of its [`Stop`]. Below the noise of its own evaluation δ carries
//! no information: where corrections fall evenly, θ is that of those above the noise; where they do not, what
//! falls no more is roundoff. Corrections that stall above the noise are compared with the floor that
//! roundoff and the condition of the matrix make, which is measured. Sizes in a yardstick fixed for the step
//! tell whether the solution is near its start: if not, it is to be confirmed, see [`attempt`].
//! Source: hairer1996, IV.8; deuflhard2004, 2.1; docs/theory/newton.md.
#![allow(clippy::needless_bitwise_bool)] // a way out would end the loop over members
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for
#![allow(clippy::float_cmp)] // verdicts are whole numbers

mod attempts;
mod block_matrix;
mod broyden;
mod condensed;
mod predictor;
mod progress;
mod rest;
mod reuse;
mod stop;

pub use attempts::{Attempts, Confirms, Slot, Start, attempt, attempt_modified};
pub use block_matrix::{BlockGrid, BlockHandle, BlockLayout, BlockMatrix};
pub use broyden::Broyden;
pub use predictor::{Continuation, Polynomial, Predictor};
pub use rest::Rest;
pub use reuse::{Renewal, Reuse};
pub use stop::{Stop, reach};

use crate::error::StepError;
use crate::real::Real;
use crate::simd::dispatch_simd;
use progress::{CONVERGED, HOPELESS, OPEN, Progress};

/// A system of equations in the middle of being solved: one, or those of several members in lock-step.
pub trait Equations<R: Real = f64> {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<R, StepError>;

    /// When to stop.
    fn stop(&self) -> Stop {
        Stop::default()
    }

    /// The size of the last correction in a yardstick fixed for the step, of which `size` is the relative one.
    fn reach(&self, _size: R) -> R {
        R::splat(0.0)
    }

    /// How far the unknowns last evaluated place the coordinates from the still start, in that yardstick.
    fn moved(&self) -> R {
        R::splat(0.0)
    }

    /// Lets the next correction have a matrix of its own.
    fn refresh(&mut self) {}

    /// Whether the residual is within what a few ε in the data make of it.
    ///
    /// # Errors
    /// A value is not finite.
    fn is_solved(&mut self) -> Result<bool, StepError> {
        Ok(true)
    }

    /// The largest relative correction that roundoff in the unknowns makes.
    ///
    /// # Errors
    /// A value is not finite.
    fn floor(&mut self) -> Result<f64, StepError> {
        Ok(0.0)
    }

    /// Keeps what has been found for members, those where this is not zero, that take no further corrections.
    fn keep(&mut self, _members: R) {}

    /// Puts back what was kept for members.
    fn put_back(&mut self, _members: R) {}
}

/// A correction of more than this part of the yardstick is no small one: its ratio to others says nothing.
const FAR: f64 = 0.1;
/// Coordinates that are moved by more than this part of the yardstick may be on another branch.
const MOVED: f64 = 0.5;
/// One ratio of corrections is not believed where the first is larger than this.
const DOUBTFUL: f64 = 1e-3;
/// Corrections below this are small enough for the residual to be looked at, and for the floor to be measured.
const SMALL: f64 = 1e-6;
/// Corrections of this many floors, when they fall no more, are roundoff.
const FLOORS: f64 = 8.0;
/// Matrices that full Newton makes, and corrections.
const MOST_MATRICES: usize = 12;
const MOST_FULL: usize = 40;
/// Newton's method comes to a double root by halves: ratios of corrections between these, so many in a row.
const HALF: std::ops::Range<f64> = 0.4..0.6;
const HALVES: usize = 4;

/// Units of ε that unknowns are moved by to see what residuals roundoff leaves.
pub const SHAKE: f64 = 4.0;
/// How many times that a residual may be.
pub const MARGIN: f64 = 16.0;

/// Signs that follow no pattern, the same in every run: what roundoff does is seen by moving unknowns with them.
pub fn signs(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        let next = state.wrapping_mul(6_364_136_223_846_793_005);
        state = next.wrapping_add(1_442_695_040_888_963_407);
        if state >> 63 == 0 { 1.0 } else { -1.0 }
    }
}

/// What an iteration that converged has found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Solved {
    /// Corrections made.
    pub iterations: usize,
    /// Whether all corrections were small, and the solution is near the still start.
    pub is_near: bool,
}

/// How far an iteration has gone, of each member.
#[derive(Clone, Copy, Debug)]
struct Reach<R> {
    largest: R,
    /// A bound of the distance from the still start.
    moved: R,
}

impl<R: Real> Reach<R> {
    fn new() -> Self {
        let (largest, moved) = (R::splat(0.0), R::splat(0.0));
        Self { largest, moved }
    }

    /// What another correction adds; the first one has evaluated the start.
    #[inline(always)]
    fn add(&mut self, equations: &impl Equations<R>, size: R, iterations: usize) {
        let reach = equations.reach(size);
        if iterations == 1 {
            self.moved = equations.moved();
        }
        self.largest = self.largest.zip(reach, f64::max);
        self.moved += reach;
    }

    /// 1 where all corrections were small and the solution is near, else 0.
    #[inline(always)]
    fn is_near(&self) -> R {
        self.largest.zip(
            self.moved,
            #[inline(always)]
            |largest, moved| f64::from(u8::from((largest <= FAR) & (moved <= MOVED))),
        )
    }

    /// 1 where one ratio of corrections says too little.
    #[inline(always)]
    fn is_doubtful(&self, iterations: usize) -> R {
        if iterations != 2 {
            return R::splat(0.0);
        }
        self.largest.map(
            #[inline(always)]
            |largest| f64::from(u8::from(largest > DOUBTFUL)),
        )
    }
}

/// Corrects with one matrix until converged.
///
/// # Errors
/// [`StepError::NotConverged`] as soon as `most` corrections will not be enough, or where the residual shows
/// that they only seemed to converge.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<Solved, StepError> {
    let mut progress = Progress::new(equations.stop());
    let mut reach = Reach::new();
    for iterations in 1..=most {
        let size = equations.correct()?;
        reach.add(equations, size, iterations);
        let verdict = progress.judge(size, iterations, most);
        let failed = StepError::NotConverged { iterations, size };
        let is_converged = if verdict == CONVERGED {
            reach.is_doubtful(iterations) == 0.0 || equations.is_solved()?
        } else if verdict == HOPELESS {
            iterations < most && is_at_floor(equations, size)? && equations.is_solved()?
        } else {
            continue;
        };
        if !is_converged {
            return Err(failed);
        }
        let is_near = reach.is_near() != 0.0;
        return Ok(Solved {
            iterations,
            is_near,
        });
    }
    Err(StepError::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    })
}

/// Whether corrections that fall no more are what roundoff makes of them.
#[cold]
fn is_at_floor(equations: &mut impl Equations, size: f64) -> Result<bool, StepError> {
    Ok(size < SMALL && size <= FLOORS * equations.floor()?.min(SMALL))
}

/// Corrects with a matrix for each correction, until the residual is roundoff. Corrections may grow in between:
/// a stretched spring first loses its tension.
///
/// # Errors
/// [`StepError::NotConverged`] where that takes too many, or goes to a double root: there branches meet.
pub fn solve_full(equations: &mut impl Equations) -> Result<Solved, StepError> {
    let (mut largest, mut size, mut halves) = (0.0_f64, f64::INFINITY, 0);
    for iterations in 1..=MOST_FULL {
        let is_fresh = iterations <= MOST_MATRICES;
        if is_fresh {
            equations.refresh();
        }
        let last = size;
        size = equations.correct()?;
        let is_half = is_fresh && HALF.contains(&(size / last));
        halves = if is_half { halves + 1 } else { 0 };
        if !size.is_finite() || halves == HALVES {
            return Err(StepError::NotConverged { iterations, size });
        }
        let reach = equations.reach(size);
        largest = largest.max(reach);
        if size.max(reach) <= SMALL && equations.is_solved()? {
            let is_near = largest <= FAR && equations.moved() <= MOVED;
            return Ok(Solved {
                iterations,
                is_near,
            });
        }
    }
    Err(StepError::NotConverged {
        iterations: MOST_FULL,
        size,
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
    /// It does not converge, or is not taken on trust.
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
    let mut reach = Reach::new();
    for iterations in 1..=most {
        let sizes = equations.correct()?;
        dispatch_simd::<R, _>(
            #[inline(always)]
            || reach.add(equations, sizes, iterations),
        );
        let verdicts = dispatch_simd::<R, _>(
            #[inline(always)]
            || progress.judge(sizes, iterations, most),
        );
        if verdicts.all(|verdict| verdict == OPEN) {
            continue;
        }
        let (is_near, is_doubtful) = (reach.is_near(), reach.is_doubtful(iterations));
        let mut done = R::splat(0.0);
        for (member, stands) in members.iter_mut().enumerate() {
            let (verdict, size) = (verdicts.member(member), sizes.member(member));
            if *stands != Member::Open || verdict == OPEN {
                continue;
            }
            let is_trusted = is_near.member(member) != 0.0 && is_doubtful.member(member) == 0.0;
            *stands = if verdict == CONVERGED && is_trusted {
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
