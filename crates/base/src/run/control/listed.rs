//! Steps from each of several times to the next.

use super::StepControl;
use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::Stepper;

/// Fixed steps from each of several times to the next, whose states are those to keep.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    start: f64,
    stops: Vec<(f64, usize)>,
    stop: usize,
    n: usize,
}

impl Listed {
    /// From `t0` to each of these times in turn, by so many steps.
    pub fn new(t0: f64, stops: Vec<(f64, usize)>) -> Self {
        Self {
            start: t0,
            stops,
            stop: 0,
            n: 0,
        }
    }

    fn h(&self) -> f64 {
        let (end, steps) = self.stops[self.stop];
        (end - self.start) / steps as f64
    }
}

impl<S: Stepper> StepControl<S> for Listed {
    fn time(&self) -> f64 {
        match self.n {
            0 => self.start,
            n => self.start + n as f64 * self.h(),
        }
    }

    fn is_over(&self) -> bool {
        self.stop == self.stops.len()
    }

    fn is_due(&self, _: usize, _: usize) -> bool {
        self.n == 0
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), StepError> {
        stepper.step(StepControl::<S>::time(self), self.h(), state)?;
        self.n += 1;
        let (end, steps) = self.stops[self.stop];
        if self.n == steps {
            (self.start, self.n) = (end, 0);
            self.stop += 1;
        }
        Ok(())
    }
}

impl Checkpoint for Listed {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.start.save(member, out);
        self.stop.save(member, out);
        self.n.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.start.restore(member, saved)?;
        self.stop.restore(member, saved)?;
        self.n.restore(member, saved)
    }
}
