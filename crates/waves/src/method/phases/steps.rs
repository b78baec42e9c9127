//! Steps of a split operator to a tolerance.
//!
//! A step is made as two halves and as one. Their difference is 2^p − 1 times the error of the halves where steps are short
//! against all that moves; a smaller number is taken, which longer steps bear. H is Hermitian, or damps, so that errors of
//! steps add: each step has the share of the tolerance that its length has of the run.

use super::Phases;
use crate::method::Wave;
use crate::method::doubling::Doubling;
use crate::method::driven::{next_break, next_time};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};

/// The part of the tolerance that estimates may add up to.
const SHARE: f64 = 0.8;

/// The error of the halves is that part of the difference at least. With 1/15 and this share errors were at most 0.45 of
/// tolerances from 1e-2 to 1e-7 in six potentials, two of them with pulses; with 1/63, as orders of 6 have it, 5.3 at 1e-2.
const RATIO: f64 = 15.0;

/// A proposed step has about this part of the length that is within the tolerance, ...
const SAFETY: f64 = 0.9;
/// ... as a power of 2^(1/4) times the last one, since a new length takes new tables; these are the least and the largest.
const POWERS: (f64, f64) = (-12.0, 8.0);
const PER_OCTAVE: f64 = 4.0;

/// Rounding errors of a step for each unit of its phase.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Lengths that differ by so many roundings of the time are one, whose tables are there.
const SAME: f64 = 4.0 * f64::EPSILON;

/// No step is shorter than so many roundings of the time.
const LEAST: f64 = 64.0 * f64::EPSILON;

/// The length of the step by which the width of the energies of a state is found, in units of 1/β.
const FIRST: f64 = 0.5;

/// The length of steps is settled after so many, or where the next one is at most so much longer than the last.
const STEPS: usize = 4;
const SETTLED: f64 = 1.5;

/// The tolerance of a split operator, and what is known of its steps.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitTolerance {
    /// Order of the splitting.
    pub order: usize,
    /// Error allowed in a unit of time.
    pub rate: f64,
    /// Half the width of the spectrum.
    pub beta: f64,
    /// The first step; infinite where a pilot is to find it.
    pub first: f64,
    /// The longest step.
    pub longest: f64,
    /// Times at which steps end besides, in the order of the run.
    pub breaks: Vec<f64>,
}

/// A split operator with steps as long as a tolerance allows.
#[derive(Clone)]
pub struct SplitSteps {
    composed: Composed<Phases>,
    doubling: Doubling,
    tolerance: SplitTolerance,
    /// The length of the next step at most, and that of the last one.
    next: f64,
    last: f64,
}

impl SplitSteps {
    /// Steps by a list of flows.
    pub fn new(phases: Phases, program: Vec<Flow>, tolerance: SplitTolerance) -> Self {
        Self {
            doubling: Doubling::new(phases.psi.len()),
            composed: Composed::following(phases, program),
            next: tolerance.first.min(tolerance.longest),
            last: 0.0,
            tolerance,
        }
    }

    /// The first steps of a run, and as many more as a number of flows of T allows: the length that they settle at, and
    /// where they lead.
    ///
    /// The first has the inverse of the width of the energies of the state, by 1 − |⟨ψ(t)|ψ(t + δ)⟩|² = (ΔE δ)² + ...
    ///
    /// # Errors
    /// A step failed, or the pilot was interrupted.
    pub fn pilot(
        &mut self,
        (t, end): (f64, f64),
        flows: usize,
        state: &mut Wave<f64>,
    ) -> Result<(f64, f64), StepError> {
        let left = (end - t).abs();
        self.next = left.min(self.width(t, end, state)?.recip());
        self.next = self.next.min(self.tolerance.longest);
        let (mut now, mut made, mut settled) = (t, 0, None);
        while now.to_bits() != end.to_bits() {
            now = self.advance(now, end, state)?;
            made += 1;
            if settled.is_none() && (made == STEPS || self.next <= SETTLED * self.last.abs()) {
                settled = Some(self.next);
            }
            if settled.is_some() && self.stats().evaluations / 2 >= flows {
                break;
            }
        }
        Ok((settled.unwrap_or(self.next), now))
    }

    /// The width of the energies of a state, by a short step.
    fn width(&mut self, t: f64, end: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        let short = (end - t).abs().min(FIRST / self.tolerance.beta);
        let h = short.copysign(end - t);
        self.doubling.step(&mut self.composed, (t, h), state)?;
        let before = self.doubling.before();
        let overlap = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let real = overlap(&before.q, &state.q) + overlap(&before.p, &state.p);
        let imaginary = overlap(&before.q, &state.p) - overlap(&before.p, &state.q);
        let size = overlap(&before.q, &before.q) + overlap(&before.p, &before.p);
        let rest = 1.0 - (real * real + imaginary * imaginary) / (size * size);
        self.doubling.put_back(state);
        Ok(rest.max(f64::EPSILON).sqrt() / short)
    }

    /// One step to at most `end`, and where it leads.
    fn advance(&mut self, t: f64, end: f64, state: &mut Wave<f64>) -> Result<f64, StepError> {
        let least = LEAST * t.abs().max(end.abs());
        loop {
            let h = self.length(t, end - t);
            if h.to_bits() != self.last.to_bits() {
                self.composed.parts_mut().forget_tables();
            }
            let apart = self.doubling.step(&mut self.composed, (t, h), state)?;
            let error = self.error(apart, h, state.start);
            let allowed = SHARE * self.tolerance.rate * h.abs();
            self.last = h;
            self.propose(allowed / error);
            if error <= allowed {
                return Ok(next_time(t, h, end));
            }
            self.doubling.put_back(state);
            if h.abs() <= least {
                return Err(StepError::StepTooSmall { h, error });
            }
        }
    }

    /// The next step where so much is left: equal parts of it, and the same bits as before where it has the same length.
    fn length(&self, t: f64, left: f64) -> f64 {
        let parts = (left.abs() / self.next * (1.0 - f64::EPSILON))
            .ceil()
            .max(1.0);
        let h = left / parts;
        let is_same = (h - self.last).abs() <= SAME * t.abs().max((t + left).abs());
        if is_same { self.last } else { h }
    }

    /// The error of two halves that are so far off a step made as one, relative to the norm at the start.
    fn error(&self, apart: f64, h: f64, start: f64) -> f64 {
        let noise = ROUNDING * (1.0 + self.tolerance.beta * h.abs());
        let found = if start > 0.0 {
            apart / start.sqrt()
        } else {
            0.0
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
        let ratio = 2.0_f64.powi(self.tolerance.order as i32) - 1.0;
        (found - noise).max(0.0) / ratio.min(RATIO)
    }

    /// Chooses the length of the next step, of one whose error is to change by a factor.
    fn propose(&mut self, factor: f64) {
        let longer = SAFETY * factor.powf(1.0 / self.tolerance.order as f64);
        let (least, largest) = POWERS;
        // no number where the error is none
        let power = (PER_OCTAVE * longer.log2()).floor().max(least).min(largest);
        let power = if factor >= 1.0 {
            power.max(0.0)
        } else {
            power.min(-1.0)
        };
        let next = self.last.abs() * (power / PER_OCTAVE).exp2();
        self.next = next.min(self.tolerance.longest);
    }
}

impl Stepper for SplitSteps {
    type State = Wave<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut Wave<f64>) -> Result<(), StepError> {
        let (mut now, end) = (t, t + h);
        while now.to_bits() != end.to_bits() {
            let next = next_break(self.tolerance.breaks.iter(), now, end);
            now = self.advance(now, next, state)?;
        }
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Wave<f64>) -> Result<(), StepError> {
        self.composed.synchronize(state)
    }

    fn stats(&self) -> Stats {
        self.composed.stats()
    }
}

impl Checkpoint for SplitSteps {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        (self.next, self.last).save(member, out);
        self.composed.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut lengths = (0.0, 0.0);
        lengths.restore(member, saved)?;
        (self.next, self.last) = lengths;
        self.composed.restore(member, saved)
    }
}
