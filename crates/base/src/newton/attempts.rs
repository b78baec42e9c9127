//! The ladder of attempts at the equations of a step.
//!
//! From the step before with the matrix at hand, with a new matrix, cold, still, and by continuation: at
//! shorter steps from the same state, each solved from the one before, up to the step itself.

use crate::error::StepError;

/// Where the unknowns of a step start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// On the polynomials of the step before.
    Extrapolated,
    /// As the state at the start of the step says alone: accelerated, where its accelerations are used.
    Cold,
    /// Without accelerations.
    Still,
}

/// A method in the middle of a step, whose equations are attempted from several starts.
pub trait Attempts {
    /// Writes start values for a step of `h` from the present state; false where there are none of this kind.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn start(&mut self, h: f64, start: Start) -> Result<bool, StepError>;

    /// Whether a modified-Newton matrix of earlier steps may be used for a step of `h`.
    fn is_reusable(&self, _h: f64) -> bool {
        false
    }

    /// Discards that matrix.
    fn discard(&mut self) {}

    /// Iterates from the unknowns as they are, for a step of `h`.
    ///
    /// # Errors
    /// The equations are not solved.
    fn iterate(&mut self, h: f64) -> Result<(), StepError>;

    /// Holds the solution of a step of `h` to continue from with a longer one, which begins at the same state.
    ///
    /// # Errors
    /// What follows from the solution is not finite.
    fn hold_shorter(&mut self, h: f64) -> Result<(), StepError>;

    /// Forgets the step before.
    fn forget(&mut self);

    /// Counts a step whose extrapolated start has failed.
    fn count_cold_start(&mut self);
}

/// Fractions of the step that continuation goes through.
const SHORTER: [f64; 3] = [0.125, 0.25, 0.5];

/// Solves the equations of a step of `h`, by the first attempt that does.
///
/// # Errors
/// That of the cold attempt, when none does; or of an earlier one that met a value of the model that is not finite.
pub fn attempt(step: &mut impl Attempts, h: f64) -> Result<(), StepError> {
    let mut failed = None;
    if step.start(h, Start::Extrapolated)? {
        if step.is_reusable(h) {
            if step.iterate(h).is_ok() {
                return Ok(());
            }
            step.start(h, Start::Extrapolated)?;
        }
        step.discard();
        match step.iterate(h) {
            Ok(()) => return Ok(()),
            Err(error @ StepError::NotFinite { .. }) => failed = Some(error),
            Err(_) => {}
        }
        step.count_cold_start();
    }
    for start in [Start::Cold, Start::Still] {
        step.discard();
        if step.start(h, start)? {
            match step.iterate(h) {
                Ok(()) => return Ok(()),
                Err(error) => failed = failed.or(Some(error)),
            }
        }
    }
    let failed = failed.unwrap_or(StepError::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    });
    continuation(step, h).map_err(|_| failed)
}

/// Solves shorter steps first, and goes no further with them than to where this one starts.
fn continuation(step: &mut impl Attempts, h: f64) -> Result<(), StepError> {
    step.forget();
    for part in SHORTER {
        let shorter = part * h;
        step.discard();
        if !step.start(shorter, Start::Extrapolated)? {
            step.start(shorter, Start::Cold)?;
        }
        step.iterate(shorter)?;
        step.hold_shorter(shorter)?;
    }
    step.discard();
    step.start(h, Start::Extrapolated)?;
    step.iterate(h)
}
