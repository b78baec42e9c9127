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

use super::adaptive::{RETRY, SHRINK, preferred};
use super::time::CompensatedTime;
use super::trial::Trial;
use super::{Adaptive, StepControl, StepSizes};
use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::error::StepError;
use crate::method::{Estimating, Stepper, Symmetric};
use crate::observe::{Fitted, Monitor};

/// Bound of the ratio of a half update; successive steps differ by its square at most.
const BOUND: f64 = 1.5;
/// A step that would miss the end by less than this fraction of itself is stretched to reach it.
const STRETCH: f64 = 1e-3;

/// A step whose error is more than this many tolerances is made again with a smaller scale.
const MOST_ERROR: f64 = 2.0;
/// The fraction of the allowed step that is tried then.
const SAFETY: f64 = 0.9;

/// The stepper, of a symmetric method or of one with an error estimate.
enum StepMaker<State> {
    Symmetric(Box<dyn Symmetric<State = State>>),
    Estimating(Box<dyn Estimating<State = State>>),
}

/// Steps that follow a monitor.
pub struct Reversible<State: Checkpoint> {
    stepper: StepMaker<State>,
    time: CompensatedTime,
    /// The sign of the steps.
    sign: f64,
    /// The step size at the present state, and at the one before the last step.
    h: f64,
    before: f64,
    h_min: f64,
    /// The monitor that the steps follow; none before the end of the trial that fits it.
    monitor: Option<Box<dyn Monitor<State>>>,
    trial: Option<Trial<State>>,
    /// The step size at the start, as the trial has fitted it.
    h_first: f64,
    /// ω at the present state, if it could be evaluated there.
    rate: Option<f64>,
    rejected: usize,
}

impl<State: Checkpoint> Reversible<State> {
    /// From `t0` to `t1` with a step of about `h` at the start `state`, refusing steps below `h_min`; both
    /// positive.
    pub fn new(
        stepper: Box<dyn Symmetric<State = State>>,
        (t0, t1): (f64, f64),
        (h, h_min): (f64, f64),
        mut monitor: Box<dyn Monitor<State>>,
        state: &State,
    ) -> Self {
        let rate = monitor.rate(t0, state).ok();
        Self {
            monitor: Some(monitor),
            rate,
            ..Self::of(StepMaker::Symmetric(stepper), (t0, t1), (h, h_min))
        }
    }

    /// Steps that meet the tolerance of a method, which need not be symmetric. A `trial` of at most `most` steps with a
    /// copy of the stepper fits their size; where a step turns out too long, the steps from there on are shorter.
    pub fn within_tolerance(
        [mut stepper, trial]: [Box<dyn Estimating<State = State>>; 2],
        most: usize,
        ends: (f64, f64),
        (h, h_min): (f64, f64),
        monitor: Box<dyn Fitted<State>>,
        state: &State,
    ) -> Self
    where
        State: Clone,
    {
        let trial = Adaptive::new(trial, ends, h, h_min);
        // its steps are as long as the rule wants them
        stepper.insist(true);
        Self {
            trial: Some(Trial::new(trial, most, state.clone(), monitor)),
            ..Self::of(StepMaker::Estimating(stepper), ends, (h, h_min))
        }
    }

    fn of(stepper: StepMaker<State>, (t0, t1): (f64, f64), (h, h_min): (f64, f64)) -> Self {
        Self {
            stepper,
            time: CompensatedTime::new(t0, t1),
            sign: (t1 - t0).signum(),
            h,
            before: h,
            h_min,
            monitor: None,
            trial: None,
            h_first: h,
            rate: None,
            rejected: 0,
        }
    }

    /// ω at the present time.
    fn rate_at(&mut self, state: &State) -> Result<f64, StepError> {
        let t = self.time.time();
        self.monitor
            .as_mut()
            .map_or(Ok(0.0), |monitor| monitor.rate(t, state))
    }

    /// The step size half a step later, or earlier.
    fn updated(&self, h: f64, rate: f64) -> f64 {
        h / (1.0 - self.sign * rate * h / 2.0).clamp(1.0 / BOUND, BOUND)
    }

    /// Makes a step of `h`; where the error is too large, undoes it and returns the fraction to try instead.
    fn make(&mut self, h: f64, state: &mut State) -> Result<Option<f64>, StepError> {
        let t = self.time.time();
        let made = self.stepper_mut().step(t, h, state);
        let StepMaker::Estimating(stepper) = &mut self.stepper else {
            return made.map(|()| None);
        };
        match made {
            Ok(()) if stepper.error() <= MOST_ERROR => Ok(None),
            Ok(()) => {
                stepper.undo(state);
                let error = stepper.error();
                let allowed = SAFETY * error.powf(-1.0 / stepper.error_order());
                self.shorter(h, allowed.max(SHRINK), error).map(Some)
            }
            Err(error) => {
                let shorter = self.shorter(h, RETRY, f64::INFINITY).map(Some);
                shorter.map_err(|too_small| preferred(error, too_small))
            }
        }
    }

    /// The fraction of a step to try, unless that step is too short.
    fn shorter(&self, h: f64, part: f64, error: f64) -> Result<f64, StepError> {
        let h = part * h.abs();
        if h < self.h_min {
            return Err(StepError::StepTooSmall { h, error });
        }
        Ok(part)
    }
}

impl<State: Checkpoint> StepControl<State> for Reversible<State> {
    fn stepper(&self) -> &dyn Stepper<State = State> {
        match &self.stepper {
            StepMaker::Symmetric(stepper) => &**stepper,
            StepMaker::Estimating(stepper) => &**stepper,
        }
    }

    fn stepper_mut(&mut self) -> &mut dyn Stepper<State = State> {
        match &mut self.stepper {
            StepMaker::Symmetric(stepper) => &mut **stepper,
            StepMaker::Estimating(stepper) => &mut **stepper,
        }
    }

    fn time(&self) -> f64 {
        self.time.time()
    }

    fn is_over(&self) -> bool {
        self.time.is_over()
    }

    fn prepare(&mut self, state: &State) -> bool {
        let Some(mut trial) = self.trial.take() else {
            return true;
        };
        if !trial.step() {
            self.trial = Some(trial);
            return false;
        }
        let (monitor, first) = trial.fit();
        self.monitor = Some(monitor);
        self.h = first.unwrap_or(self.h);
        self.h_first = self.h;
        self.rate = self.rate_at(state).ok();
        true
    }

    fn step(&mut self, state: &mut State) -> Result<(), StepError> {
        while !self.prepare(state) {}
        let left = self.time.left();
        let rate = match self.rate {
            Some(rate) => rate,
            None => self.rate_at(state)?,
        };
        let (mut wanted, mut h);
        loop {
            wanted = self.updated(self.h, rate);
            if wanted < self.h_min {
                let error = f64::NAN;
                return Err(StepError::StepTooSmall { h: wanted, error });
            }
            h = if wanted * (1.0 + STRETCH) < left.abs() {
                self.sign * wanted
            } else {
                left
            };
            let Some(shorter) = self.make(h, state)? else {
                break;
            };
            self.rejected += 1;
            self.h *= shorter;
        }
        self.stepper_mut().synchronize(state)?;
        self.before = self.h;
        self.time.advance(h);
        self.rate = self.rate_at(state).ok();
        self.h = match self.rate {
            Some(rate) => self.updated(wanted, rate),
            None => wanted,
        };
        Ok(())
    }

    fn restart(&mut self, t: f64, state: &State) {
        self.time.go_back(t);
        self.h = self.before;
        self.rate = self.rate_at(state).ok();
    }

    fn rejected(&self) -> usize {
        self.rejected
    }

    fn sizes(&self) -> Option<StepSizes> {
        Some(self.time.sizes(self.h))
    }
}

impl<State: Checkpoint> Checkpoint for StepMaker<State> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        match self {
            Self::Symmetric(stepper) => stepper.save(member, out),
            Self::Estimating(stepper) => stepper.save(member, out),
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        match self {
            Self::Symmetric(stepper) => stepper.restore(member, saved),
            Self::Estimating(stepper) => stepper.restore(member, saved),
        }
    }
}

/// A run saved before the end of its trial repeats the trial; one that is restored to such a time after its trial keeps
/// the result.
impl<State: Checkpoint> Checkpoint for Reversible<State> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.stepper.save(member, out);
        self.time.save(member, out);
        self.h.save(member, out);
        self.monitor.is_some().save(member, out);
        if let Some(monitor) = &self.monitor {
            monitor.save(member, out);
            self.h_first.save(member, out);
        }
        self.rate.save(member, out);
        self.rejected.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.stepper.restore(member, saved)?;
        self.time.restore(member, saved)?;
        self.h.restore(member, saved)?;
        let mut is_fitted = false;
        is_fitted.restore(member, saved)?;
        if is_fitted {
            if let Some(trial) = self.trial.take() {
                self.monitor = Some(trial.fit().0);
            }
            let monitor = self.monitor.as_mut().ok_or(CheckpointMismatch)?;
            monitor.restore(member, saved)?;
            self.h_first.restore(member, saved)?;
        }
        self.rate.restore(member, saved)?;
        self.rejected.restore(member, saved)?;
        if !is_fitted && self.trial.is_none() {
            self.h = self.h_first;
            self.rate = None;
        }
        Ok(())
    }
}
