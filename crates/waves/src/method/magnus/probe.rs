//! The part of H(t) within a step that a polynomial in time leaves out, estimated by products with H alone.
//!
//! H(t) acts on the state and a random vector of the same length, so that a change is seen where the state is, and where it
//! may go within the step.

use crate::method::spectral_range::random;
use crate::method::{Wave, squares};
use crate::problem::{Hamiltonian, HamiltonianAt, ProductScratch};
use liouville_base::error::StepError;
use liouville_base::simd::InstructionSet;

const SEED: u64 = 5;

/// Products of sums of H(t) with one vector.
#[derive(Clone)]
pub(super) struct Probe {
    noise: Vec<f64>,
    x: Vec<f64>,
    out: Vec<f64>,
    nodes: Vec<(f64, f64)>,
    scratch: ProductScratch,
    products: usize,
}

impl Probe {
    pub(super) fn new(hamiltonian: &Hamiltonian) -> Self {
        let n = hamiltonian.size();
        let mut noise = random(n, SEED);
        let length = noise.iter().map(|x| x * x).sum::<f64>().sqrt();
        for x in &mut noise {
            *x /= length;
        }
        Self {
            x: vec![0.0; n],
            out: vec![0.0; n],
            noise,
            nodes: Vec::new(),
            scratch: ProductScratch::default(),
            products: 0,
        }
    }

    /// Takes a state for the products that follow; a real H acts on the sum of its parts.
    pub(super) fn take(&mut self, state: &Wave<f64>) {
        let norm = squares(&state.q, &state.p).sqrt();
        let scale = if norm > 0.0 { 1.0 / norm } else { 0.0 };
        self.x.copy_from_slice(&self.noise);
        let (n, rows) = (state.q.len(), self.x.len());
        for (part, place) in [(&state.q, 0), (&state.p, rows - n)] {
            for (x, value) in self.x[place..].iter_mut().zip(part) {
                *x += scale * value;
            }
        }
    }

    /// The length of the product with Σ a H(t).
    pub(super) fn length(
        &mut self,
        (hamiltonian, current): (&Hamiltonian, &mut HamiltonianAt),
        nodes: impl Iterator<Item = (f64, f64)>,
    ) -> Result<f64, StepError> {
        self.nodes.clear();
        self.nodes.extend(nodes);
        current.set(hamiltonian, &self.nodes)?;
        let sum = hamiltonian.at(Some(current));
        let parts = if hamiltonian.is_doubled() { 2 } else { 1 };
        self.products += parts * sum.products();
        let machine = InstructionSet::default();
        sum.multiply(machine, &self.x, &mut self.out, &mut self.scratch)?;
        Ok(self.out.iter().map(|x| x * x).sum::<f64>().sqrt())
    }

    /// Real products made so far.
    pub(super) fn products(&self) -> usize {
        self.products
    }
}
