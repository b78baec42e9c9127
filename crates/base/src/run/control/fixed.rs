//! Steps of equal size, or to given ends.

use super::StepControl;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// Steps of equal size, whose ends are t0 + n h, computed and not summed up, or steps to given ends.
pub struct Fixed<State: Checkpoint> {
    stepper: Box<dyn Stepper<State = State>>,
    t0: f64,
    h: f64,
    steps: usize,
    /// The start and the ends of the steps, where these are given.
    given: Vec<f64>,
    n: usize,
    /// Where the next step begins, if that is within it.
    cut: Option<f64>,
}

impl<State: Checkpoint> Fixed<State> {
    /// This many steps of size `h` from `t0`.
    pub fn new(stepper: Box<dyn Stepper<State = State>>, t0: f64, h: f64, steps: usize) -> Self {
        Self {
            stepper,
            t0,
            h,
            steps,
            given: Vec::new(),
            n: 0,
            cut: None,
        }
    }

    /// Steps from the first of these times to the next ones.
    pub fn between(stepper: Box<dyn Stepper<State = State>>, given: Vec<f64>) -> Self {
        let steps = given.len() - 1;
        let h = (given[steps] - given[0]) / steps as f64;
        Self {
            given,
            ..Self::new(stepper, 0.0, h, steps)
        }
    }

    fn end_of(&self, n: usize) -> f64 {
        let equal = || self.t0 + n as f64 * self.h;
        self.given.get(n).copied().unwrap_or_else(equal)
    }

    fn present(&self) -> f64 {
        self.cut.unwrap_or_else(|| self.end_of(self.n))
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
        let h = match self.cut {
            None if self.given.is_empty() => self.h,
            _ => self.end_of(self.n + 1) - self.present(),
        };
        self.stepper.step(self.present(), h, state)?;
        self.n += 1;
        self.cut = None;
        Ok(())
    }

    fn step_part(&mut self, state: &mut State, part: f64) -> Option<Result<(), StepError>> {
        let (t, end) = (self.present(), self.end_of(self.n + 1));
        let length = (part * self.h).abs().min((end - t).abs() / 2.0);
        let h = length.copysign(self.h);
        let made = self.stepper.step(t, h, state);
        if made.is_ok() {
            self.cut = Some(t + h);
        }
        Some(made)
    }

    fn restart(&mut self, t: f64, _: &State) {
        if t.to_bits() != self.present().to_bits() {
            // after a part of a step the step is still the next one
            self.n -= usize::from(self.cut.is_none());
            self.cut = Some(t);
        }
    }

    fn shorten(&mut self, t: f64) {
        self.n -= 1;
        self.cut = Some(t);
    }
}

crate::checkpoint!([State: Checkpoint] Fixed<State> { stepper, n, cut });
