//! Steps that follow a monitor s of the state, by a rule that time reversal does not see.
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
use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::Symmetric;
use crate::observe::Monitor;

/// Bound of the ratio of a half update; successive steps differ by its square at most.
const BOUND: f64 = 1.5;
/// A step that misses the end by less than this part of it is made to reach it.
const NEARLY: f64 = 1e-3;

/// Steps by the monitor `M`.
#[derive(Clone, Debug)]
pub struct Reversible<M> {
    time: CompensatedTime,
    /// The sign of the steps.
    sign: f64,
    /// The step size at the present state.
    h: f64,
    least: f64,
    monitor: M,
    /// ω at the present state, if it could be told there.
    rate: Option<f64>,
}

impl<M> Reversible<M> {
    /// From `t0` to `t1` with a step of about `h` at the start, refusing steps below `least`; both
    /// positive.
    pub fn new<State>(
        (t0, t1): (f64, f64),
        h: f64,
        least: f64,
        mut monitor: M,
        state: &State,
    ) -> Self
    where
        M: Monitor<State>,
    {
        let rate = monitor.rate(t0, state).ok();
        Self {
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

impl<S: Symmetric, M: Monitor<S::State>> StepControl<S> for Reversible<M> {
    fn time(&self) -> f64 {
        self.time.time()
    }

    fn is_over(&self) -> bool {
        self.time.is_over()
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), StepError> {
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
        stepper.step(self.time.time(), h, state)?;
        stepper.synchronize(state)?;
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

impl<M: Checkpoint> Checkpoint for Reversible<M> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.time.save(member, out);
        self.h.save(member, out);
        self.monitor.save(member, out);
        self.rate.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.time.restore(member, saved)?;
        self.h.restore(member, saved)?;
        self.monitor.restore(member, saved)?;
        self.rate.restore(member, saved)
    }
}
