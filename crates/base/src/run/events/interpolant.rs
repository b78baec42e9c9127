//! The polynomial through the last ends of steps: a trajectory between steps of methods without a dense output.

use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::error::StepError;
use crate::observe::Observe;

/// Points that the polynomial goes through.
pub(super) const KNOTS: usize = 6;

/// The last points of a trajectory, as an observer reads them from its states.
pub(super) struct Interpolant<State> {
    reader: Box<dyn Observe<State>>,
    /// Times and rows, the last one last.
    knots: Vec<(f64, Vec<f64>)>,
    spare: Vec<(f64, Vec<f64>)>,
    /// 1 / Π (t_k − t_j) of each.
    weights: [f64; KNOTS],
    point: Vec<f64>,
}

impl<State> Interpolant<State> {
    /// An interpolant of the values that `reader` reads from states of the size of `state`.
    pub(super) fn new(reader: Box<dyn Observe<State>>, state: &State) -> Self {
        let row = || Vec::with_capacity(reader.width(state));
        Self {
            knots: Vec::with_capacity(KNOTS),
            spare: (0..KNOTS).map(|_| (0.0, row())).collect(),
            weights: [0.0; KNOTS],
            point: row(),
            reader,
        }
    }

    /// How many points there are.
    pub(super) fn len(&self) -> usize {
        self.knots.len()
    }

    /// Goes on to the next point; the oldest may be forgotten.
    ///
    /// # Errors
    /// The state cannot be read.
    pub(super) fn push(&mut self, t: f64, state: &State) -> Result<(), StepError> {
        let mut knot = match self.spare.pop() {
            Some(knot) => knot,
            None => self.knots.remove(0),
        };
        knot.0 = t;
        knot.1.clear();
        self.reader.observe(t, state, &mut knot.1)?;
        self.knots.push(knot);
        self.update_weights();
        Ok(())
    }

    fn update_weights(&mut self) {
        let Self { knots, weights, .. } = self;
        for (k, weight) in weights.iter_mut().take(knots.len()).enumerate() {
            *weight = 1.0 / product(knots, k, knots[k].0);
        }
    }

    /// Goes to the value of the polynomial at `t`.
    pub(super) fn interpolate(&mut self, t: f64) {
        let Self {
            knots,
            point,
            weights,
            ..
        } = self;
        point.clear();
        for (k, (_, row)) in knots.iter().enumerate() {
            let weight = weights[k] * product(knots, k, t);
            point.resize(row.len(), 0.0);
            for (point, x) in point.iter_mut().zip(row) {
                *point += weight * x;
            }
        }
    }

    /// Goes to a state.
    ///
    /// # Errors
    /// The state cannot be read.
    pub(super) fn read(&mut self, t: f64, state: &State) -> Result<(), StepError> {
        self.point.clear();
        self.reader.observe(t, state, &mut self.point)
    }

    /// Changes the numbers where it has gone to by these parts of them, in turn.
    pub(super) fn perturb(&mut self, parts: [f64; 2]) {
        for (value, part) in self.point.iter_mut().zip(parts.into_iter().cycle()) {
            *value += part * *value;
        }
    }

    /// Where it has gone to.
    pub(super) fn point(&self) -> &[f64] {
        &self.point
    }
}

/// Π (t − t_j) of all but one.
fn product(knots: &[(f64, Vec<f64>)], but: usize, t: f64) -> f64 {
    let others = knots.iter().enumerate().filter(|(k, _)| *k != but);
    others.map(|(_, (at, _))| t - at).product()
}

impl<State> Checkpoint for Interpolant<State> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.knots.len().save(member, out);
        for (t, row) in &self.knots {
            row.len().save(member, out);
            t.save(member, out);
            for x in row {
                x.save(member, out);
            }
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut count = 0_usize;
        count.restore(member, saved)?;
        self.spare.append(&mut self.knots);
        for _ in 0..count {
            let (mut t, mut row) = self.spare.pop().ok_or(CheckpointMismatch)?;
            let mut width = 0_usize;
            width.restore(member, saved)?;
            t.restore(member, saved)?;
            row.clear();
            row.extend_from_slice(crate::checkpoint::split_front(saved, width)?);
            self.knots.push((t, row));
        }
        self.update_weights();
        Ok(())
    }
}
