//! The one simplified-Newton iteration: corrections until roundoff, or a reason why not.
//!
//! Whoever has equations to solve says how one correction is made; this file says when to stop.
//! With θ the ratio of successive corrections δ (relative to the size of the solution), the
//! iteration ends when what is still to come, θ δ / (1 − θ), is far below ε. Within the noise of its own
//! evaluation δ tells nothing any more; θ is then that of the corrections above it. A second
//! correction more than half the first ends it at once: Newton's method may converge from there, but
//! to what solution is anybody's guess. Source: hairer1996, IV.8; deuflhard2004, 2.1.

mod broyden;

pub use broyden::Broyden;

use crate::trouble::Trouble;

/// A system of equations in the middle of being solved.
pub trait Equations {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<f64, Trouble>;

    /// The rate at which corrections fell the last time, if their equations were much like these.
    fn rate(&self) -> Option<f64> {
        None
    }

    /// No rate below this is believed.
    fn least_rate(&self) -> f64 {
        0.0
    }

    /// Corrections still expected below this fraction of the solution end the iteration. By default what
    /// a symplectic method needs: they are of one sign step after step, so even a hundredth of ε would
    /// show as a drift of the energy.
    fn tolerance(&self) -> f64 {
        3e-3 * f64::EPSILON
    }
}

/// A first ratio of corrections above this says that the solution found need not be the nearby one.
const NEARBY: f64 = 0.5;
/// Corrections below this fraction may be nothing but roundoff.
const NOISE: f64 = 1e3 * f64::EPSILON;

/// How an iteration went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Corrections made.
    pub iterations: usize,
    /// The largest ratio of successive corrections above the noise, or the one known before.
    pub rate: Option<f64>,
}

/// Corrects until converged.
///
/// # Errors
/// [`Trouble::NotConverged`] as soon as `most` corrections will not be enough.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<Outcome, Trouble> {
    let (tolerance, least) = (equations.tolerance(), equations.least_rate());
    let mut last = f64::INFINITY;
    let mut expected = f64::INFINITY;
    let mut rate = equations.rate();
    let mut worst: Option<f64> = None;
    for iterations in 1..=most {
        let size = equations.correct()?;
        let theta = size / last;
        let is_noise = size < NOISE;
        // noise hides what is still converging: the rate seen above it is believed
        expected = match rate {
            Some(rate) if is_noise => size.min(rate * expected),
            _ => size,
        };
        if iterations > 1 && !is_noise {
            rate = Some(theta);
            worst = Some(worst.map_or(theta, |worst| worst.max(theta)));
        }
        let is_converged = size == 0.0
            || iterations > 1
                && still_to_come(rate.unwrap_or(theta).max(least), expected) < tolerance
            || is_noise && rate.is_none() && theta >= 0.5
            || is_noise && iterations == most;
        if is_converged {
            return Ok(Outcome {
                iterations,
                rate: worst.or(rate),
            });
        }
        let is_too_slow =
            still_to_come(theta, size) * theta.powf((most - iterations) as f64) > tolerance;
        if !size.is_finite()
            || iterations == most
            || is_hopeless(size, theta, iterations, is_too_slow)
        {
            return Err(Trouble::NotConverged { iterations, size });
        }
        last = size;
    }
    Err(Trouble::NotConverged {
        iterations: 0,
        size: f64::INFINITY,
    })
}

/// The sum of all corrections after one of size `size`, at this rate.
fn still_to_come(rate: f64, size: f64) -> f64 {
    if rate < 1.0 {
        rate * size / (1.0 - rate)
    } else {
        f64::INFINITY
    }
}

/// Growing, at its present rate too slow, or started too far away.
fn is_hopeless(size: f64, theta: f64, iterations: usize, is_too_slow: bool) -> bool {
    match iterations {
        _ if size < NOISE => false,
        1 => false,
        2 => theta > NEARBY,
        3 => theta >= 2.0,
        // a Newton iteration may have needed three corrections to find its rate
        _ => theta >= 2.0 || is_too_slow,
    }
}
