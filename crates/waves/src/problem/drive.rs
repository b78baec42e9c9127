//! Weights of terms that depend on time: H(t) = Σ f_k(t) H_k.

use liouville_base::tape::{Registers, Tape};
use std::ops::Range;
use std::sync::Arc;

/// A spline through samples, which is the weight of some terms: a piece is found by its start, not by going over all.
#[derive(Clone, Debug)]
pub struct Spline {
    /// The terms.
    pub terms: Range<usize>,
    /// Where pieces begin, in order.
    pub starts: Vec<f64>,
    /// Where u = t − base is zero in each.
    pub bases: Vec<f64>,
    /// Coefficients of 1 in all pieces, then those of u, u² and u³.
    pub powers: Vec<f64>,
}

impl Spline {
    fn is_fitting(&self, terms: usize) -> bool {
        let pieces = self.starts.len();
        self.terms.end <= terms
            && pieces > 0
            && self.bases.len() == pieces
            && self.powers.len() == 4 * pieces
    }

    fn at(&self, t: f64) -> f64 {
        let pieces = self.starts.len();
        let piece = self.starts[1..].partition_point(|start| *start <= t);
        let u = t - self.bases[piece];
        (0..4).rev().fold(0.0, |sum, power| {
            self.powers[power * pieces + piece] + u * sum
        })
    }
}

/// The functions f_k, one for each term.
#[derive(Clone, Debug)]
pub struct Drive {
    tape: Arc<Tape>,
    params: Vec<f64>,
    splines: Arc<[Spline]>,
}

impl Drive {
    /// A tape of (t, parameters) that gives the weight of each of `terms` terms; none if it does not.
    pub fn new(tape: Arc<Tape>, params: &[f64], terms: usize) -> Option<Self> {
        let params = params.to_vec();
        let fits = tape.inputs() == [1, params.len()] && tape.outputs() == terms;
        let splines = Arc::from([]);
        fits.then_some(Self {
            tape,
            params,
            splines,
        })
    }

    /// The same with splines added to the weights of some terms; none if there are no such terms, or pieces without
    /// coefficients.
    pub fn with_splines(self, splines: Vec<Spline>) -> Option<Self> {
        let terms = self.terms();
        let fits = splines.iter().all(|spline| spline.is_fitting(terms));
        let splines = Arc::from(splines);
        fits.then_some(Self { splines, ..self })
    }

    /// Number of terms.
    pub(super) fn terms(&self) -> usize {
        self.tape.outputs()
    }

    /// Memory of evaluations.
    pub(crate) fn bind(&self) -> Registers<f64> {
        self.tape.bind(&self.params)
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
        for spline in self.splines.iter() {
            let value = factor * spline.at(t);
            for weight in &mut weights[spline.terms.clone()] {
                *weight += value;
            }
        }
    }
}
