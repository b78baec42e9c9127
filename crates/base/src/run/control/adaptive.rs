//! Steps as long as the estimated errors allow.

use super::time::CompensatedTime;
use super::{StepControl, StepSizes};
use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::Estimating;

/// The next step is this much smaller than the one whose error would just be the tolerance.
const SAFETY: f64 = 0.9;
/// Bounds of the ratio of successive steps.
const SHRINK: f64 = 0.2;
const GROW: f64 = 4.0;
/// A step is not lengthened by less than this: equal steps keep the factors of their Newton matrix.
const WORTH_IT: f64 = 1.2;
/// A step without a solution is tried again at this fraction.
const RETRY: f64 = 0.25;
/// Errors below this say nothing about how much longer a step could be.
const LEAST_ERROR: f64 = 1e-8;

/// Steps by a PI controller: with e the error in units of the tolerance, O(h^k),
///
///     h ← 0.9 h e_n^(−0.7/k) e_{n−1}^(0.4/k)
///
/// Source: gustafsson1991; hairer1996, IV.2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptive {
    time: CompensatedTime,
    h: f64,
    least: f64,
    last_error: f64,
    rejected: usize,
}

impl Adaptive {
    /// From `t0` to `t1` with a first step `h`, refusing steps below `least`; both positive.
    pub fn new(t0: f64, t1: f64, h: f64, least: f64) -> Self {
        Self {
            time: CompensatedTime::new(t0, t1),
            h,
            least,
            last_error: 1.0,
            rejected: 0,
        }
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

impl<S: Estimating> StepControl<S> for Adaptive {
    fn time(&self) -> f64 {
        self.time.time()
    }

    fn is_over(&self) -> bool {
        self.time.is_over()
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), StepError> {
        let before = self.rejected;
        loop {
            let h = self.fitted();
            match stepper.step(self.time.time(), h, state) {
                Ok(()) if stepper.error() <= 1.0 => {
                    self.accept(h, stepper.error(), stepper.error_order());
                    if self.rejected > before {
                        // what was just too long is not tried again at once
                        self.h = self.h.min(h.abs());
                    }
                    return Ok(());
                }
                Ok(()) => {
                    let error = stepper.error();
                    stepper.undo(state);
                    let factor = SAFETY * error.powf(-1.0 / stepper.error_order());
                    self.reject(h, factor, error)?;
                }
                Err(error) => self
                    .reject(h, RETRY, f64::INFINITY)
                    .map_err(|least| unless_said(error, least))?,
            }
        }
    }

    fn rejected(&self) -> usize {
        self.rejected
    }

    fn sizes(&self) -> Option<StepSizes> {
        Some(self.time.sizes(self.h))
    }
}

/// What ends a run whose shortest step has no solution: what the model says, if it says anything.
fn unless_said(error: StepError, least: StepError) -> StepError {
    match error {
        StepError::NotConverged { .. } | StepError::SingularNewton => least,
        said => said,
    }
}

impl Checkpoint for Adaptive {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.time.save(member, out);
        self.h.save(member, out);
        self.last_error.save(member, out);
        self.rejected.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.time.restore(member, saved)?;
        self.h.restore(member, saved)?;
        self.last_error.restore(member, saved)?;
        self.rejected.restore(member, saved)
    }
}
