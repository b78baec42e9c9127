//! Steps as long as the estimated errors allow.

use super::time::CompensatedTime;
use super::{StepControl, StepSizes};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::{Estimating, Stepper};

/// The next step is this much smaller than the one whose error would just be the tolerance.
const SAFETY: f64 = 0.9;
/// Bounds of the ratio of successive steps.
pub(super) const SHRINK: f64 = 0.2;
const GROW: f64 = 4.0;
/// A step is not lengthened by less than this: equal steps keep the factors of their Newton matrix.
const WORTH_IT: f64 = 1.2;
/// A step without a solution is tried again at this fraction.
pub(super) const RETRY: f64 = 0.25;
/// Errors below this say nothing about how much longer a step could be.
const LEAST_ERROR: f64 = 1e-8;

/// Steps by a PI controller: with e the error in units of the tolerance, O(h^k),
///
///     h ← 0.9 h e_n^(−0.7/k) e_{n−1}^(0.4/k)
///
/// Source: gustafsson1991; hairer1996, IV.2.
pub struct Adaptive<State: Checkpoint> {
    stepper: Box<dyn Estimating<State = State>>,
    time: CompensatedTime,
    h: f64,
    first: f64,
    least: f64,
    last_error: f64,
    rejected: usize,
}

impl<State: Checkpoint> Adaptive<State> {
    /// From `t0` to `t1` with a first step `h`, refusing steps below `least`; both positive.
    pub fn new(
        stepper: Box<dyn Estimating<State = State>>,
        (t0, t1): (f64, f64),
        h: f64,
        least: f64,
    ) -> Self {
        Self {
            stepper,
            time: CompensatedTime::new(t0, t1),
            h,
            first: h,
            least,
            last_error: 1.0,
            rejected: 0,
        }
    }

    /// The error of the last step in units of the tolerance, and the power of h with which it falls.
    pub(super) fn error(&self) -> (f64, f64) {
        (self.stepper.error(), self.stepper.error_order())
    }

    /// The step to try, signed: the last two share what is left.
    fn fitted(&self) -> f64 {
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
        if !(1.0..WORTH_IT).contains(&possible) {
            let factor = SAFETY * error.powf(-0.7 / order) * self.last_error.powf(0.4 / order);
            self.h = (factor.clamp(SHRINK, GROW) * h.abs()).max(self.least);
        }
        self.last_error = error;
    }

    /// Shortens the step, unless it is the shortest.
    fn reject(&mut self, h: f64, factor: f64, error: f64) -> Result<(), StepError> {
        self.rejected += 1;
        self.h = factor.max(SHRINK) * h.abs();
        if self.h < self.least {
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
        let before = self.rejected;
        loop {
            let h = self.fitted();
            let made = self.stepper.step(self.time.time(), h, state);
            let (error, order) = (self.stepper.error(), self.stepper.error_order());
            match made {
                Ok(()) if error <= 1.0 => {
                    self.accept(h, error, order);
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
                Err(error) => self
                    .reject(h, RETRY, f64::INFINITY)
                    .map_err(|least| preferred(error, least))?,
            }
        }
    }

    fn restart(&mut self, t: f64, _: &State) {
        self.time.go_back(t);
    }

    fn shorten(&mut self, t: f64) {
        self.time.go_back(t);
        self.h = self.first.min(self.h);
        self.last_error = 1.0;
    }

    fn rejected(&self) -> usize {
        self.rejected
    }

    fn sizes(&self) -> Option<StepSizes> {
        Some(self.time.sizes(self.h))
    }
}

/// The error of a run whose shortest step has no solution: that of the model, if it is one.
pub(super) fn preferred(error: StepError, least: StepError) -> StepError {
    match error {
        StepError::NotConverged { .. }
        | StepError::StepTooLarge { .. }
        | StepError::SingularNewton => least,
        of_model => of_model,
    }
}

crate::checkpoint!([State: Checkpoint] Adaptive<State> { stepper, time, h, last_error, rejected });
