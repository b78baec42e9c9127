//! Newton's method: modified, with one matrix for all corrections, or full, with a matrix for each.
//!
//! A type that implements [`Equations`] makes one correction at a time; this module decides when to stop. With θ the
//! ratio of successive corrections δ (relative to the size of the solution), the iteration ends when the sum of all
//! further corrections, at most θ δ / (1 − θ), is below the tolerance of its [`Stop`]. Corrections below the noise of
//! the evaluation carry no information. Where the rate of convergence is steady, θ is taken from corrections above the
//! noise; otherwise corrections that no longer shrink there are taken for roundoff. Corrections that stall above the
//! noise are compared with their roundoff floor, which depends on the condition of the matrix and is measured. Sizes
//! in a yardstick fixed for the step decide whether the solution is near its start: if not, [`attempt`] checks that it
//! lies on the branch of the present state.
//! Source: hairer1996, IV.8; deuflhard2004, 2.1; docs/theory/newton.md.
#![allow(clippy::needless_bitwise_bool)] // short-circuiting would end the loop over members
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
#![allow(clippy::float_cmp)] // verdicts are small integers

mod attempts;
mod backoff;
mod block_matrix;
mod broyden;
mod condensed;
mod damped;
mod full;
mod predictor;
mod progress;
mod reuse;
mod signs;
mod stop;
mod units;

pub use attempts::{Attempts, BranchAttempts, Slot, Start, attempt, attempt_modified};
pub use backoff::Backoff;
pub use block_matrix::{BlockGrid, BlockHandle, BlockLayout, BlockMatrix};
pub use broyden::Broyden;
pub use damped::{Damped, solve_damped};
pub use full::solve_full;
pub use predictor::{Continuation, Polynomial, Predictor};
pub use reuse::{Renewal, Reuse};
pub use signs::Signs;
pub use stop::{Borne, Projection, Stop, own_yardstick, scaled_size};

use crate::error::StepError;
use crate::real::Real;
use crate::simd::dispatch_simd;
use progress::{ACTIVE, CONVERGED, FAILED, Progress};

/// A system of equations with its present unknowns: of one trajectory, or of several members in lock-step.
pub trait Equations<R: Real = f64> {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<R, StepError>;

    /// The stopping rule.
    fn stop(&self) -> Stop {
        Stop::default()
    }

    /// The last correction, whose relative size is `size`, in the yardstick of the step.
    fn scaled_size(&self, _size: R) -> R {
        R::splat(0.0)
    }

    /// Distance of the coordinates at the last evaluation from uniform motion, in the yardstick of the step.
    fn deviation(&self) -> R {
        R::splat(0.0)
    }

    /// Whether the determinant of the last matrix has another sign than that of a small step, if that is known. It is
    /// then not made on the branch of the present state, unless that has folded. Where it takes factors to know, they are
    /// made only if a correction was so large that the solution is doubtful.
    fn is_reversed(&mut self, _is_doubtful: bool) -> bool {
        false
    }

    /// Not 0 for members whose matrix has pivots of other signs than that of a small step: what it finds may be on another
    /// branch.
    fn reversed(&self) -> R {
        R::splat(0.0)
    }

    /// Whether the last correction, of equations without constraints, is against its residual: it does negative work, as
    /// none does with the symmetric matrix of a step before its branch may fold.
    fn is_against(&self) -> bool {
        false
    }

    /// Discards the matrix: the next correction makes its own.
    fn refresh(&mut self) {}

    /// Whether the residual is no larger than its change by a few ε in the data.
    ///
    /// # Errors
    /// A value is not finite.
    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        Ok(true)
    }

    /// The largest relative correction that roundoff in the unknowns makes.
    ///
    /// # Errors
    /// A value is not finite.
    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        Ok(0.0)
    }

    /// Keeps the unknowns of members, those where `members` is not zero, that take no further corrections.
    fn keep(&mut self, _members: R) {}

    /// Puts the kept unknowns of these members back.
    fn put_back(&mut self, _members: R) {}
}

/// Corrections above this fraction of the yardstick are large: their ratios do not bound the rate.
const LARGE_CORRECTION: f64 = 0.1;
/// Coordinates further from uniform motion than this fraction of the yardstick may be on another branch.
const LARGE_DEVIATION: f64 = 0.5;
/// A single ratio of corrections is not sufficient where the first correction is larger than this: another follows. A
/// solution is doubtful where a correction is.
const DOUBTFUL: f64 = 1e-3;
/// Corrections below this are small enough for the residual to be checked, and for the floor to be measured.
const SMALL_CORRECTION: f64 = 1e-6;
/// Corrections below this many floors are roundoff, where they no longer shrink.
const MOST_FLOORS: f64 = 8.0;
/// Solutions that are nearer than this to uniform motion, and found by smaller corrections, are not judged by their matrix:
/// a state of equilibrium is a solution for every h.
const UNMOVED: f64 = 1e-6;
/// Corrections below this part of the yardstick move no coordinate but by roundings.
const UNSEEN: f64 = 64.0 * f64::EPSILON;
/// Perturbation of the unknowns, in ε, that measures the roundoff of residuals.
pub const PERTURBATION: f64 = 4.0;
/// Ratio up to which a residual is roundoff by that measure.
pub const RESIDUAL_MARGIN: f64 = 16.0;

/// Pseudo-random signs, the same in every run, by which unknowns are perturbed.
pub fn random_signs(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        let next = state.wrapping_mul(6_364_136_223_846_793_005);
        state = next.wrapping_add(1_442_695_040_888_963_407);
        if state >> 63 == 0 { 1.0 } else { -1.0 }
    }
}

/// The outcome of an iteration that converged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Solved {
    /// Corrections made.
    pub iterations: usize,
    /// Whether all corrections were small, and the solution is near uniform motion.
    pub is_near: bool,
    /// Whether the equations are nearly linear from the start to the solution, by the ratio of the first corrections.
    pub is_straight: bool,
}

/// The path length of an iteration, of each member.
#[derive(Clone, Copy, Debug)]
struct PathLength<R> {
    largest: R,
    /// Whether a correction of a single trajectory was against its residual.
    is_against: bool,
    /// A bound of the distance from uniform motion.
    deviation: R,
}

impl<R: Real> PathLength<R> {
    fn new() -> Self {
        let (largest, deviation) = (R::splat(0.0), R::splat(0.0));
        Self {
            largest,
            is_against: false,
            deviation,
        }
    }

    /// Adds a correction; the first one has evaluated the start.
    #[inline(always)]
    fn add(&mut self, equations: &impl Equations<R>, size: R, iterations: usize) {
        let scaled = equations.scaled_size(size);
        if iterations == 1 {
            self.deviation = equations.deviation();
        }
        self.largest = self.largest.zip(scaled, f64::max);
        if R::IS_SINGLE && scaled.member(0) > UNMOVED {
            self.is_against |= equations.is_against();
        }
        self.deviation += scaled;
    }

    /// 1 where all corrections were small and the solution is near, by a matrix that is not reversed, else 0.
    #[inline(always)]
    fn is_near(&self, reversed: R) -> R {
        R::each(
            [self.largest, self.deviation, reversed],
            #[inline(always)]
            |[largest, deviation, reversed]| {
                let is_moved = (largest > UNMOVED) | (deviation > UNMOVED);
                f64::from(u8::from(
                    (largest <= LARGE_CORRECTION)
                        & (deviation <= LARGE_DEVIATION)
                        & !(is_moved & (reversed != 0.0)),
                ))
            },
        )
    }

    /// Whether the first member has left uniform motion.
    fn is_moved(&self) -> bool {
        self.largest.member(0).max(self.deviation.member(0)) > UNMOVED
    }

    /// 1 where a single ratio of corrections is not sufficient.
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

/// Modified Newton: corrects with one matrix until converged.
///
/// # Errors
/// [`StepError::NotConverged`] as soon as `most` corrections will not be enough at the present rate, or where the
/// corrections vanish and the residual does not.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<Solved, StepError> {
    let mut progress = Progress::new(equations.stop());
    let mut path = PathLength::new();
    for iterations in 1..=most {
        let size = equations.correct()?;
        path.add(equations, size, iterations);
        let verdict = progress.judge(size, iterations, most);
        let failed = StepError::NotConverged { iterations, size };
        if verdict == ACTIVE || (verdict == CONVERGED && path.is_doubtful(iterations) != 0.0) {
            continue;
        }
        if verdict == FAILED {
            let is_solved = iterations < most
                && is_at_floor(equations, size)?
                && equations.is_residual_roundoff()?;
            if !is_solved {
                return Err(failed);
            }
        }
        let is_other =
            path.is_against || path.is_moved() && equations.is_reversed(path.largest > DOUBTFUL);
        let is_near = path.is_near(equations.reversed()) != 0.0 && !is_other;
        return Ok(Solved {
            iterations,
            is_near,
            is_straight: true,
        });
    }
    Err(StepError::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    })
}

/// Whether corrections that no longer shrink are at their roundoff floor: small ones, or others that move no coordinate,
/// as in an equilibrium of forces whose sum is roundoff of them.
#[cold]
fn is_at_floor(equations: &mut impl Equations, size: f64) -> Result<bool, StepError> {
    let scaled = equations.scaled_size(size);
    let is_unseen = 0.0 < scaled && scaled < UNSEEN;
    let largest = if is_unseen {
        f64::INFINITY
    } else {
        SMALL_CORRECTION
    };
    Ok(size < largest && size <= MOST_FLOORS * equations.roundoff_floor()?.min(largest))
}

/// The state of a member in the iteration of several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Member {
    /// It takes no part.
    #[default]
    Inactive,
    /// It needs further corrections.
    Active,
    /// It took so many corrections.
    Converged(usize),
    /// It does not converge, or its solution has to be confirmed.
    Failed {
        /// Corrections made.
        iterations: usize,
        /// Relative size of the last.
        size: f64,
    },
}

/// Corrects several members in lock-step, those that are [`Member::Active`], until each has converged or failed by its own
/// corrections: it takes as many as it would alone. `members` has a place for each lane.
///
/// # Errors
/// A correction could not be made; the error does not say for which member.
pub fn solve_each<R: Real>(
    equations: &mut impl Equations<R>,
    most: usize,
    members: &mut [Member],
) -> Result<(), StepError> {
    let mut progress = Progress::new(equations.stop());
    let (mut kept, mut has_kept) = (R::splat(0.0), false);
    let mut path = PathLength::new();
    for iterations in 1..=most {
        let sizes = equations.correct()?;
        dispatch_simd::<R, _>(
            #[inline(always)]
            || path.add(equations, sizes, iterations),
        );
        let verdicts = dispatch_simd::<R, _>(
            #[inline(always)]
            || progress.judge(sizes, iterations, most),
        );
        if verdicts.all(|verdict| verdict == ACTIVE) {
            continue;
        }
        let (is_near, is_doubtful) = (
            path.is_near(equations.reversed()),
            path.is_doubtful(iterations),
        );
        let mut done = R::splat(0.0);
        for (member, stands) in members.iter_mut().enumerate() {
            let (verdict, size) = (verdicts.member(member), sizes.member(member));
            let is_open =
                verdict == ACTIVE || (verdict == CONVERGED && is_doubtful.member(member) != 0.0);
            if *stands != Member::Active || is_open {
                continue;
            }
            *stands = if verdict == CONVERGED && is_near.member(member) != 0.0 {
                done.set_member(member, 1.0);
                Member::Converged(iterations)
            } else {
                Member::Failed { iterations, size }
            };
        }
        if !members.contains(&Member::Active) {
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
