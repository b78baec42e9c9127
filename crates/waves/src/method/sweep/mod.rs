//! Products one after another, each with what the one before has left.
//!
//! By rows, several of them go over the matrix in one sweep, and threads share the rows; no bit of the result
//! depends on how many.

mod blocking;
mod shared;
mod wavefront;

use crate::problem::{Hamiltonian, HamiltonianAt, Operator, Scratch, Update};
use blocking::Blocking;
use liouville_base::cancel::CancelToken;
use liouville_base::error::StepError;
use liouville_base::parallel::Workers;
use liouville_base::simd::{InstructionSet, Stored};
use shared::All;
use std::marker::PhantomData;
use std::sync::Arc;
use wavefront::{Edges, Work, add_scaled};

/// Threads share no fewer bytes.
const LEAST: usize = 1 << 21;

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
    pub present: Option<HamiltonianAt>,
    machine: InstructionSet,
    workers: Option<Workers>,
    cancel: CancelToken,
    scratch: Scratch,
    products: usize,
    by_rows: Option<ByRows>,
    stored: PhantomData<S>,
}

/// What is known of a Hamiltonian all of whose terms are given by rows.
#[derive(Clone, Copy)]
struct ByRows {
    reach: usize,
    bytes: usize,
    blocking: Blocking,
    is_worth_sharing: bool,
}

impl ByRows {
    fn new<S>(hamiltonian: &Hamiltonian, threads: usize) -> Option<Self> {
        let (n, reach) = (hamiltonian.size(), hamiltonian.reach()?);
        let of_terms = hamiltonian.terms().iter().map(Operator::bytes_a_row);
        let bytes = 2 * size_of::<S>() + of_terms.sum::<usize>();
        Some(Self {
            reach,
            bytes,
            blocking: Blocking::new(n, reach, bytes, threads),
            is_worth_sharing: n * bytes >= LEAST,
        })
    }
}

impl<S: Stored> Sweeper<S> {
    /// Products of this Hamiltonian.
    pub fn new(hamiltonian: Arc<Hamiltonian>) -> Self {
        Self {
            present: hamiltonian.present(),
            by_rows: ByRows::new::<S>(&hamiltonian, 1),
            hamiltonian,
            machine: InstructionSet::default(),
            workers: None,
            cancel: CancelToken::default(),
            scratch: Scratch::default(),
            products: 0,
            stored: PhantomData,
        }
    }

    /// The same with so many threads.
    #[must_use]
    pub fn with_threads(self, threads: usize) -> Self {
        let n = self.hamiltonian.size();
        if self
            .by_rows
            .is_none_or(|by_rows| by_rows.blocking.rows == n)
        {
            return self; // there is nothing to share
        }
        let workers = Workers::new(threads);
        let threads = workers.as_ref().map_or(1, Workers::threads);
        Self {
            by_rows: ByRows::new::<S>(&self.hamiltonian, threads),
            workers,
            ..self
        }
    }

    /// The same with so many rows in a block and moves in a sweep, which else are chosen for the machine, and
    /// with rows shared however few they are.
    #[must_use]
    pub fn with_tiles(self, rows: usize, moves: usize) -> Self {
        let blocking = Blocking { rows, moves };
        let by_rows = self.by_rows.map(|by_rows| ByRows {
            blocking,
            is_worth_sharing: true,
            ..by_rows
        });
        Self { by_rows, ..self }
    }

    /// The same, stopping where `cancel` is lost.
    #[must_use]
    pub fn with_cancel(self, cancel: CancelToken) -> Self {
        Self { cancel, ..self }
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
    /// A product failed, or cancel was lost; a and b may be anything then.
    pub fn run(
        &mut self,
        moves: &[Move],
        a: &mut [S],
        b: &mut [S],
        mut sums: Sums<'_, S>,
    ) -> Result<(), StepError> {
        if let Some(by_rows) = self.by_rows {
            return self.run_by_rows(by_rows, moves, &mut All { a, b, sums });
        }
        for step in moves {
            if self.cancel.is_cancelled() {
                return Err(StepError::Interrupted);
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

    fn run_by_rows(
        &mut self,
        by_rows: ByRows,
        moves: &[Move],
        all: &mut All<'_, S>,
    ) -> Result<(), StepError> {
        let ByRows {
            reach,
            bytes,
            blocking,
            is_worth_sharing,
        } = by_rows;
        let n = self.hamiltonian.size();
        let sweeps = moves.len().div_ceil(blocking.moves).max(1);
        for moves in moves.chunks(moves.len().div_ceil(sweeps).max(1)) {
            let work = Work {
                hamiltonian: self.hamiltonian.at(self.present.as_ref()),
                machine: self.machine,
                n,
                reach,
                bytes,
                blocking,
                moves,
            };
            let cancel = &mut self.cancel;
            let workers = self.workers.as_ref().filter(|_| is_worth_sharing);
            let is_made = if let Some(workers) = workers {
                work.share(workers, all, cancel)
            } else {
                let mut part = all.part();
                work.sweep(Edges::all(n), &mut part, Some(cancel))
            };
            if !is_made {
                return Err(StepError::Interrupted);
            }
            self.products += S::MEMBERS * moves.len();
        }
        Ok(())
    }

    fn one(
        &mut self,
        step: &Move,
        x: &[S],
        out: &mut [S],
        sum: Option<&mut [S]>,
    ) -> Result<(), StepError> {
        self.products += S::MEMBERS;
        let weighted = self.hamiltonian.at(self.present.as_ref());
        weighted.update(self.machine, step.update, x, out, &mut self.scratch)?;
        if let Some(sum) = sum {
            add_scaled(self.machine, step.weight, out, sum);
        }
        Ok(())
    }
}
