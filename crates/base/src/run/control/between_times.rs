//! Steps from each of several times to the next.

use super::StepControl;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// Equal steps from each of several times to the next, at which the states are recorded.
pub struct BetweenTimes<State: Checkpoint> {
    stepper: Box<dyn Stepper<State = State>>,
    start: f64,
    stops: Vec<(f64, usize)>,
    stop: usize,
    n: usize,
}

impl<State: Checkpoint> BetweenTimes<State> {
    /// From `t0` to each of these times in turn, by so many steps.
    pub fn new(
        stepper: Box<dyn Stepper<State = State>>,
        t0: f64,
        stops: Vec<(f64, usize)>,
    ) -> Self {
        Self {
            stepper,
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

    fn present(&self) -> f64 {
        match self.n {
            0 => self.start,
            n => self.start + n as f64 * self.h(),
        }
    }
}

impl<State: Checkpoint> StepControl<State> for BetweenTimes<State> {
    fn stepper(&self) -> &dyn Stepper<State = State> {
        &*self.stepper
    }

    fn stepper_mut(&mut self) -> &mut dyn Stepper<State = State> {
        &mut *self.stepper
    }

    fn time(&self) -> f64 {
        self.present()
    }

    fn is_over(&self) -> bool {
        self.stop == self.stops.len()
    }

    fn is_due(&self, _: usize, _: usize) -> bool {
        self.n == 0
    }

    fn step(&mut self, state: &mut State) -> Result<(), StepError> {
        self.stepper.step(self.present(), self.h(), state)?;
        self.n += 1;
        let (end, steps) = self.stops[self.stop];
        if self.n == steps {
            (self.start, self.n) = (end, 0);
            self.stop += 1;
        }
        Ok(())
    }
}

crate::checkpoint!([State: Checkpoint] BetweenTimes<State> { stepper, start, stop, n });
