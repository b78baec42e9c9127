//! The ladder of attempts at the equations of a step, and whether a solution is the step's own.
//!
//! A step is attempted from the step before with the matrix at hand, from there with a new matrix, and cold.
//! The solution of a step is the one on the branch that begins at the present state as h grows from 0. What
//! an attempt finds near its start is taken; anything else is confirmed: from the still start with a matrix
//! for each correction, and, where that moves far too, by continuation through shorter steps.

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
    /// As a shorter step from the same state has left them.
    Continued,
}

/// Solutions of a step that are kept beside the present one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// What is to be confirmed.
    First,
    /// The longest part of the step that is solved.
    Part,
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

    /// Puts kept unknowns back.
    fn put_back(&mut self, slot: Slot);

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
/// The next part is longer by this factor at most, and by less where solutions change much.
const LONGER: f64 = 2.0;
/// A branch that cannot be followed to a part longer by this factor ends.
const LEAST_LONGER: f64 = 1.01;
/// Solutions of two parts that differ by more are not on one branch.
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
    step.keep(h, Slot::First);
    from_still(step, h)?;
    if step.distance(h, Slot::First).0 <= SAME {
        step.put_back(Slot::First);
    }
    Ok(())
}

/// Solves with a matrix for each correction from the still start, and by continuation where that leads far.
#[cold]
fn from_still(step: &mut impl Confirms, h: f64) -> Result<(), StepError> {
    step.discard();
    step.start(h, Start::Still)?;
    if step.iterate_full(h) == Ok(true) {
        return Ok(());
    }
    for part in [FIRST_PART, FIRST_PART * FIRST_PART] {
        step.discard();
        step.start(part * h, Start::Still)?;
        let found = step.iterate_full(part * h);
        if found.is_ok() {
            return continuation(step, h, part);
        }
        if part < FIRST_PART {
            found?;
        }
    }
    Ok(())
}

/// Solves for longer and longer parts of the step, each from the one before and near it; `part` of it is solved.
fn continuation(step: &mut impl Confirms, h: f64, part: f64) -> Result<(), StepError> {
    let (mut solved, mut longer, mut coordinate) = (part, LONGER, 0);
    step.keep(solved * h, Slot::Part);
    for _ in 0..MOST_PARTS {
        let part = (solved * longer).min(1.0);
        step.discard();
        step.start(part * h, Start::Continued)?;
        let found = step.iterate_full(part * h);
        let (apart, furthest) = step.distance(part * h, Slot::Part);
        if found.is_ok() && apart <= APART {
            if part == 1.0 {
                return Ok(());
            }
            step.keep(part * h, Slot::Part);
            (solved, longer) = (part, (longer * longer.sqrt()).min(LONGER));
        } else {
            step.put_back(Slot::Part);
            (coordinate, longer) = (furthest, longer.sqrt());
        }
        if longer < LEAST_LONGER {
            break;
        }
    }
    let solved = solved * h;
    Err(StepError::StepTooLarge {
        h,
        coordinate,
        solved,
    })
}
