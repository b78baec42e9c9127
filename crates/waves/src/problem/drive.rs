//! Weights of terms that depend on time: H(t) = Σ f_k(t) H_k.

use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// The functions f_k, one for each term.
#[derive(Clone, Debug)]
pub struct Drive {
    tape: Arc<Tape>,
    params: Vec<f64>,
}

impl Drive {
    /// A tape of (t, parameters) that gives the weight of each of `terms` terms; none if it does not.
    pub fn new(tape: Arc<Tape>, params: &[f64], terms: usize) -> Option<Self> {
        let params = params.to_vec();
        let fits = tape.inputs() == [1, params.len()] && tape.outputs() == terms;
        fits.then_some(Self { tape, params })
    }

    /// Number of terms.
    pub(super) fn terms(&self) -> usize {
        self.tape.outputs()
    }

    /// Memory of evaluations.
    pub(crate) fn bind(&self) -> Registers<f64> {
        self.tape.bind(&self.params)
    }

    /// The weights at times, a row for each.
    pub(crate) fn at(&self, times: &[f64]) -> Vec<f64> {
        self.tape.map(&self.params, &[times], times.len())
    }

    /// Adds `factor` times the weights at `t`.
    pub(crate) fn add(
        &self,
        registers: &mut Registers<f64>,
        factor: f64,
        t: f64,
        weights: &mut [f64],
    ) {
        let values = self.tape.eval(registers, [&[t]]);
        for (weight, value) in weights.iter_mut().zip(values) {
            *weight += factor * value;
        }
    }
}
