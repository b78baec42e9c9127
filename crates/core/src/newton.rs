//! The one simplified-Newton iteration: corrections until roundoff, or a reason why not.
//!
//! Whoever has equations to solve says how one correction is made; this file says when to stop.
//! With θ the ratio of successive corrections δ (relative to the size of the solution), the
//! iteration ends when what is still to come, θ δ / (1 − θ), is below a hundredth of ε, or when δ stops
//! shrinking within the noise of its own evaluation. Source: hairer1996, IV.8, and spark theory page.

use crate::trouble::Trouble;

/// A system of equations in the middle of being solved.
pub trait Equations {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<f64, Trouble>;
}

/// Corrections still expected below this fraction of the solution end the iteration: they are of one
/// sign step after step, so a tenth of ε would still show as a drift of the energy.
const TOLERANCE: f64 = 0.01 * f64::EPSILON;
/// Corrections below this fraction may be nothing but roundoff.
const NOISE: f64 = 200.0 * f64::EPSILON;

/// Corrects until converged and returns how many corrections that took.
///
/// # Errors
/// [`Trouble::NotConverged`] as soon as `most` corrections will not be enough.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<usize, Trouble> {
    let mut last = f64::INFINITY;
    for iterations in 1..=most {
        let size = equations.correct()?;
        let theta = size / last;
        if size == 0.0 || (iterations > 1 && is_converged(size, theta)) {
            return Ok(iterations);
        }
        let failed = !size.is_finite() || is_hopeless(size, theta, iterations, most);
        if failed || iterations == most {
            return Err(Trouble::NotConverged { iterations, size });
        }
        last = size;
    }
    Err(Trouble::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    })
}

fn is_converged(size: f64, theta: f64) -> bool {
    let still_to_come = if theta < 1.0 {
        theta * size / (1.0 - theta)
    } else {
        f64::INFINITY
    };
    still_to_come < TOLERANCE || (size < NOISE && theta >= 0.5)
}

/// Growing, or at its present rate too slow; a Newton iteration may need three to find its rate.
fn is_hopeless(size: f64, theta: f64, iterations: usize, most: usize) -> bool {
    let too_slow = || iterations > 3 && size * theta.powf((most - iterations) as f64) > NOISE;
    iterations > 1 && size > NOISE && (theta >= 2.0 || too_slow())
}
