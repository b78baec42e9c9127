//! Resets: the state after an event.

use liouville_base::error::{Quantity, StepError};
use liouville_base::tape::{Registers, Tape};

/// An interval between hits is short that is less than this part of a step, as a power of 2, ...
const SHORT: f64 = 1.0 / (1 << 24) as f64;
/// ... or so many roundings of the time, ...
const ROUNDINGS: f64 = (1 << 20) as f64 * f64::EPSILON;
/// ... or between which the function rises so many times as high as roundoff may.
const HEIGHT: f64 = 16.0;
/// Hits accumulate where so many intervals in turn were each shorter than the one before, and the last is short, ...
const SHRINKING: usize = 4;
/// ... and follow too fast where so many in turn were short.
const MOST_SHORT: usize = 64;
/// A rate after a reset is roundoff below this part of the one before.
pub(super) const RATE: f64 = 1024.0 * f64::EPSILON;

/// The law of a reset.
#[derive(Clone, Debug)]
pub enum Law {
    /// A tape (t, y, z, λ, params) → y, z after it.
    State(Tape),
    /// A tape (t, y, z, λ, params) → ε, e_y of an impact, in which the rate of e is reversed and multiplied by ε.
    Impact(Tape),
}

/// A reset, and the hits before.
#[derive(Clone, Debug)]
pub struct Reset {
    pub(super) is_impact: bool,
    tape: Tape,
    registers: Registers<f64>,
    /// e_t + e_y v, where e is a function of (t, y) alone.
    rate: Option<(Tape, Registers<f64>)>,
    pub(super) intervals: Intervals,
}

impl Reset {
    /// A reset by this law; `rate` is a tape (t, y, z, params) → de/dt, where e is a function of (t, y) alone.
    pub fn new(law: Law, rate: Option<Tape>, params: &[f64]) -> Self {
        let (tape, is_impact) = match law {
            Law::State(tape) => (tape, false),
            Law::Impact(tape) => (tape, true),
        };
        let rate = rate.map(|tape| {
            let registers = tape.bind(params);
            (tape, registers)
        });
        Self {
            is_impact,
            registers: tape.bind(params),
            tape,
            rate,
            intervals: Intervals::default(),
        }
    }

    /// The values of the law at a hit.
    pub(super) fn at(
        &mut self,
        t: f64,
        (y, z): (&[f64], &[f64]),
        (lam, index): (&[f64], usize),
    ) -> Result<&[f64], StepError> {
        let values = self.tape.eval(&mut self.registers, [&[t], y, z, lam]);
        finite(values, index, t)?;
        Ok(values)
    }

    /// The rate of e, if it is known.
    pub(super) fn rate(
        &mut self,
        t: f64,
        (y, z): (&[f64], &[f64]),
        index: usize,
    ) -> Result<Option<f64>, StepError> {
        let Some((tape, registers)) = &mut self.rate else {
            return Ok(None);
        };
        let values = tape.eval(registers, [&[t], y, z]);
        finite(values, index, t)?;
        Ok(Some(values[0]))
    }
}

fn finite(values: &[f64], index: usize, t: f64) -> Result<(), StepError> {
    let quantity = Quantity::Reset;
    if values.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(StepError::NotFinite { quantity, index, t })
}

/// The intervals between the hits of an event.
#[derive(Clone, Debug)]
pub(super) struct Intervals {
    /// When the last hit was, and how long after the one before.
    last: Option<f64>,
    interval: f64,
    /// The rate of e after it, if it is known.
    pub(super) rate: f64,
    /// How many intervals in turn were shorter than the one before, and how many short.
    shrinking: usize,
    short: usize,
}

impl Default for Intervals {
    fn default() -> Self {
        Self {
            last: None,
            interval: f64::INFINITY,
            rate: f64::NAN,
            shrinking: 0,
            short: 0,
        }
    }
}

impl Intervals {
    /// Whether the last hit was a short interval before, in a step of `h`, where e is known to `noise`.
    pub(super) fn is_short(&self, t: f64, h: f64, noise: f64) -> bool {
        let interval = self.last.map_or(f64::INFINITY, |last| (t - last).abs());
        // between hits e is nearly a parabola
        let height = self.rate.abs() * interval / 4.0;
        interval <= SHORT * h.abs() || interval <= ROUNDINGS * t.abs() || height <= HEIGHT * noise
    }

    /// Takes a hit in a step of `h`, where e is known to `noise`; returns where hits accumulate, if they do, and NaN where
    /// they are too many that follow too fast.
    pub(super) fn hit(&mut self, t: f64, h: f64, noise: f64) -> Option<f64> {
        let is_short = self.is_short(t, h, noise);
        let last = self.last.replace(t)?;
        let (interval, before) = ((t - last).abs(), self.interval);
        self.shrinking = if interval < before {
            self.shrinking + 1
        } else {
            0
        };
        self.short = if is_short { self.short + 1 } else { 0 };
        self.interval = interval;
        let ratio = interval / before;
        let left = if ratio < 1.0 {
            ratio / (1.0 - ratio)
        } else {
            0.0
        };
        if is_short && self.shrinking >= SHRINKING {
            return Some(t + left * (t - last));
        }
        (self.short >= MOST_SHORT).then_some(f64::NAN)
    }
}

liouville_base::checkpoint!(Intervals {
    last,
    interval,
    rate,
    shrinking,
    short
});
liouville_base::checkpoint!(Reset { intervals });
