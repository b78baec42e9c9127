//! Steps that follow a monitor s of the state, by a rule that is symmetric under time reversal.
//!
//! With ω = (ds/dt)/s at the states between the steps, positive where steps should grow,
//!
//!     1/h_n = 1/h_{n−1/2} − ω_n/2,     1/h_{n+1/2} = 1/h_n − ω_n/2
//!
//! h_{n+1/2} being the step from state n to state n + 1. This is hairer2005 in the density 1/h in
//! place of ε/h. A half update whose ratio would leave [1/B, B], or have no sign, has the bound as its
//! ratio: that keeps steps positive. Reversing the velocities turns the sign of ω and so undoes each
//! half update, the bounded ones too: h ↦ h/x with x = 1 − ωh/2 is inverse to h ↦ h/x' with
//! x' = 1 + ωh/2, and x ≤ 1/B makes x' ≥ B. The step itself is all that has to be known to go on, or
//! back.

use super::time::CompensatedTime;
use super::{StepControl, StepSizes};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::{Stepper, Symmetric};
use crate::observe::Monitor;

/// Bound of the ratio of a half update; successive steps differ by its square at most.
const BOUND: f64 = 1.5;
/// A step that misses the end by less than this part of it is made to reach it.
const NEARLY: f64 = 1e-3;

/// Steps that follow a monitor.
pub struct Reversible<State: Checkpoint> {
    stepper: Box<dyn Symmetric<State = State>>,
    time: CompensatedTime,
    /// The sign of the steps.
    sign: f64,
    /// The step size at the present state.
    h: f64,
    least: f64,
    monitor: Box<dyn Monitor<State>>,
    /// ω at the present state, if it could be evaluated there.
    rate: Option<f64>,
}

impl<State: Checkpoint> Reversible<State> {
    /// From `t0` to `t1` with a step of about `h` at the start `state`, refusing steps below `least`; both
    /// positive.
    pub fn new(
        stepper: Box<dyn Symmetric<State = State>>,
        (t0, t1): (f64, f64),
        (h, least): (f64, f64),
        mut monitor: Box<dyn Monitor<State>>,
        state: &State,
    ) -> Self {
        let rate = monitor.rate(t0, state).ok();
        Self {
            stepper,
            time: CompensatedTime::new(t0, t1),
            sign: (t1 - t0).signum(),
            h,
            least,
            monitor,
            rate,
        }
    }

    /// The step size half a step later, or earlier.
    fn updated(&self, h: f64, rate: f64) -> f64 {
        h / (1.0 - self.sign * rate * h / 2.0).clamp(1.0 / BOUND, BOUND)
    }
}

impl<State: Checkpoint> StepControl<State> for Reversible<State> {
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
        let left = self.time.left();
        let rate = match self.rate {
            Some(rate) => rate,
            None => self.monitor.rate(self.time.time(), state)?,
        };
        let wanted = self.updated(self.h, rate);
        if wanted < self.least {
            let error = f64::NAN;
            return Err(StepError::StepTooSmall { h: wanted, error });
        }
        let h = if wanted * (1.0 + NEARLY) < left.abs() {
            self.sign * wanted
        } else {
            left
        };
        self.stepper.step(self.time.time(), h, state)?;
        self.stepper.synchronize(state)?;
        self.time.advance(h);
        self.rate = self.monitor.rate(self.time.time(), state).ok();
        self.h = match self.rate {
            Some(rate) => self.updated(wanted, rate),
            None => wanted,
        };
        Ok(())
    }

    fn sizes(&self) -> Option<StepSizes> {
        Some(self.time.sizes(self.h))
    }
}

crate::checkpoint!([State: Checkpoint] Reversible<State> { stepper, time, h, monitor, rate });
