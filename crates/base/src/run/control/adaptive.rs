//! Steps as long as the estimated errors allow.

use super::clock::Clock;
use super::{Pace, Sizes};
use crate::checkpoint::{Foreign, Memory};
use crate::error::Trouble;
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
pub struct Controlled {
    clock: Clock,
    h: f64,
    least: f64,
    last_error: f64,
    rejected: usize,
}

impl Controlled {
    /// From `t0` to `t1` with a first step `h`, refusing steps below `least`; both positive.
    pub fn new(t0: f64, t1: f64, h: f64, least: f64) -> Self {
        Self {
            clock: Clock::new(t0, t1),
            h,
            least,
            last_error: 1.0,
            rejected: 0,
        }
    }

    /// The step to try, signed: the last two share what is left.
    fn fitted(&self) -> f64 {
        let left = self.clock.left();
        let h = if self.h >= left.abs() {
            left.abs()
        } else {
            self.h.min(left.abs() / 2.0)
        };
        h.copysign(left)
    }

    fn accept(&mut self, h: f64, error: f64, order: f64) {
        self.clock.advance(h);
        let error = error.max(LEAST_ERROR);
        let possible = SAFETY * error.powf(-1.0 / order);
        if !(1.0..WORTH_IT).contains(&possible) {
            let factor = SAFETY * error.powf(-0.7 / order) * self.last_error.powf(0.4 / order);
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
        self.clock.time()
    }

    fn is_over(&self) -> bool {
        self.clock.is_over()
    }

    fn step(&mut self, stepper: &mut S, state: &mut S::State) -> Result<(), Trouble> {
        let before = self.rejected;
        loop {
            let h = self.fitted();
            match stepper.step(self.clock.time(), h, state) {
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
                Err(trouble) => self
                    .reject(h, RETRY, f64::INFINITY)
                    .map_err(|least| unless_said(trouble, least))?,
            }
        }
    }

    fn rejected(&self) -> usize {
        self.rejected
    }

    fn sizes(&self) -> Option<Sizes> {
        Some(self.clock.sizes(self.h))
    }
}

/// What ends a run whose shortest step has no solution: what the model says, if it says anything.
fn unless_said(trouble: Trouble, least: Trouble) -> Trouble {
    match trouble {
        Trouble::NotConverged { .. } | Trouble::SingularNewton => least,
        said => said,
    }
}

impl Memory for Controlled {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.clock.save(member, out);
        self.h.save(member, out);
        self.last_error.save(member, out);
        self.rejected.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), Foreign> {
        self.clock.restore(member, saved)?;
        self.h.restore(member, saved)?;
        self.last_error.restore(member, saved)?;
        self.rejected.restore(member, saved)
    }
}
