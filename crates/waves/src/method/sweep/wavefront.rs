//! Several moves in one sweep over the rows.
//!
//! A move follows the one before at a distance: it computes block b just after that one computed block b + lag, with
//! lag B ≥ reach for blocks of B rows. All its input is computed then, and the one before reads no more of its output. The
//! data of a block stay in the cache for all moves, and each number is the result of the same operations as in moves one
//! after another.

use super::blocking::Blocking;
use super::{Move, Sink};
use crate::problem::{RowBlock, WeightedTerms};
use liouville_base::cancel::CancelToken;
use liouville_base::simd::{InstructionSet, Stored};
use std::ops::Range;

/// Blocks between two polls for cancellation.
const BLOCKS: usize = 8;

/// The data of a list of moves.
#[derive(Clone, Copy)]
pub(super) struct SweepPlan<'a> {
    pub(super) hamiltonian: WeightedTerms<'a>,
    pub(super) machine: InstructionSet,
    /// Number of rows.
    pub(super) n: usize,
    pub(super) reach: usize,
    /// Bytes of a row, in vectors and matrix.
    pub(super) bytes: usize,
    pub(super) blocking: Blocking,
    pub(super) moves: &'a [Move],
}

/// Some rows of a and b, and the use of them.
pub(super) struct SweepRows<'a, S> {
    pub(super) first: usize,
    pub(super) a: &'a mut [S],
    pub(super) b: &'a mut [S],
    pub(super) sink: Sink<'a, S>,
}

/// The rows that moves make, from one to another, which may be more or fewer with each move.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edges {
    pub(super) low: Edge,
    pub(super) high: Edge,
}

/// Where rows begin or end.
#[derive(Clone, Copy, Debug)]
pub(super) enum Edge {
    /// At the first or behind the last of all, for all moves.
    Fixed(usize),
    /// Before this row, by so much at the first move and as much more at each after it.
    Before(usize, usize),
    /// The same, behind it.
    Behind(usize, usize),
}

impl Edge {
    fn of_move(self, k: usize, n: usize) -> usize {
        match self {
            Self::Fixed(row) => row,
            Self::Before(row, by) => row.saturating_sub((k + 1) * by),
            Self::Behind(row, by) => n.min(row + (k + 1) * by),
        }
    }
}

impl Edges {
    /// All n rows.
    pub(super) fn all(n: usize) -> Self {
        Self {
            low: Edge::Fixed(0),
            high: Edge::Fixed(n),
        }
    }

    fn of_move(self, k: usize, n: usize) -> Range<usize> {
        self.low.of_move(k, n)..self.high.of_move(k, n)
    }
}

impl SweepPlan<'_> {
    /// Makes all moves in one sweep; false where it was cancelled.
    pub(super) fn sweep<S: Stored>(
        &self,
        edges: Edges,
        part: &mut SweepRows<'_, S>,
        cancel: Option<&mut CancelToken>,
    ) -> bool {
        let (rows, lag) = (self.blocking.rows, self.blocking.lag(self.reach));
        let last = self.moves.len() - 1;
        let [one, other] = [edges.of_move(0, self.n), edges.of_move(last, self.n)];
        let (first, end) = (one.start.min(other.start), one.end.max(other.end));
        let blocks = end.saturating_sub(first).div_ceil(rows);
        let mut cancel = cancel;
        for stage in 0..blocks + last * lag {
            if let Some(cancel) = &mut cancel
                && stage % BLOCKS == 0
                && cancel.is_cancelled()
            {
                return false;
            }
            for (k, step) in self.moves.iter().enumerate() {
                let Some(block) = stage.checked_sub(k * lag) else {
                    break;
                };
                let start = first + block * rows;
                let of_move = edges.of_move(k, self.n);
                let now = start.max(of_move.start)..(start + rows).min(of_move.end);
                if !now.is_empty() {
                    self.one(step, now, part);
                }
            }
        }
        true
    }

    /// Makes some rows of a move.
    fn one<S: Stored>(&self, step: &Move, rows: Range<usize>, part: &mut SweepRows<'_, S>) {
        let (first, row) = (part.first, rows.start);
        let place = row.saturating_sub(self.reach).max(first);
        let end = (rows.end + self.reach).min(first + part.a.len());
        let (x, out) = if step.into_second {
            (&*part.a, &mut *part.b)
        } else {
            (&*part.b, &mut *part.a)
        };
        let out = &mut out[row - first..rows.end - first];
        let x = &x[place - first..end - first];
        let block = RowBlock { row, out, place, x };
        self.make(step, block, &mut part.sink, row - first);
    }

    /// Makes rows, and gives them to their use, of which they are those from `at` on.
    pub(super) fn make<S: Stored>(
        &self,
        step: &Move,
        block: RowBlock<'_, S>,
        sink: &mut Sink<'_, S>,
        at: usize,
    ) {
        let RowBlock { row, out, place, x } = block;
        let made = &mut *out;
        let block = RowBlock {
            row,
            out: made,
            place,
            x,
        };
        self.hamiltonian.act(self.machine, step.update, block);
        sink.take(self.machine, step, at, out);
    }
}
