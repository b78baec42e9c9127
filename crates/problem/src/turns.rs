//! Angles that a state knows up to a period, continued from step to step over turns.

use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// An angle is continued if it is where its rate says up to this part of its period.
const NEAR: f64 = 0.25;

/// Angles that are continued.
#[derive(Clone, Debug)]
pub struct Turning {
    /// A tape (t, y, z, params) → the angles, then their rates.
    pub tape: Arc<Tape>,
    /// The period of each.
    pub periods: Arc<[f64]>,
}

impl Turning {
    /// How many angles there are.
    pub fn count(&self) -> usize {
        self.periods.len()
    }
}

/// The angles of one motion, or of several in lock-step, at the last state seen.
#[derive(Clone, Debug)]
pub(crate) struct Turns<R = f64> {
    of: Turning,
    registers: Registers<R>,
    /// The time of that state, not a number before the first.
    t: f64,
    /// Angles and rates there, of one member after another.
    last: Vec<f64>,
}

impl<R: Real> Turns<R> {
    /// Angles of this many members with these parameters.
    ///
    /// # Panics
    /// When the tape's inputs are not (t, y, z, params).
    pub(crate) fn new(of: Turning, params: &[R], members: usize) -> Self {
        Self {
            registers: of.tape.bind(params),
            t: f64::NAN,
            last: vec![0.0; members * of.tape.outputs()],
            of,
        }
    }

    /// How many angles a member has.
    pub(crate) fn count(&self) -> usize {
        self.of.count()
    }

    /// Goes on to a state; an angle that is not where its rates say is not a number from there on.
    pub(crate) fn follow(&mut self, t: f64, y: &[R], z: &[R]) {
        let (count, h) = (self.count(), t - self.t);
        let args: [&[R]; 3] = [&[R::splat(t)], y, z];
        let values = self.of.tape.eval(&mut self.registers, args);
        for (member, last) in self.last.chunks_mut(2 * count).enumerate() {
            let (angles, rates) = last.split_at_mut(count);
            for (k, period) in self.of.periods.iter().enumerate() {
                let (angle, rate) = (values[k].member(member), values[count + k].member(member));
                if self.t.is_nan() {
                    angles[k] = angle;
                } else {
                    let predicted = angles[k] + h * (rates[k] + rate) / 2.0;
                    let found = angle + period * ((predicted - angle) / period).round();
                    // a rate between those at both ends predicts within the first, and misses by the second
                    let is_known = (h * (rate - rates[k])).abs() < *period
                        && (predicted - found).abs() <= NEAR * period;
                    angles[k] = if is_known { found } else { f64::NAN };
                }
                rates[k] = rate;
            }
        }
        self.t = t;
    }

    /// The angles of a member.
    pub(crate) fn angles(&self, member: usize) -> &[f64] {
        let count = self.count();
        &self.last[2 * count * member..][..count]
    }

    /// Forgets the state.
    pub(crate) fn reset(&mut self) {
        self.t = f64::NAN;
    }
}

impl<R: Real> Checkpoint for Turns<R> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.t.save(member, out);
        self.last.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.t.restore(member, saved)?;
        self.last.restore(member, saved)
    }
}
