//! Products one after another, each with what the one before has left.

use crate::parallel::Crew;
use crate::patience::Patience;
use crate::problem::quantum::{Block, Hamiltonian, Update, Weighted};
use crate::trouble::Trouble;
use crate::vector::{Machine, Stored};
use std::sync::Arc;

/// One product: a ← keep·a + factor·H b + diagonal·b, or the same into b from a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Whether b is what is updated.
    pub into_second: bool,
    /// What becomes of the product.
    pub update: Update,
    /// How much of what is updated is then added to the sum beside it; without sums nothing.
    pub weight: f64,
}

/// Sums of what a and b have been.
pub type Sums<'a, S> = Option<(&'a mut [S], &'a mut [S])>;

/// What makes products one after another.
#[derive(Clone)]
pub struct Sweeper<S> {
    hamiltonian: Arc<Hamiltonian>,
    /// Weights of the terms of H, which change where H depends on time.
    pub weights: Option<Vec<f64>>,
    machine: Machine,
    #[expect(dead_code)] // until rows are shared
    crew: Option<Crew>,
    patience: Patience,
    product: Vec<S>,
    scratch: [Vec<f64>; 2],
    products: usize,
}

impl<S: Stored> Sweeper<S> {
    /// Products of this Hamiltonian.
    pub fn new(hamiltonian: Arc<Hamiltonian>) -> Self {
        Self {
            hamiltonian,
            weights: None,
            machine: Machine::default(),
            crew: None,
            patience: Patience::default(),
            product: Vec::new(),
            scratch: [Vec::new(), Vec::new()],
            products: 0,
        }
    }

    /// The same with so many threads; no bit of the result depends on them.
    #[must_use]
    pub fn with_threads(self, threads: usize) -> Self {
        let crew = Crew::new(threads);
        Self { crew, ..self }
    }

    /// The same, stopping where `patience` is lost.
    #[must_use]
    pub fn with_patience(self, patience: Patience) -> Self {
        Self { patience, ..self }
    }

    /// What is multiplied with.
    pub fn hamiltonian(&self) -> &Arc<Hamiltonian> {
        &self.hamiltonian
    }

    /// How many real products were made.
    pub fn products(&self) -> usize {
        self.products
    }

    /// Makes moves one after another.
    ///
    /// # Errors
    /// A product failed, or patience was lost; a and b may be anything then.
    pub fn run(
        &mut self,
        moves: &[Move],
        a: &mut [S],
        b: &mut [S],
        mut sums: Sums<'_, S>,
    ) -> Result<(), Trouble> {
        for step in moves {
            if self.patience.is_lost() {
                return Err(Trouble::Interrupted);
            }
            let sum = sums
                .as_mut()
                .map(|(a, b)| if step.into_second { &mut **b } else { &mut **a });
            if step.into_second {
                self.one(step, a, b, sum)?;
            } else {
                self.one(step, b, a, sum)?;
            }
        }
        Ok(())
    }

    fn one(
        &mut self,
        step: &Move,
        x: &[S],
        out: &mut [S],
        sum: Option<&mut [S]>,
    ) -> Result<(), Trouble> {
        self.products += S::MEMBERS;
        let weighted = Weighted {
            terms: self.hamiltonian.terms(),
            weights: self.weights.as_deref(),
        };
        if self.hamiltonian.reach().is_some() {
            let (row, place) = (0, 0);
            let block = Block { row, out, place, x };
            weighted.act(self.machine, step.update, block);
        } else {
            self.product.resize(x.len(), S::splat(0.0));
            weighted.multiply(self.machine, x, &mut self.product, &mut self.scratch)?;
            let Update {
                keep,
                factor,
                diagonal,
            } = step.update;
            for ((out, x), product) in out.iter_mut().zip(x).zip(&self.product) {
                for m in 0..S::MEMBERS {
                    let change = factor * product.member(m) + diagonal * x.member(m);
                    out.set_member(m, keep * out.member(m) + change);
                }
            }
        }
        if let Some(sum) = sum {
            for (sum, out) in sum.iter_mut().zip(out) {
                for m in 0..S::MEMBERS {
                    sum.set_member(m, sum.member(m) + step.weight * out.member(m));
                }
            }
        }
        Ok(())
    }
}
