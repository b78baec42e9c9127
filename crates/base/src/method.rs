//! Steppers: a stepper owns the memory of a step and advances a state.

use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::linalg::max_norm;

/// The work of a stepper so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Corrections of the stage equations.
    pub iterations: usize,
    /// Evaluations of the forces, one for each stage; flows, where a step is made of them.
    pub evaluations: usize,
    /// Factorisations of a Newton matrix that may serve several steps.
    pub factorizations: usize,
    /// Stage equations given to the full simplified Newton iteration, more than one where it takes a step in parts.
    pub newton_steps: usize,
    /// Steps, or parts of them, whose stages were found by node Schur.
    pub schur_steps: usize,
    /// Steps whose extrapolated start failed, so that a cold one was made.
    pub cold_starts: usize,
}

impl std::ops::Add for Stats {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            iterations: self.iterations + other.iterations,
            evaluations: self.evaluations + other.evaluations,
            factorizations: self.factorizations + other.factorizations,
            newton_steps: self.newton_steps + other.newton_steps,
            schur_steps: self.schur_steps + other.schur_steps,
            cold_starts: self.cold_starts + other.cold_starts,
        }
    }
}

impl std::ops::Sub for Stats {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            iterations: self.iterations - other.iterations,
            evaluations: self.evaluations - other.evaluations,
            factorizations: self.factorizations - other.factorizations,
            newton_steps: self.newton_steps - other.newton_steps,
            schur_steps: self.schur_steps - other.schur_steps,
            cold_starts: self.cold_starts - other.cold_starts,
        }
    }
}

/// The step being made: from `state` at `t` over `h`.
#[derive(Debug)]
pub struct Step<'a, S> {
    /// Time at its start.
    pub t: f64,
    /// Its size.
    pub h: f64,
    /// The state at its start.
    pub state: &'a S,
}

impl<S> Clone for Step<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Step<'_, S> {}

/// A method at work on a problem.
pub trait Stepper: Checkpoint {
    /// The state that it advances.
    type State: Checkpoint;

    /// Advances `state` from `t` to `t + h`; on failure the state is as it was.
    ///
    /// # Errors
    /// Why the step could not be made.
    fn step(&mut self, t: f64, h: f64, state: &mut Self::State) -> Result<(), StepError>;

    /// Makes the flow deferred by the last step, if there is one; a state is read only after this.
    ///
    /// # Errors
    /// Why it could not be made: the state is not to be used then.
    fn synchronize(&mut self, _state: &mut Self::State) -> Result<(), StepError> {
        Ok(())
    }

    /// Forgets the step before: the next one starts cold.
    fn forget(&mut self) {}

    /// The work so far; of members in lock-step, of one of them.
    fn stats(&self) -> Stats;

    /// The same of a member in lock-step that may have another share of it.
    fn stats_of(&self, _member: usize) -> Stats {
        self.stats()
    }
}

/// A method whose step of −h undoes its step of h.
pub trait Symmetric: Stepper {}

/// The absolute tolerance by default, in units of the relative one.
pub const SMALL: f64 = 1e-3;

/// A tolerance is not below so many roundings of a coordinate: solutions of stage equations are off by hundreds.
pub const LEAST_ROUNDINGS: f64 = 1024.0;

/// Errors of coordinates are measured by `atol + rtol |y|`, but no less than a thousand roundings, in the mean over
/// them.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// Part of the coordinate.
    pub rtol: f64,
    /// In the unit of each coordinate.
    pub atol: Vec<f64>,
    /// The longest first step, a hundredth of the run.
    pub longest: f64,
}

impl Tolerance {
    /// The root mean square of x in units of the tolerance, at the larger of two values of each
    /// coordinate.
    pub fn weigh(&self, [y0, y1]: [&[f64]; 2], x: impl Iterator<Item = f64>) -> f64 {
        let largest = max_norm(y1);
        let sum: f64 = x
            .enumerate()
            .map(|(k, x)| {
                let size = y0[k].abs().max(y1[k].abs());
                let least = LEAST_ROUNDINGS * self.roundoff([y0, y1], k, largest);
                (x / (self.atol[k] + self.rtol * size).max(least)).powi(2)
            })
            .sum();
        (sum / y0.len() as f64).sqrt()
    }

    /// Roundoff of a coordinate k, up to a factor: of numbers as large as it, and as the numbers of a default absolute
    /// tolerance, but no larger than the largest coordinate.
    pub fn roundoff(&self, [y0, y1]: [&[f64]; 2], k: usize, largest: f64) -> f64 {
        let size = y0[k].abs().max(y1[k].abs());
        f64::EPSILON * (size + (self.atol[k] / (SMALL * self.rtol)).min(largest))
    }

    /// The relative tolerance, or a smaller one where the absolute tolerance of a coordinate wants it.
    pub fn least(&self) -> f64 {
        let relative = self.atol.iter().map(|atol| atol / SMALL);
        relative.fold(self.rtol, f64::min)
    }

    /// A first step whose acceleration moves the coordinates by about the tolerance.
    pub fn first_step(&self, y: &[f64], accelerations: [&[f64]; 2]) -> f64 {
        let [a, b] = accelerations.map(|a| self.weigh([y, y], a.iter().copied()));
        let h = (2.0 / a.max(b).max(f64::MIN_POSITIVE)).sqrt();
        h.min(self.longest)
    }
}

/// A method with an error estimate.
pub trait Estimating: Stepper {
    /// The estimated local error of the last step, in units of the tolerance; infinite if it is unknown.
    fn error(&self) -> f64;

    /// The power of h with which that estimate falls.
    fn error_order(&self) -> f64;

    /// Puts `state` back to where it was before the last step.
    fn undo(&mut self, state: &mut Self::State);

    /// Corrections above which a step is too long for its iteration; infinite where it is never.
    fn most_corrections(&self) -> f64 {
        f64::INFINITY
    }

    /// Whether the next steps are made by all attempts there are, where else one is refused whose modified iteration fails.
    fn insist(&mut self, _insists: bool) {}
}

crate::checkpoint!(Stats {
    iterations,
    evaluations,
    factorizations,
    newton_steps,
    schur_steps,
    cold_starts,
});
