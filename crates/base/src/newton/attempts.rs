//! The ladder of attempts at the equations of a step, and whether a solution is the step's own.
//!
//! A step is attempted from the step before with the matrix at hand, from there with a new matrix, and cold.
//! The solution of a step is the one on the branch that begins at the present state as h grows from 0. What
//! an attempt finds near its start is taken; anything else is confirmed. It is followed to shorter steps, until
//! one is near its start. Where that is not to be had the step is solved from the still start with a matrix for
//! each correction, and, where that moves far too, by continuation through longer and longer steps.

use super::Rest;
use crate::error::StepError;

/// Where the unknowns of a step start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// On what was found in the step before.
    Extrapolated,
    /// At the present state and its accelerations.
    Cold,
    /// Without accelerations.
    Still,
    /// Where the solution in [`Slot::Part`], of a shorter or longer step from the same state, leads.
    Continued,
    /// At that solution: of stiff forces, what it leads to is nonsense.
    Part,
}

/// Solutions of a step that are kept beside the present one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// What is to be confirmed.
    First,
    /// The last part of the step that is solved.
    Part,
    /// Where another part starts.
    Start,
}

/// A method in the middle of a step, whose equations are attempted from several starts.
pub trait Attempts {
    /// Writes a start for a step of `h`; says whether there is such a one.
    ///
    /// # Errors
    /// A value that it needs is not finite.
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError>;

    /// Whether a matrix is at hand that an earlier step of `h` has left.
    fn is_reusable(&self, _h: f64) -> bool {
        false
    }

    /// Discards that matrix.
    fn discard(&mut self) {}

    /// Iterates with one matrix from the unknowns as they are, for a step of `h`; says whether the solution is
    /// near its start.
    ///
    /// # Errors
    /// The equations are not solved.
    fn iterate(&mut self, h: f64) -> Result<bool, StepError>;

    /// Counts a step whose extrapolated start has failed.
    fn count_cold_start(&mut self);
}

/// A method whose solutions can be confirmed.
pub trait Confirms: Attempts {
    /// Iterates with a matrix for each correction; says whether the solution is near its start.
    ///
    /// # Errors
    /// The equations are not solved.
    fn iterate_full(&mut self, h: f64) -> Result<bool, StepError>;

    /// Keeps the present unknowns, of a step of `h`.
    fn keep(&mut self, h: f64, slot: Slot);

    /// Puts kept unknowns, of a step of `h`, back.
    fn put_back(&mut self, h: f64, slot: Slot);

    /// How far kept unknowns place the coordinates from where the present ones, of a step of `h`, do, relative to
    /// their size, and the coordinate that is the furthest.
    fn distance(&mut self, h: f64, slot: Slot) -> (f64, usize);

    /// How long the modified iteration rests after steps that only full Newton has solved.
    fn rest(&mut self) -> &mut Rest;
}

/// Solutions that differ by less are the same.
const SAME: f64 = 1e-6;
/// Continuation begins with this part of the step, or else with its square.
const FIRST_PART: f64 = 0.125;
/// The next part is longer by this factor at most, and by less where its solution is not where the last one leads.
const LONGER: f64 = 2.0;
/// A branch that cannot be followed to a part longer by this factor ends.
const LEAST_LONGER: f64 = 1.001;
/// Each part that a solution is followed down to is so much of the last, and they are so many at most.
const SHORTER: f64 = 0.5;
const MOST_SHORTER: i32 = 3;
/// A solution further from where the last one leads need not be on its branch.
const OFF: f64 = 0.01;
/// Nor need one that is further from the last one itself.
const APART: f64 = 0.1;
/// Parts that are tried.
const MOST_PARTS: usize = 60;

/// Solves the equations of a step of `h` with one matrix: from the step before, and cold; says whether the solution
/// is near its start.
///
/// # Errors
/// That of the cold attempt, or of an earlier one that met a value of the model that is not finite.
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

/// Solves the equations of a step of `h`, by the first attempt that does.
///
/// # Errors
/// [`StepError::StepTooLarge`] where the branch of the present state ends before `h`; else that of the modified
/// iteration.
pub fn attempt(step: &mut impl Confirms, h: f64) -> Result<(), StepError> {
    if step.rest().take() {
        return from_still(step, h);
    }
    match attempt_modified(step, h) {
        Ok(true) => {
            step.rest().end_row();
            Ok(())
        }
        Ok(false) => confirm(step, h),
        Err(error) => {
            from_still(step, h).map_err(|later| match (&later, &error) {
                (StepError::StepTooLarge { .. }, StepError::NotConverged { .. }) => later,
                _ => error,
            })?;
            step.rest().begin();
            Ok(())
        }
    }
}

/// Makes sure of the present solution, which is kept as it was found, or finds the step's own.
#[cold]
fn confirm(step: &mut impl Confirms, h: f64) -> Result<(), StepError> {
    if is_own(step, h)? {
        return Ok(());
    }
    if full_from_still(step, h)? != Ok(true) {
        by_parts(step, h)?;
    }
    if step.distance(h, Slot::First).0 <= SAME {
        step.put_back(h, Slot::First);
    }
    Ok(())
}

/// Solves with a matrix for each correction from the still start, and by continuation where that leads far.
#[cold]
fn from_still(step: &mut impl Confirms, h: f64) -> Result<(), StepError> {
    match full_from_still(step, h)? {
        Ok(true) => Ok(()),
        Ok(false) if is_own(step, h)? => Ok(()),
        _ => by_parts(step, h),
    }
}

/// What a matrix for each correction finds from the still start: whether it is near.
fn full_from_still(step: &mut impl Confirms, h: f64) -> Result<Result<bool, StepError>, StepError> {
    step.discard();
    step.start(h, Start::Still)?;
    Ok(step.iterate_full(h))
}

/// Solves for a part of the step, and by continuation for all of it.
fn by_parts(step: &mut impl Confirms, h: f64) -> Result<(), StepError> {
    if full_from_still(step, FIRST_PART * h)?.is_ok() {
        return continuation(step, h, FIRST_PART);
    }
    let part = FIRST_PART * FIRST_PART;
    full_from_still(step, part * h)??;
    continuation(step, h, part)
}

/// Whether the present solution is the step's own by where it leads in shorter ones; it is kept as it was found.
fn is_own(step: &mut impl Confirms, h: f64) -> Result<bool, StepError> {
    step.keep(h, Slot::First);
    let is_own = follows_down(step, h)?;
    step.discard();
    if is_own {
        step.put_back(h, Slot::First);
    }
    Ok(is_own)
}

/// Whether the present solution, of a step of `h`, leads to those of shorter steps, down to one near its start.
fn follows_down(step: &mut impl Confirms, h: f64) -> Result<bool, StepError> {
    step.keep(h, Slot::Part);
    for halvings in 1..=MOST_SHORTER {
        let part = h * SHORTER.powi(halvings);
        match follow(step, part, Start::Continued)? {
            Followed::Near => return Ok(true),
            Followed::Far => step.keep(part, Slot::Part),
            Followed::Lost { .. } => break,
        }
    }
    Ok(false)
}

/// What is found next to the last part of a step.
enum Followed {
    /// A solution on its branch, near the still start.
    Near,
    /// One on its branch.
    Far,
    /// None, or one off the branch by this coordinate most.
    Lost { coordinate: usize },
}

/// Solves for a step of `h` from the last part, or from where it leads.
fn follow(step: &mut impl Confirms, h: f64, start: Start) -> Result<Followed, StepError> {
    step.discard();
    step.start(h, start)?;
    step.keep(h, Slot::Start);
    let found = step.iterate_full(h);
    let (off, coordinate) = step.distance(h, Slot::Start);
    let bound = if start == Start::Part { APART } else { OFF };
    Ok(match found {
        Ok(true) if off <= bound => Followed::Near,
        Ok(false) if off <= bound => Followed::Far,
        _ => Followed::Lost { coordinate },
    })
}

/// Solves for longer and longer parts of the step, each near where the one before leads, or near that one; `part` of
/// it is solved.
fn continuation(step: &mut impl Confirms, h: f64, part: f64) -> Result<(), StepError> {
    let (mut solved, mut longer, mut furthest) = (part, LONGER, 0);
    let mut start = Start::Continued;
    step.keep(solved * h, Slot::Part);
    for _ in 0..MOST_PARTS {
        let part = (solved * longer).min(1.0);
        match follow(step, part * h, start)? {
            Followed::Near | Followed::Far if part == 1.0 => return Ok(()),
            Followed::Near | Followed::Far => {
                step.keep(part * h, Slot::Part);
                (solved, longer) = (part, (longer * longer.sqrt()).min(LONGER));
            }
            Followed::Lost { .. } if start == Start::Continued => start = Start::Part,
            Followed::Lost { coordinate } => (furthest, longer) = (coordinate, longer.sqrt()),
        }
        if longer < LEAST_LONGER {
            break;
        }
    }
    Err(StepError::StepTooLarge {
        h,
        coordinate: furthest,
        solved: solved * h,
    })
}
