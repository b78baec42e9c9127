//! The one simplified-Newton iteration: corrections until roundoff, or a reason why not.
//!
//! Whoever has equations to solve says how one correction is made; this file says when to stop.
//! With θ the ratio of successive corrections δ (relative to the size of the solution), the
//! iteration ends when what is still to come, θ δ / (1 − θ), is below the tolerance of its [`Stop`]. Within
//! the noise of its own evaluation δ tells nothing any more: where corrections fall evenly, θ is then that
//! of those above it; where they do not, what falls no more is roundoff. A second
//! correction more than half the first ends it at once: Newton's method may converge from there, but
//! to what solution is anybody's guess. Source: hairer1996, IV.8; deuflhard2004, 2.1.

mod broyden;

pub use broyden::Broyden;

use crate::real::{Real, WIDTH};
use crate::trouble::Trouble;

/// A system of equations in the middle of being solved: one, or those of several members in lock-step.
pub trait Equations<R = f64> {
    /// Evaluates the residual, solves for a correction, applies it, and returns its relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct(&mut self) -> Result<R, Trouble>;

    /// When to stop.
    fn stop(&self) -> Stop {
        Stop::default()
    }

    /// Keeps what has been found for a member that takes no further corrections.
    fn keep(&mut self, _member: usize) {}

    /// Puts back what was kept for a member.
    fn put_back(&mut self, _member: usize) {}
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
/// [`Trouble::NotConverged`] as soon as `most` corrections will not be enough.
pub fn solve(equations: &mut impl Equations, most: usize) -> Result<usize, Trouble> {
    let mut progress = Progress::new(equations.stop());
    for iterations in 1..=most {
        let size = equations.correct()?;
        match progress.judge(size, iterations, most) {
            Verdict::Converged => return Ok(iterations),
            Verdict::Hopeless => return Err(Trouble::NotConverged { iterations, size }),
            Verdict::Open => {}
        }
    }
    Err(Trouble::NotConverged {
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
/// corrections, so that it takes as many as it would alone.
///
/// # Errors
/// A correction could not be made: that may be the trouble of any of them.
pub fn solve_each<R: Real>(
    equations: &mut impl Equations<R>,
    most: usize,
    members: &mut [Member; WIDTH],
) -> Result<(), Trouble> {
    const { assert!(R::MEMBERS <= WIDTH, "a place for each member") };
    let mut progress = [Progress::new(equations.stop()); WIDTH];
    let mut kept = [false; WIDTH];
    for iterations in 1..=most {
        let sizes = equations.correct()?;
        for (member, stands) in members.iter_mut().enumerate().take(R::MEMBERS) {
            if *stands != Member::Open {
                continue;
            }
            let size = sizes.member(member);
            *stands = match progress[member].judge(size, iterations, most) {
                Verdict::Open => Member::Open,
                Verdict::Converged => Member::Converged(iterations),
                Verdict::Hopeless => Member::Hopeless { iterations, size },
            };
        }
        if !members[..R::MEMBERS].contains(&Member::Open) {
            break;
        }
        for (member, stands) in members.iter().enumerate().take(R::MEMBERS) {
            if *stands == Member::Converged(iterations) {
                equations.keep(member);
                kept[member] = true;
            }
        }
    }
    for member in (0..R::MEMBERS).filter(|member| kept[*member]) {
        equations.put_back(member);
    }
    Ok(())
}

/// Corrects all members until each has converged.
///
/// # Errors
/// [`Trouble::NotConverged`] as soon as one of them will not.
pub fn solve_all<R: Real>(equations: &mut impl Equations<R>, most: usize) -> Result<(), Trouble> {
    let mut members = [Member::Open; WIDTH];
    solve_each(equations, most, &mut members)?;
    let hopeless = members.into_iter().find_map(|member| match member {
        Member::Hopeless { iterations, size } => Some((iterations, size)),
        _ => None,
    });
    hopeless.map_or(Ok(()), |(iterations, size)| {
        Err(Trouble::NotConverged { iterations, size })
    })
}

/// How far the corrections of a member have come.
#[derive(Clone, Copy, Debug)]
struct Progress {
    stop: Stop,
    last: f64,
    expected: f64,
    rate: Option<f64>,
}

enum Verdict {
    Open,
    Converged,
    Hopeless,
}

impl Progress {
    fn new(stop: Stop) -> Self {
        Self {
            stop,
            last: f64::INFINITY,
            expected: f64::INFINITY,
            rate: None,
        }
    }

    /// What another correction, of this size, says.
    #[inline]
    fn judge(&mut self, size: f64, iterations: usize, most: usize) -> Verdict {
        let Stop {
            tolerance,
            is_even,
            least_rate,
        } = self.stop;
        let theta = size / self.last;
        let is_noise = size < NOISE;
        let is_hidden = is_noise && is_even;
        // noise hides what is still converging: the rate seen above it is believed
        self.expected = match self.rate {
            Some(rate) if is_hidden => size.min(rate * self.expected),
            _ => size,
        };
        if iterations > 1 && !is_hidden {
            self.rate = Some(theta.max(least_rate));
        }
        let (rate, expected) = (self.rate, self.expected);
        let is_converged = size == 0.0
            || iterations > 1 && still_to_come(rate.unwrap_or(theta), expected) < tolerance
            || is_noise && (rate.is_none() || !is_even) && theta >= 0.5
            || !is_even && iterations > 2 && size < LOUD_NOISE && theta >= 0.9
            || is_noise && iterations == most;
        if is_converged {
            return Verdict::Converged;
        }
        let left = (most - iterations) as f64;
        let is_too_slow = is_even && still_to_come(theta, size) * theta.powf(left) > tolerance;
        if !size.is_finite()
            || iterations == most
            || !is_noise && is_hopeless(theta, iterations, is_too_slow)
        {
            return Verdict::Hopeless;
        }
        self.last = size;
        Verdict::Open
    }
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
fn is_hopeless(theta: f64, iterations: usize, is_too_slow: bool) -> bool {
    match iterations {
        1 => false,
        2 => theta > NEARBY,
        3 => theta >= 2.0,
        // a Newton iteration may have needed three corrections to find its rate
        _ => theta >= 2.0 || is_too_slow,
    }
}
