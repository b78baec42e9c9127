//! Products one after another, each with what the one before has left.

use crate::parallel::Crew;
use crate::patience::Patience;
use crate::problem::quantum::{Hamiltonian, Present, Scratch, Update};
use crate::trouble::Trouble;
use crate::vector::{Machine, Stored};
use std::marker::PhantomData;
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
    /// What of H is in force, where H depends on time.
    pub present: Option<Present>,
    machine: Machine,
    #[expect(dead_code)] // until rows are shared
    crew: Option<Crew>,
    patience: Patience,
    scratch: Scratch,
    products: usize,
    stored: PhantomData<S>,
}

impl<S: Stored> Sweeper<S> {
    /// Products of this Hamiltonian.
    pub fn new(hamiltonian: Arc<Hamiltonian>) -> Self {
        Self {
            present: hamiltonian.present(),
            hamiltonian,
            machine: Machine::default(),
            crew: None,
            patience: Patience::default(),
            scratch: Scratch::default(),
            products: 0,
            stored: PhantomData,
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
        let weighted = self.hamiltonian.at(self.present.as_ref());
        weighted.update(self.machine, step.update, x, out, &mut self.scratch)?;
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
