//! Start values of the stages, from the polynomials of degree s − 1 through V_i and Z_i of the step before.
//!
//! Stages have an error of order h^s that ends of steps have not: polynomials through both would feel it.

use super::stages::{Stages, lagrange};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::linalg::{Matrix, combine, copy};

/// What the next step starts from.
#[derive(Clone, Debug)]
pub(super) struct Predictor {
    /// The step size of the stages held, and the ratio the weights were made for.
    h: Option<f64>,
    ratio: f64,
    weights: Matrix,
    v: Matrix,
    z: Matrix,
}

impl Predictor {
    pub(super) fn new(stages: &Stages) -> Self {
        let s = stages.count();
        Self {
            h: None,
            ratio: f64::NAN,
            weights: Matrix::zeros(s, s),
            v: stages.v.clone(),
            z: stages.z.clone(),
        }
    }

    /// Writes the extrapolated unknowns; says whether there was a step to extrapolate.
    pub(super) fn extrapolate(&mut self, stages: &mut Stages, h: f64) -> bool {
        let Some(last) = self.h else { return false };
        let ratio = h / last;
        if ratio.to_bits() != self.ratio.to_bits() {
            self.ratio = ratio;
            let targets = stages.c.iter().map(|c| 1.0 + ratio * c);
            lagrange(&stages.c, targets, &mut self.weights);
        }
        let as_is = |_, _, _: &mut [f64]| ();
        combine(stages.v.flat_mut(), &self.weights, &self.v, as_is);
        combine(stages.z.flat_mut(), &self.weights, &self.z, as_is);
        true
    }

    /// The next step starts cold.
    pub(super) fn forget(&mut self) {
        self.h = None;
    }

    /// Keeps the stages of a finished step.
    pub(super) fn keep(&mut self, stages: &Stages, h: f64) {
        copy(self.v.flat_mut(), stages.v.flat());
        copy(self.z.flat_mut(), stages.z.flat());
        self.h = Some(h);
    }
}

impl Checkpoint for Predictor {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.h.save(member, out);
        self.v.flat().save(member, out);
        self.z.flat().save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.h.restore(member, saved)?;
        self.v.flat_mut().restore(member, saved)?;
        self.z.flat_mut().restore(member, saved)
    }
}
