//! Commutator-free Magnus methods for H(t): exponentials of sums of H at nodes, one after another.
//!
//!     ψ ← Π_k e^{−ih Ĥ_k} ψ,    Ĥ_k = Σ_j a_kj H(t + c_j h)
//!
//!     order 2    c = 1/2,            a = 1
//!     order 4    c = 1/2 ∓ √3/6,     a = (1/4 ± √3/6, 1/4 ∓ √3/6), the first exponential with the upper signs
//!
//! Each exponential is made by equal steps of a list of shears, which is for matrices that do not depend on time.
//! Its shift and the number of steps come from the bounds of the terms, weighted and added up. Source: alvermann2011.

use super::{Shears, Sweeper, Wave};
use crate::problem::HamiltonianAt;
use liouville_base::composition::{Composed, Flow};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::simd::Stored;

/// The nodes c, and the weights a of each exponential, first to last.
#[derive(Clone, Debug, PartialEq)]
pub struct Nodes {
    /// c_j
    pub nodes: Vec<f64>,
    /// a_kj
    pub rows: Vec<Vec<f64>>,
}

impl Nodes {
    /// The exponential midpoint rule.
    pub fn midpoint() -> Self {
        Self {
            nodes: vec![0.5],
            rows: vec![vec![1.0]],
        }
    }

    /// Two exponentials at two Gauss nodes, of order 4.
    pub fn gauss() -> Self {
        let apart = 3.0_f64.sqrt() / 6.0;
        let (more, less) = (0.25 + apart, 0.25 - apart);
        Self {
            nodes: vec![0.5 - apart, 0.5 + apart],
            rows: vec![vec![more, less], vec![less, more]],
        }
    }
}

/// A list of shears, and how far it goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Exponential {
    /// The shears: part 0 moves q, part 1 moves p.
    pub program: Vec<Flow>,
    /// The most that half the width of the spectrum times a step of it may be.
    pub theta: f64,
    /// How far the norm may be off, relatively, before a state is refused.
    pub tolerance: f64,
}

/// A Magnus method at work.
#[derive(Clone)]
pub struct Magnus<S: Stored> {
    shears: Composed<Shears<S>>,
    nodes: Nodes,
    theta: f64,
    /// What made the state unusable, if anything did.
    lost: Option<StepError>,
    /// Least and largest eigenvalue of each term.
    bounds: Vec<(f64, f64)>,
    /// Weights and times of the nodes of an exponential.
    taken: Vec<(f64, f64)>,
}

impl<S: Stored> Magnus<S> {
    /// A method for the Hamiltonian of `sweeper`, given bounds of the eigenvalues of its terms.
    ///
    /// # Panics
    /// When there are not as many bounds as terms, or a row has not as many weights as there are nodes.
    pub fn new(
        sweeper: Sweeper<S>,
        nodes: Nodes,
        exponential: Exponential,
        bounds: Vec<(f64, f64)>,
    ) -> Self {
        let terms = sweeper.hamiltonian().terms().len();
        assert_eq!(bounds.len(), terms, "number of bounds");
        let mut rows = nodes.rows.iter();
        assert!(rows.all(|row| row.len() == nodes.nodes.len()), "weights");
        let mut sweeper = sweeper;
        if sweeper.present.is_none() {
            sweeper.present = Some(HamiltonianAt::new(sweeper.hamiltonian()));
        }
        let shears = Shears::new(sweeper, 0.0, exponential.tolerance);
        Self {
            shears: Composed::following(shears, exponential.program),
            taken: Vec::with_capacity(nodes.nodes.len()),
            theta: exponential.theta,
            lost: None,
            nodes,
            bounds,
        }
    }

    /// Takes the sum of a row's nodes; its bounds.
    fn take(&mut self, row: usize, t: f64, h: f64) -> (f64, f64) {
        let nodes = self.nodes.nodes.iter();
        let weighted = self.nodes.rows[row].iter().zip(nodes);
        self.taken.clear();
        self.taken
            .extend(weighted.map(|(a, c)| (*a, t + c * h)));
        let sweeper = self.shears.parts_mut().sweeper_mut();
        let hamiltonian = sweeper.hamiltonian().clone();
        let (mut low, mut high) = (0.0, 0.0);
        let mut add = |weight: f64, (least, largest): (f64, f64)| {
            let (a, b) = (weight * least, weight * largest);
            low += a.min(b);
            high += a.max(b);
        };
        if let Some(present) = &mut sweeper.present {
            present.set(&hamiltonian, &self.taken);
            for (weight, bounds) in present.weights().iter().zip(&self.bounds) {
                add(*weight, *bounds);
            }
            let potential = present.potential();
            let least = potential.iter().copied().reduce(f64::min);
            let largest = potential.iter().copied().reduce(f64::max);
            add(1.0, (least.unwrap_or(0.0), largest.unwrap_or(0.0)));
        }
        (low, high)
    }

    fn exponential(
        &mut self,
        row: usize,
        t: f64,
        h: f64,
        state: &mut Wave<S>,
    ) -> Result<(), StepError> {
        let (low, high) = self.take(row, t, h);
        let (theta, most) = ((high - low) / 2.0 * h.abs(), self.theta);
        let steps = theta / most;
        if !steps.is_finite() {
            return Err(StepError::Spectrum { theta, most, t });
        }
        let steps = steps.ceil().max(1.0);
        let shift = low.midpoint(high);
        self.shears.parts_mut().set_shift(shift);
        // half of the phase before the shears and half of it after them: back in time this is undone
        state.turn(shift * h / 2.0);
        state.take_phase();
        let mut left = steps;
        while left > 0.0 {
            self.shears.step(t, h / steps, state)?;
            left -= 1.0;
        }
        state.turn(-shift * h / 2.0);
        self.shears.synchronize(state)
    }
}

impl<S: Stored> Stepper for Magnus<S> {
    type State = Wave<S>;

    /// After a failed step the state is not to be used: [`Stepper::synchronize`] refuses it from then on.
    fn step(&mut self, t: f64, h: f64, state: &mut Wave<S>) -> Result<(), StepError> {
        for row in 0..self.nodes.rows.len() {
            let made = self.exponential(row, t, h, state);
            made.inspect_err(|error| self.lost = Some(error.clone()))?;
        }
        Ok(())
    }

    fn synchronize(&mut self, _: &mut Wave<S>) -> Result<(), StepError> {
        self.lost.clone().map_or(Ok(()), Err)
    }

    fn stats(&self) -> Stats {
        self.shears.stats()
    }
}

liouville_base::checkpoint!([S: Stored] Magnus<S> { shears });
