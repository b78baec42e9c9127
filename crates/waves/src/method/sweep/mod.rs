//! Products one after another, each with the result of the one before.
//!
//! By rows, several of them go over the matrix in one sweep, and threads share the rows; results are bitwise independent
//! of the number of threads.

mod blocking;
mod outputs;
mod shared;
mod sink;
mod wavefront;

pub use outputs::{Outputs, TermBlock};
pub use sink::{Move, Sink};

use super::derivative::Recorder;
use crate::problem::{Hamiltonian, HamiltonianAt, Operator, ProductScratch};
use blocking::Blocking;
use liouville_base::cancel::CancelToken;
use liouville_base::error::StepError;
use liouville_base::parallel::Workers;
use liouville_base::simd::{InstructionSet, Stored};
use shared::SweepVectors;
use std::marker::PhantomData;
use std::sync::Arc;
use wavefront::{Edges, SweepPlan};

/// Fewest bytes that threads share.
const LEAST: usize = 1 << 21;

/// Products with a Hamiltonian, one after another.
#[derive(Clone)]
pub struct Sweeper<S> {
    hamiltonian: Arc<Hamiltonian>,
    /// Weights and potential of H, where it depends on time.
    pub current: Option<HamiltonianAt>,
    machine: InstructionSet,
    workers: Option<Workers>,
    cancel: CancelToken,
    scratch: ProductScratch,
    products: usize,
    by_rows: Option<ByRows>,
    recorder: Option<Recorder>,
    stored: PhantomData<S>,
}

/// Sizes of a Hamiltonian all of whose terms are by rows.
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
            current: hamiltonian.current(),
            by_rows: ByRows::new::<S>(&hamiltonian, 1),
            hamiltonian,
            machine: InstructionSet::default(),
            workers: None,
            cancel: CancelToken::of_thread(),
            scratch: ProductScratch::default(),
            products: 0,
            recorder: None,
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
            return self;
        }
        let workers = Workers::new(threads);
        let threads = workers.as_ref().map_or(1, Workers::threads);
        Self {
            by_rows: ByRows::new::<S>(&self.hamiltonian, threads),
            workers,
            ..self
        }
    }

    /// The same with so many rows in a block and moves in a sweep, not those chosen for the machine, and with rows shared
    /// even where they are few.
    #[must_use]
    pub fn with_blocking(self, rows: usize, moves: usize) -> Self {
        let blocking = Blocking { rows, moves };
        let by_rows = self.by_rows.map(|by_rows| ByRows {
            blocking,
            is_worth_sharing: true,
            ..by_rows
        });
        Self { by_rows, ..self }
    }

    /// Products with another Hamiltonian of the same size, by the same threads.
    #[must_use]
    pub(in crate::method) fn of(self, hamiltonian: Arc<Hamiltonian>) -> Self {
        let threads = self.workers.as_ref().map_or(1, Workers::threads);
        Self {
            current: hamiltonian.current(),
            by_rows: ByRows::new::<S>(&hamiltonian, threads),
            hamiltonian,
            ..self
        }
    }

    /// The same, stopping where `cancel` is set, not that of the thread.
    #[must_use]
    pub fn with_cancel(self, cancel: CancelToken) -> Self {
        Self { cancel, ..self }
    }

    /// The same, with a place for what a derivative needs to know of a run.
    #[must_use]
    pub fn with_recorder(self, recorder: Option<Recorder>) -> Self {
        Self { recorder, ..self }
    }

    /// The place for what a derivative needs to know of a run, if it is to be differentiated.
    pub(in crate::method) fn recorder(&self) -> Option<&Recorder> {
        self.recorder.as_ref()
    }

    /// The Hamiltonian.
    pub fn hamiltonian(&self) -> &Arc<Hamiltonian> {
        &self.hamiltonian
    }

    /// Real products made so far, of each member; one with the doubled matrix of a complex H counts as two.
    pub fn products(&self) -> usize {
        self.products
    }

    /// Makes moves one after another.
    ///
    /// # Errors
    /// A product failed, or the run was cancelled; a and b are undefined then.
    pub fn run(
        &mut self,
        moves: &[Move],
        a: &mut [S],
        b: &mut [S],
        mut sink: Sink<'_, S>,
    ) -> Result<(), StepError> {
        if let Some(by_rows) = self.by_rows {
            return self.run_by_rows(by_rows, moves, &mut SweepVectors { a, b, sink });
        }
        for step in moves {
            if self.cancel.is_cancelled() {
                return Err(StepError::Interrupted);
            }
            if step.into_second {
                self.one(step, a, b)?;
                sink.take(self.machine, step, 0, b);
            } else {
                self.one(step, b, a)?;
                sink.take(self.machine, step, 0, a);
            }
        }
        Ok(())
    }

    /// Products of each member that one counts as.
    fn each(&self) -> usize {
        if self.hamiltonian.is_doubled() { 2 } else { 1 }
    }

    /// Whether threads share the rows.
    fn is_worth_sharing(&self) -> bool {
        self.by_rows.is_some_and(|by_rows| by_rows.is_worth_sharing)
    }

    fn run_by_rows(
        &mut self,
        by_rows: ByRows,
        moves: &[Move],
        all: &mut SweepVectors<'_, S>,
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
            let plan = SweepPlan {
                hamiltonian: self.hamiltonian.at(self.current.as_ref()),
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
                plan.share(workers, all, cancel)
            } else {
                let mut part = all.part();
                plan.sweep(Edges::all(n), &mut part, Some(cancel))
            };
            if !is_made {
                return Err(StepError::Interrupted);
            }
            self.products += self.each() * moves.len();
        }
        Ok(())
    }

    fn one(&mut self, step: &Move, x: &[S], out: &mut [S]) -> Result<(), StepError> {
        let weighted = self.hamiltonian.at(self.current.as_ref());
        self.products += self.each() * weighted.products();
        if step.update.keep == 0.0 {
            out.fill(S::splat(0.0)); // whatever is there, as not all terms set it
        }
        weighted.update(self.machine, step.update, x, out, &mut self.scratch)
    }
}
