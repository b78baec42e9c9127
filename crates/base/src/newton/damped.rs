//! Full Newton with damping, for equations without a start that is near.
//!
//! A correction δ is taken by the first of the factors μ = 1, 1/2, 1/4, … that lets the next one, by the same matrix, be
//! smaller:
//!
//! |δ(x + μ δ)| ≤ (1 − 1e-4 μ) |δ(x)|
//!
//! Source: deuflhard2004, 3.3.

use super::{SMALL_CORRECTION, Stop};
use crate::error::StepError;
use crate::real::Real;

/// The most matrices.
const MOST: usize = 100;
/// Shorter corrections are not taken: that is beyond the range of numbers.
const SHORTEST: f64 = f64::MIN_POSITIVE;
/// A correction by μ is taken where the next one is smaller by this part of μ.
const DECREASE: f64 = 1e-4;

/// Equations whose corrections are found and taken apart.
pub trait Damped<R: Real> {
    /// Finds the correction at the present unknowns, with a matrix of its own where `is_new`; returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn find(&mut self, is_new: bool) -> Result<R, StepError>;

    /// Moves the unknowns from where the last matrix was made by this part of the correction that was found there.
    fn take(&mut self, part: f64);
}

/// Corrects until corrections fall no more, or the sum of all further ones is below the tolerance; the caller makes the last
/// correction that was found. Several members take the same parts.
///
/// # Errors
/// [`StepError::NotConverged`] where no part of a correction, or none of the first hundred, leads to a solution.
pub fn solve_damped<R: Real>(equations: &mut impl Damped<R>) -> Result<(), StepError> {
    let tolerance = Stop::default().tolerance;
    let (mut size, mut least) = (R::splat(f64::INFINITY), R::splat(f64::INFINITY));
    for iterations in 1..=MOST {
        size = equations.find(true)?;
        let failed = StepError::NotConverged {
            iterations,
            size: size.member(0),
        };
        if !size.all(f64::is_finite) {
            return Err(failed);
        }
        let is_small = size.all(|size| size < SMALL_CORRECTION);
        // below the roundings of the unknowns corrections go in circles, or fall slowly
        let gain = size.zip(least, |size, least| least / 2.0 - size);
        if is_small && gain.all(|gain| gain <= 0.0) {
            return Ok(());
        }
        least = least.zip(size, f64::min);
        let mut part = 1.0;
        loop {
            equations.take(part);
            let next = equations.find(false);
            let bound = 1.0 - DECREASE * part;
            // the sum of all further corrections by the same matrix, the next of which the caller makes
            let rest = |next: R| size.zip(next, |size, next| next * (next / size));
            let falls = |next: R| size.zip(next, |size, next| size * bound - next);
            match next {
                Ok(next) if rest(next).all(|rest| rest < tolerance) => return Ok(()),
                Ok(next) if next.all(|next| next == 0.0) => return Ok(()),
                Ok(next) if falls(next).all(|rest| rest >= 0.0) => break,
                _ if is_small => return Ok(()),
                Err(StepError::Interrupted) => return Err(StepError::Interrupted),
                _ if part < SHORTEST => return Err(failed),
                _ => part /= 2.0,
            }
        }
    }
    Err(StepError::NotConverged {
        iterations: MOST,
        size: size.member(0),
    })
}
