//! Steps of equal size.

use super::StepControl;
use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::Stepper;

/// Steps of equal size; times are t0 + n h, computed and not summed up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixed {
    t0: f64,
    h: f64,
    steps: usize,
    n: usize,
}

impl Fixed {
    /// This many steps of size `h` from `t0`.
    pub fn new(t0: f64, h: f64, steps: usize) -> Self {
        Self { t0, h, steps, n: 0 }
    }
}

impl<S: Stepper> StepControl<S> for Fixed {
    fn time(&self) -> f64 {
        self.t0 + self.n as f64 * self.h
    }

    fn is_over(&self) -> bool {
        self.n == self.steps
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), StepError> {
        stepper.step(StepControl::<S>::time(self), self.h, state)?;
        self.n += 1;
        Ok(())
    }
}

impl Checkpoint for Fixed {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.n.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.n.restore(member, saved)
    }
}
