//! Steps of equal size.

use super::StepControl;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// Steps of equal size; times are t0 + n h, computed and not summed up.
pub struct Fixed<State: Checkpoint> {
    stepper: Box<dyn Stepper<State = State>>,
    t0: f64,
    h: f64,
    steps: usize,
    n: usize,
}

impl<State: Checkpoint> Fixed<State> {
    /// This many steps of size `h` from `t0`.
    pub fn new(stepper: Box<dyn Stepper<State = State>>, t0: f64, h: f64, steps: usize) -> Self {
        Self {
            stepper,
            t0,
            h,
            steps,
            n: 0,
        }
    }

    fn present(&self) -> f64 {
        self.t0 + self.n as f64 * self.h
    }
}

impl<State: Checkpoint> StepControl<State> for Fixed<State> {
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
        self.n == self.steps
    }

    fn step(&mut self, state: &mut State) -> Result<(), StepError> {
        self.stepper.step(self.present(), self.h, state)?;
        self.n += 1;
        Ok(())
    }
}

crate::checkpoint!([State: Checkpoint] Fixed<State> { stepper, n });
