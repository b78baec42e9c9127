//! How long each step is: all equal, or as long as the estimated errors allow.

use crate::method::{Estimating, Stepper};
use crate::trouble::Trouble;

/// What decides on the steps of a run.
pub trait Pace<S: Stepper>: Send {
    /// The present time.
    fn time(&self) -> f64;

    /// Whether the end is reached.
    fn is_over(&self) -> bool;

    /// Whether the state after step `n` is one to keep, if one in `every` is.
    fn is_due(&self, n: usize, every: usize) -> bool {
        n.is_multiple_of(every)
    }

    /// Makes the next step; on failure state and time are as they were.
    ///
    /// # Errors
    /// Why it could not be made.
    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), Trouble>;

    /// How many steps were made and thrown away.
    fn rejected(&self) -> usize {
        0
    }
}

/// Steps of equal size; times are t0 + n h, computed and not summed up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equal {
    t0: f64,
    h: f64,
    steps: usize,
    n: usize,
}

impl Equal {
    /// This many steps of size `h` from `t0`.
    pub fn new(t0: f64, h: f64, steps: usize) -> Self {
        Self { t0, h, steps, n: 0 }
    }
}

impl<S: Stepper> Pace<S> for Equal {
    fn time(&self) -> f64 {
        self.t0 + self.n as f64 * self.h
    }

    fn is_over(&self) -> bool {
        self.n == self.steps
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), Trouble> {
        stepper.step(Pace::<S>::time(self), self.h, state)?;
        self.n += 1;
        Ok(())
    }
}

/// Equal steps from each of several times to the next, whose states are those to keep.
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

impl<S: Stepper> Pace<S> for Listed {
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

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), Trouble> {
        stepper.step(Pace::<S>::time(self), self.h(), state)?;
        self.n += 1;
        let (end, steps) = self.stops[self.stop];
        if self.n == steps {
            (self.start, self.n) = (end, 0);
            self.stop += 1;
        }
        Ok(())
    }
}

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

/// Steps by a PI controller: with e the error in units of the tolerance, O(h³),
///
///     h ← 0.9 h e_n^(−0.7/3) e_{n−1}^(0.4/3)
///
/// Source: gustafsson1991; hairer1996, IV.2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controlled {
    t: f64,
    t1: f64,
    h: f64,
    least: f64,
    last_error: f64,
    rejected: usize,
}

impl Controlled {
    /// From `t0` to `t1` with a first step `h`, refusing steps below `least`; both positive.
    pub fn new(t0: f64, t1: f64, h: f64, least: f64) -> Self {
        Self {
            t: t0,
            t1,
            h,
            least,
            last_error: 1.0,
            rejected: 0,
        }
    }

    /// The step to try, signed: the last two share what is left.
    fn fitted(&self) -> f64 {
        let left = self.t1 - self.t;
        let h = if self.h >= left.abs() {
            left.abs()
        } else {
            self.h.min(left.abs() / 2.0)
        };
        h.copysign(left)
    }

    fn accept(&mut self, h: f64, error: f64) {
        let is_last = h.abs() >= (self.t1 - self.t).abs();
        self.t = if is_last { self.t1 } else { self.t + h };
        let error = error.max(LEAST_ERROR);
        let possible = SAFETY * error.powf(-1.0 / 3.0);
        if !(1.0..WORTH_IT).contains(&possible) {
            let factor = SAFETY * error.powf(-0.7 / 3.0) * self.last_error.powf(0.4 / 3.0);
            self.h = (factor.clamp(SHRINK, GROW) * h.abs()).max(self.least);
        }
        self.last_error = error;
    }

    /// Shortens the step, unless it is the shortest.
    fn reject(&mut self, h: f64, factor: f64, error: f64) -> Result<(), Trouble> {
        self.rejected += 1;
        self.h = factor.max(SHRINK) * h.abs();
        if self.h < self.least {
            return Err(Trouble::StepTooSmall { h: self.h, error });
        }
        Ok(())
    }
}

impl<S: Estimating> Pace<S> for Controlled {
    fn time(&self) -> f64 {
        self.t
    }

    #[allow(clippy::float_cmp)] // the end is set, not computed
    fn is_over(&self) -> bool {
        self.t == self.t1
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), Trouble> {
        let before = self.rejected;
        loop {
            let h = self.fitted();
            match stepper.step(self.t, h, state) {
                Ok(()) if stepper.error() <= 1.0 => {
                    self.accept(h, stepper.error());
                    if self.rejected > before {
                        // what was just too long is not tried again at once
                        self.h = self.h.min(h.abs());
                    }
                    return Ok(());
                }
                Ok(()) => {
                    let error = stepper.error();
                    stepper.undo(state);
                    self.reject(h, SAFETY * error.powf(-1.0 / 3.0), error)?;
                }
                Err(trouble) => self.reject(h, RETRY, f64::INFINITY).map_err(|_| trouble)?,
            }
        }
    }

    fn rejected(&self) -> usize {
        self.rejected
    }
}
