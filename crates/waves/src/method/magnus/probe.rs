//! The part of H(t) within a step that a polynomial in time leaves out, estimated by products with H alone.
//!
//! H(t) acts on the state and a random vector of the same length, so that a change is seen where the state is, and where it
//! may go within the step.

use crate::method::spectral_range::random;
use crate::method::{Wave, squares};
use crate::problem::{Hamiltonian, HamiltonianAt, ProductScratch};
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;
use liouville_base::simd::InstructionSet;

const SEED: u64 = 5;

/// Products of sums of H(t) with one vector.
#[derive(Clone)]
pub(super) struct Probe {
    noise: Vec<f64>,
    x: Vec<f64>,
    out: Vec<f64>,
    sums: Vec<f64>,
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
            sums: Vec::new(),
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

    /// The lengths of products with sums Σ a H(t) over these times, of several rows of a.
    pub(super) fn lengths(
        &mut self,
        (hamiltonian, current): (&Hamiltonian, &mut HamiltonianAt),
        times: impl Iterator<Item = f64>,
        rows: &[Vec<f64>],
    ) -> Result<Vec<f64>, StepError> {
        let n = self.x.len();
        self.sums.clear();
        self.sums.resize(rows.len() * n, 0.0);
        let parts = if hamiltonian.is_doubled() { 2 } else { 1 };
        let machine = InstructionSet::default();
        for (place, t) in times.enumerate() {
            current.set(hamiltonian, &[(1.0, t)])?;
            let now = hamiltonian.at(Some(current));
            self.products += parts * now.products();
            now.multiply(machine, &self.x, &mut self.out, &mut self.scratch)?;
            for (row, sum) in rows.iter().zip(self.sums.chunks_mut(n)) {
                add_scaled(sum, row[place], &self.out);
            }
        }
        let squares = self.sums.chunks(n);
        let squares = squares.map(|sum| sum.iter().map(|x| x * x).sum::<f64>());
        Ok(squares.map(f64::sqrt).collect())
    }

    /// Real products made so far.
    pub(super) fn products(&self) -> usize {
        self.products
    }
}
