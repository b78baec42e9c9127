//! A Hamiltonian at a time, or averaged over several.

use super::potential::{AT_ONCE, PotentialRegisters};
use super::{Hamiltonian, WeightedTerms};
use liouville_base::cancel;
use liouville_base::error::StepError;
use liouville_base::tape::Registers;

/// The weights of the terms and the potential.
#[derive(Clone, Debug)]
pub struct HamiltonianAt {
    /// Weights of the terms.
    weights: Vec<f64>,
    /// The potential, empty if there is none.
    potential: Vec<f64>,
    /// Pairs (a, t) of the sum.
    nodes: Vec<(f64, f64)>,
    drive: Option<Registers<f64>>,
    points: Option<PotentialRegisters>,
}

impl HamiltonianAt {
    /// Memory for this Hamiltonian; before [`HamiltonianAt::set`] all weights are 1 and the potential is zero.
    pub fn new(hamiltonian: &Hamiltonian) -> Self {
        let potential = hamiltonian.potential.as_ref();
        Self {
            weights: vec![1.0; hamiltonian.terms.len()],
            potential: vec![0.0; potential.map_or(0, |_| hamiltonian.size())],
            nodes: Vec::new(),
            drive: hamiltonian.drive.as_ref().map(super::Drive::bind),
            points: potential.map(super::Potential::bind),
        }
    }

    /// The same with these weights of the terms; none where there are not as many.
    pub fn with_weights(self, weights: Vec<f64>) -> Option<Self> {
        (weights.len() == self.weights.len()).then_some(Self { weights, ..self })
    }

    /// Makes it Σ a H(t) over pairs (a, t), of the Hamiltonian it was made for.
    ///
    /// # Errors
    /// It was interrupted.
    pub fn set(
        &mut self,
        hamiltonian: &Hamiltonian,
        nodes: &[(f64, f64)],
    ) -> Result<(), StepError> {
        self.weights.fill(0.0);
        self.potential.fill(0.0);
        self.nodes.clear();
        self.nodes.extend_from_slice(nodes);
        for &(a, t) in nodes {
            match (&hamiltonian.drive, &mut self.drive) {
                (Some(drive), Some(registers)) => drive.add(registers, a, t, &mut self.weights),
                _ => self.weights.iter_mut().for_each(|weight| *weight += a),
            }
            if let (Some(potential), Some(registers)) = (&hamiltonian.potential, &mut self.points) {
                for (k, values) in self.potential.chunks_mut(AT_ONCE).enumerate() {
                    // a step that fits in one of them is not long
                    if k > 0 && cancel::is_cancelled() {
                        return Err(StepError::Interrupted);
                    }
                    potential.add(registers, (a, t), k * AT_ONCE, values);
                }
            }
        }
        Ok(())
    }

    /// Weights of the terms.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The potential, empty if there is none.
    pub fn potential(&self) -> &[f64] {
        &self.potential
    }
}

impl Hamiltonian {
    /// Memory for weights and potential at a time; none where nothing depends on time.
    pub fn current(&self) -> Option<HamiltonianAt> {
        self.is_driven().then(|| HamiltonianAt::new(self))
    }

    /// All terms with weight 1, and no potential.
    pub fn sum(&self) -> WeightedTerms<'_> {
        self.at(None)
    }

    /// The terms with weights and potential at a time; all weights are 1 without them.
    pub fn at<'a>(&'a self, current: Option<&'a HamiltonianAt>) -> WeightedTerms<'a> {
        WeightedTerms {
            terms: &self.terms,
            weights: current.map(|current| &current.weights[..]),
            potential: current.map_or(&[], |current| &current.potential),
            nodes: current.map_or(&[], |current| &current.nodes),
        }
    }
}
