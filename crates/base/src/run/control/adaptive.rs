//! Steps as long as the estimated errors allow.

use super::time::CompensatedTime;
use super::{StepControl, StepSizes};
use crate::cancel;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::{Estimating, Stepper};

/// Ratio of the next step to the one whose error would be the tolerance.
const SAFETY: f64 = 0.9;
/// Bounds of the ratio of successive steps.
pub(super) const SHRINK: f64 = 0.2;
const GROW: f64 = 4.0;
/// Steps are lengthened by at least this ratio: equal steps keep the factors of their Newton matrix.
const LEAST_GROWTH: f64 = 1.2;
/// Fraction at which a step without a solution is tried again, and one that was refused as its iteration is slow.
pub(super) const RETRY: f64 = 0.25;
const RETRY_REFUSED: f64 = 0.5;
/// After so many refusals in a row, and where a shorter step would be the shortest, a step is made by all attempts.
const MOST_REFUSALS: usize = 6;
/// Errors are counted as at least this: smaller ones do not tell how long a step may be.
const LEAST_ERROR: f64 = 1e-8;

/// Steps by a PI controller: with e the error in units of the tolerance, O(h^k),
///
///     h ← 0.9 h e_n^(−0.7/k) e_{n−1}^(0.4/k)
///
/// and no longer than h k/n after a step of n corrections, more than k = 2 + ln(1/τ)/5: longer steps cost more.
///
/// Source: gustafsson1991; hairer1996, IV.2.
pub struct Adaptive<State: Checkpoint> {
    stepper: Box<dyn Estimating<State = State>>,
    time: CompensatedTime,
    h: f64,
    h_first: f64,
    h_min: f64,
    last_error: f64,
    rejected: usize,
}

impl<State: Checkpoint> Adaptive<State> {
    /// From `t0` to `t1` with a first step `h`, refusing steps below `h_min`; both positive.
    pub fn new(
        stepper: Box<dyn Estimating<State = State>>,
        (t0, t1): (f64, f64),
        h: f64,
        h_min: f64,
    ) -> Self {
        Self {
            stepper,
            time: CompensatedTime::new(t0, t1),
            h,
            h_first: h,
            h_min,
            last_error: 1.0,
            rejected: 0,
        }
    }

    /// The error of the last step in units of the tolerance, and the power of h with which it falls.
    pub(super) fn error(&self) -> (f64, f64) {
        (self.stepper.error(), self.stepper.error_order())
    }

    /// The step to try, signed: the last two steps are of equal length.
    fn next_step(&self) -> f64 {
        let left = self.time.left();
        let h = if self.h >= left.abs() {
            left.abs()
        } else {
            self.h.min(left.abs() / 2.0)
        };
        h.copysign(left)
    }

    fn accept(&mut self, h: f64, error: f64, order: f64) {
        self.time.advance(h);
        let error = error.max(LEAST_ERROR);
        let possible = SAFETY * error.powf(-1.0 / order);
        if !(1.0..LEAST_GROWTH).contains(&possible) {
            let factor = SAFETY * error.powf(-0.7 / order) * self.last_error.powf(0.4 / order);
            self.h = (factor.clamp(SHRINK, GROW) * h.abs()).max(self.h_min);
        }
        self.last_error = error;
    }

    /// Shortens the next step where the iteration of this one took so many corrections.
    fn slow_down(&mut self, h: f64, corrections: usize) {
        let most = self.stepper.most_corrections();
        if corrections as f64 > most {
            let factor = (most / corrections as f64).max(SHRINK);
            self.h = self.h.min(factor * h.abs()).max(self.h_min);
        }
    }

    /// Whether a step that failed so is tried again with all attempts: it was refused, as were others before it, or as
    /// none is shorter.
    fn insists(&self, h: f64, refusals: usize) -> bool {
        refusals == MOST_REFUSALS || RETRY_REFUSED * h.abs() < self.h_min
    }

    /// Shortens the step, unless it is the shortest.
    fn reject(&mut self, h: f64, factor: f64, error: f64) -> Result<(), StepError> {
        self.rejected += 1;
        self.h = factor.max(SHRINK) * h.abs();
        if self.h < self.h_min {
            return Err(StepError::StepTooSmall { h: self.h, error });
        }
        Ok(())
    }
}

impl<State: Checkpoint> StepControl<State> for Adaptive<State> {
    fn stepper(&self) -> &dyn Stepper<State = State> {
        &*self.stepper
    }

    fn stepper_mut(&mut self) -> &mut dyn Stepper<State = State> {
        &mut *self.stepper
    }

    fn time(&self) -> f64 {
        self.time.time()
    }

    fn is_over(&self) -> bool {
        self.time.is_over()
    }

    fn step(&mut self, state: &mut State) -> Result<(), StepError> {
        let (before, mut refusals) = (self.rejected, 0);
        let mut is_refusing = self.stepper.most_corrections().is_finite();
        self.stepper.insist(false);
        loop {
            if self.rejected > before && cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let h = self.next_step();
            let corrections = self.stepper.stats().iterations;
            let made = self.stepper.step(self.time.time(), h, state);
            let (error, order) = (self.stepper.error(), self.stepper.error_order());
            match made {
                Ok(()) if error <= 1.0 => {
                    self.accept(h, error, order);
                    self.slow_down(h, self.stepper.stats().iterations - corrections);
                    if self.rejected > before {
                        // a size that was just rejected is not tried again at once
                        self.h = self.h.min(h.abs());
                    }
                    return Ok(());
                }
                Ok(()) => {
                    self.stepper.undo(state);
                    let factor = SAFETY * error.powf(-1.0 / order);
                    self.reject(h, factor, error)?;
                }
                Err(StepError::Interrupted) => return Err(StepError::Interrupted),
                Err(StepError::NotConverged { .. } | StepError::StepTooLarge { .. })
                    if is_refusing =>
                {
                    refusals += 1;
                    self.rejected += 1;
                    is_refusing = !self.insists(h, refusals);
                    self.stepper.insist(!is_refusing);
                    self.h = if is_refusing { RETRY_REFUSED } else { 1.0 } * h.abs();
                }
                Err(error) => self
                    .reject(h, RETRY, f64::INFINITY)
                    .map_err(|too_small| preferred(error, too_small))?,
            }
        }
    }

    fn restart(&mut self, t: f64, _: &State) {
        self.time.go_back(t);
    }

    fn shorten(&mut self, t: f64) {
        self.time.go_back(t);
        self.h = self.h_first.min(self.h);
        self.last_error = 1.0;
    }

    fn rejected(&self) -> usize {
        self.rejected
    }

    fn sizes(&self) -> Option<StepSizes> {
        Some(self.time.sizes(self.h))
    }
}

/// The error of a run whose shortest step fails: the cause, where it lies in the model, else that the step is too small.
pub(super) fn preferred(error: StepError, too_small: StepError) -> StepError {
    match error {
        StepError::NotConverged { .. }
        | StepError::StepTooLarge { .. }
        | StepError::SingularNewton => too_small,
        of_model => of_model,
    }
}

crate::checkpoint!([State: Checkpoint] Adaptive<State> { stepper, time, h, last_error, rejected });
