//! The sequence of attempts at the equations of a step, and the choice of the solution's branch.
//!
//! A step is attempted from the extrapolated start with the matrix at hand, from there with a new matrix, and from the
//! cold start. The solution of a step is the one on the branch that begins at the present state as h grows from 0. A
//! solution near its start is accepted; any other is confirmed by path following: it is continued to shorter steps,
//! until one is near its start. Where that fails, the step is solved by full Newton from the uniform start, and, where
//! the solution is far from there too, by continuation through longer and longer steps, unless the step may be
//! shortened at less cost.
//! Source: docs/theory/newton.md.

use super::{Backoff, Solved};
use crate::cancel;
use crate::error::StepError;

/// The start values of the unknowns of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Extrapolated from the step before.
    Extrapolated,
    /// Motion with the present velocities and accelerations.
    Cold,
    /// Uniform motion: the present velocities, without accelerations.
    Uniform,
    /// The extrapolation of the solution in [`Slot::Part`], of a shorter or longer step from the same state.
    Continued,
    /// That solution itself: for stiff forces the extrapolation is far off.
    Part,
}

/// Places where solutions of a step are kept beside the present one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The solution to be confirmed.
    Candidate,
    /// The solution of the last part of the step.
    Part,
    /// The start values of the next part.
    Start,
}

/// The equations of a step, which are attempted from several starts.
pub trait Attempts {
    /// Writes start values for a step of `h`; returns whether there are such.
    ///
    /// # Errors
    /// A value of the model is not finite.
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError>;

    /// Whether there is a matrix of an earlier step of `h`.
    fn is_reusable(&self, _h: f64) -> bool {
        false
    }

    /// Discards that matrix.
    fn discard(&mut self) {}

    /// Solves a step of `h` by modified Newton from the present unknowns; returns whether the solution is near its
    /// start.
    ///
    /// # Errors
    /// The equations are not solved.
    fn iterate(&mut self, h: f64) -> Result<bool, StepError>;

    /// Counts a failure of the extrapolated start.
    fn count_cold_start(&mut self);
}

/// The equations of a step whose solutions can be followed along their branch.
pub trait BranchAttempts: Attempts {
    /// Solves a step of `h` by full Newton from the present unknowns.
    ///
    /// # Errors
    /// The equations are not solved, or not on the branch of the present state.
    fn iterate_full(&mut self, h: f64) -> Result<Solved, StepError>;

    /// Keeps the present unknowns, of a step of `h`.
    fn keep(&mut self, h: f64, slot: Slot);

    /// Puts kept unknowns, of a step of `h`, back.
    fn put_back(&mut self, h: f64, slot: Slot);

    /// The largest distance between coordinates of the kept unknowns and of the present ones, of a step of `h`,
    /// relative to their size, and in which coordinate.
    fn distance(&mut self, h: f64, slot: Slot) -> (f64, usize);

    /// Whether the matrix at a solution may show that this is on another branch.
    fn tells_branches(&self) -> bool {
        false
    }

    /// Takes the signs of matrices for nothing from here on, where one was against a solution; returns whether one was.
    fn disregards_signs(&mut self) -> bool {
        false
    }

    /// Whether a step is refused, and made shorter, where the modified iteration fails.
    fn is_refused(&self) -> bool {
        false
    }

    /// Whether a step is refused, and made shorter, where only continuation might solve it.
    fn is_shortened(&self) -> bool {
        false
    }

    /// The rest of the modified iteration after steps that only full Newton has solved.
    fn backoff(&mut self) -> &mut Backoff;
}

/// Solutions at a smaller distance are the same.
const SAME_SOLUTION: f64 = 1e-6;
/// Continuation begins with this fraction of the step, or where the solution is far with a power of it, to this one.
const FIRST_PART: f64 = 0.125;
const SMALLEST_PART: i32 = 6;
/// Largest ratio of successive parts; it is lowered where a solution is off the extrapolation of the last one.
const MAX_GROWTH: f64 = 2.0;
/// The branch ends where no part longer by this ratio can be solved.
const MIN_GROWTH: f64 = 1.001;
/// Ratio of successive parts where a solution is followed to shorter steps, and how many there are at most.
const REDUCTION: f64 = 0.5;
const MOST_REDUCTIONS: i32 = 3;
/// A solution further from the extrapolation of the last one need not be on its branch.
const OFF_BRANCH: f64 = 0.01;
/// The same of its distance from the last solution itself.
const OFF_LAST: f64 = 0.1;
/// The most parts of a continuation, where all steps are straight, and where they need not be.
const MOST_PARTS: usize = 100;
const MOST_CURVED_PARTS: usize = 60;

/// Solves the equations of a step of `h` by modified Newton, from the extrapolated start, then from the cold one;
/// returns whether the solution is near its start.
///
/// # Errors
/// The error of the cold attempt, or of an earlier one where a value of the model is not finite.
pub fn attempt_modified(step: &mut impl Attempts, h: f64) -> Result<bool, StepError> {
    let mut failed = None;
    if step.start(h, Start::Extrapolated)? {
        if step.is_reusable(h) {
            if let Ok(is_near) = step.iterate(h) {
                return Ok(is_near);
            }
            step.start(h, Start::Extrapolated)?;
        }
        step.discard();
        match step.iterate(h) {
            Err(error @ StepError::NotFinite { .. }) => failed = Some(error),
            Err(_) => {}
            Ok(is_near) => return Ok(is_near),
        }
        step.count_cold_start();
    }
    step.discard();
    step.start(h, Start::Cold)?;
    step.iterate(h).map_err(|error| failed.unwrap_or(error))
}

/// Solves the equations of a step of `h`, by the first attempt that does. Where there is no solution that the sign of its
/// matrix has nothing against, others may be on the branch for all that.
///
/// # Errors
/// [`StepError::StepTooLarge`] where the branch of the present state ends before `h`; else that of the modified
/// iteration.
pub fn attempt(step: &mut impl BranchAttempts, h: f64) -> Result<(), StepError> {
    match attempt_on_branch(step, h) {
        Err(StepError::Interrupted) => Err(StepError::Interrupted),
        Err(_) if step.disregards_signs() => attempt_on_branch(step, h),
        outcome => outcome,
    }
}

fn attempt_on_branch(step: &mut impl BranchAttempts, h: f64) -> Result<(), StepError> {
    if step.backoff().skip() {
        return from_uniform(step, h);
    }
    match attempt_modified(step, h) {
        Ok(true) => {
            step.backoff().succeed();
            Ok(())
        }
        Ok(false) => confirm_branch(step, h),
        Err(error @ StepError::NotConverged { .. }) if step.is_refused() => Err(error),
        Err(error) => {
            from_uniform(step, h).map_err(|later| match (&later, &error) {
                (StepError::StepTooLarge { .. }, StepError::NotConverged { .. })
                | (StepError::Interrupted, _) => later,
                _ => error,
            })?;
            step.backoff().fail();
            Ok(())
        }
    }
}

/// Confirms the present solution, which is then kept to the bit, or finds the one on the branch of the present state.
#[cold]
fn confirm_branch(step: &mut impl BranchAttempts, h: f64) -> Result<(), StepError> {
    if is_on_branch(step, h)? {
        return Ok(());
    }
    if !matches!(
        full_from_uniform(step, h)?,
        Ok(Solved { is_near: true, .. })
    ) {
        by_parts(step, h)?;
    }
    if step.distance(h, Slot::Candidate).0 <= SAME_SOLUTION {
        step.put_back(h, Slot::Candidate);
    }
    Ok(())
}

/// Solves by full Newton from the uniform start, and by continuation where that solution is far.
#[cold]
fn from_uniform(step: &mut impl BranchAttempts, h: f64) -> Result<(), StepError> {
    match full_from_uniform(step, h)? {
        Ok(Solved { is_near: true, .. }) => Ok(()),
        Ok(_) if is_on_branch(step, h)? => Ok(()),
        _ => by_parts(step, h),
    }
}

/// Stops where the run is cancelled: so many attempts may take longer than Ctrl-C should wait.
fn go_on() -> Result<(), StepError> {
    if cancel::is_cancelled() {
        return Err(StepError::Interrupted);
    }
    Ok(())
}

/// The outcome of full Newton from the uniform start.
fn full_from_uniform(
    step: &mut impl BranchAttempts,
    h: f64,
) -> Result<Result<Solved, StepError>, StepError> {
    go_on()?;
    step.discard();
    step.start(h, Start::Uniform)?;
    Ok(step.iterate_full(h))
}

/// Solves for a part of the step, and continues from there to the whole step.
fn by_parts(step: &mut impl BranchAttempts, h: f64) -> Result<(), StepError> {
    if step.is_shortened() {
        let (coordinate, solved) = (0, 0.0);
        return Err(StepError::StepTooLarge {
            h,
            coordinate,
            solved,
        });
    }
    let smallest = if step.tells_branches() {
        SMALLEST_PART
    } else {
        0
    };
    for power in 1..=smallest {
        let part = FIRST_PART.powi(power);
        let is_first = |solved: &Solved| solved.is_near && solved.is_straight;
        if full_from_uniform(step, part * h)?
            .as_ref()
            .is_ok_and(is_first)
        {
            match continuation(step, h, (part, true)) {
                Err(StepError::StepTooLarge { .. }) => break,
                outcome => return outcome,
            }
        }
    }
    // a stiff force that is released is far from linear, however short the part
    if full_from_uniform(step, FIRST_PART * h)?.is_ok() {
        return continuation(step, h, (FIRST_PART, false));
    }
    let part = FIRST_PART * FIRST_PART;
    full_from_uniform(step, part * h)??;
    continuation(step, h, (part, false))
}

/// Whether the present solution is on the branch of the present state, by following it to shorter steps; it is kept to
/// the bit.
fn is_on_branch(step: &mut impl BranchAttempts, h: f64) -> Result<bool, StepError> {
    step.keep(h, Slot::Candidate);
    let is_other = step.tells_branches() && is_reversed(step, h);
    let is_on_branch = !is_other && follows_down(step, h)?;
    step.discard();
    if is_on_branch {
        step.put_back(h, Slot::Candidate);
    }
    Ok(is_on_branch)
}

/// Whether the matrix at the present solution shows that it is on another branch.
fn is_reversed(step: &mut impl BranchAttempts, h: f64) -> bool {
    step.discard();
    let is_reversed = step.iterate_full(h).is_err();
    step.put_back(h, Slot::Candidate);
    is_reversed
}

/// Follows the present solution, of a step of `h`, to shorter steps; returns whether one near its start is reached.
fn follows_down(step: &mut impl BranchAttempts, h: f64) -> Result<bool, StepError> {
    step.keep(h, Slot::Part);
    for reductions in 1..=MOST_REDUCTIONS {
        let part = h * REDUCTION.powi(reductions);
        let is_straight = step.tells_branches();
        match follow(step, part, (Start::Continued, is_straight))? {
            Followed::Near => return Ok(true),
            Followed::Far => step.keep(part, Slot::Part),
            Followed::Lost { .. } => break,
        }
    }
    Ok(false)
}

/// The outcome of following a branch to another part of the step.
enum Followed {
    /// A solution on the branch, near the uniform start.
    Near,
    /// A solution on the branch.
    Far,
    /// No solution, or one off the branch, by the most in this coordinate.
    Lost { coordinate: usize },
}

/// Solves for a step of `h` from the solution of the last part, or from its extrapolation, perhaps so near that the equations
/// are nearly linear in between.
fn follow(
    step: &mut impl BranchAttempts,
    h: f64,
    (start, is_straight): (Start, bool),
) -> Result<Followed, StepError> {
    go_on()?;
    step.discard();
    step.start(h, start)?;
    step.keep(h, Slot::Start);
    let found = step.iterate_full(h);
    let (off, coordinate) = step.distance(h, Slot::Start);
    let bound = if start == Start::Part {
        OFF_LAST
    } else {
        OFF_BRANCH
    };
    Ok(match found {
        Ok(solved) if off <= bound && (solved.is_straight || !is_straight) => {
            if solved.is_near {
                Followed::Near
            } else {
                Followed::Far
            }
        }
        _ => Followed::Lost { coordinate },
    })
}

/// Solves for longer and longer parts of the step, each from the extrapolation of the one before, or from that one;
/// `part` of it is solved already.
fn continuation(
    step: &mut impl BranchAttempts,
    h: f64,
    (part, is_straight): (f64, bool),
) -> Result<(), StepError> {
    let most = if is_straight {
        MOST_PARTS
    } else {
        MOST_CURVED_PARTS
    };
    let (mut solved, mut growth, mut furthest) = (part, MAX_GROWTH, 0);
    let mut start = Start::Continued;
    step.keep(solved * h, Slot::Part);
    for _ in 0..most {
        let part = (solved * growth).min(1.0);
        match follow(step, part * h, (start, is_straight))? {
            Followed::Near | Followed::Far if part == 1.0 => return Ok(()),
            Followed::Near | Followed::Far => {
                step.keep(part * h, Slot::Part);
                (solved, growth) = (part, (growth * growth.sqrt()).min(MAX_GROWTH));
            }
            Followed::Lost { .. } if start == Start::Continued => start = Start::Part,
            Followed::Lost { coordinate } => (furthest, growth) = (coordinate, growth.sqrt()),
        }
        if growth < MIN_GROWTH {
            break;
        }
    }
    Err(StepError::StepTooLarge {
        h,
        coordinate: furthest,
        solved: solved * h,
    })
}
