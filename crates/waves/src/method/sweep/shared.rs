//! Rows shared by threads.
//!
//! Each thread sweeps over rows of its own with several moves, fewer rows with each move, so that it reads no rows of its
//! neighbours. The rows left out lie around the borders, more with each move, and are computed in the same way next. Where
//! these are more than all rows, threads share the rows of one move at a time.

use super::blocking::LONG;
use super::sink::tile_rows;
use super::wavefront::{Edge, Edges, SweepPlan, SweepRows};
use super::{Move, Sink};
use crate::problem::RowBlock;
use liouville_base::cancel::CancelToken;
use liouville_base::parallel::Workers;
use liouville_base::simd::Stored;

/// Most pieces at a time.
const MOST: usize = 64;
/// Pieces for each thread, as rows take unequal time.
const EACH: usize = 4;

/// All of a and b, and the use of them.
pub(super) struct SweepVectors<'a, S> {
    pub(super) a: &'a mut [S],
    pub(super) b: &'a mut [S],
    pub(super) sink: Sink<'a, S>,
}

impl<S: Stored> SweepVectors<'_, S> {
    /// All of it as one part.
    pub(super) fn part(&mut self) -> SweepRows<'_, S> {
        SweepRows {
            first: 0,
            a: self.a,
            b: self.b,
            sink: self.sink.reborrow(),
        }
    }

    /// Pieces of `size` rows, from `first` on: whole tiles.
    fn pieces(&mut self, first: usize, size: usize) -> [Option<SweepRows<'_, S>>; MOST] {
        let mut a = self.a[first..].chunks_mut(size);
        let mut b = self.b[first..].chunks_mut(size);
        let (_, mut later) = self.sink.reborrow().split_at(first);
        std::array::from_fn(|k| {
            let (a, b) = (a.next()?, b.next()?);
            let (sink, rest) = std::mem::replace(&mut later, Sink::Nothing).split_at(size);
            later = rest;
            let first = first + k * size;
            Some(SweepRows { first, a, b, sink })
        })
    }
}

/// Rows of one move.
struct MoveRows<'a, S> {
    row: usize,
    out: &'a mut [S],
    sink: Sink<'a, S>,
}

impl SweepPlan<'_> {
    /// Makes all moves by several threads; false where it was cancelled.
    pub(super) fn share<S: Stored>(
        &self,
        workers: &Workers,
        all: &mut SweepVectors<'_, S>,
        cancel: &mut CancelToken,
    ) -> bool {
        let count = self.moves.len();
        // pieces and their halves are whole tiles
        let size = self.n.div_ceil(workers.threads().min(MOST));
        let size = size.next_multiple_of(2 * tile_rows::<S>());
        if count > 1 && size >= 2 * (count + 1) * self.reach {
            self.share_moves(workers, size, all);
            return !cancel.is_cancelled();
        }
        let mut moves = self.moves.iter();
        moves.all(|step| self.share_rows(workers, step, all, cancel))
    }

    fn share_moves<S: Stored>(
        &self,
        workers: &Workers,
        size: usize,
        all: &mut SweepVectors<'_, S>,
    ) {
        let (n, reach) = (self.n, self.reach);
        workers.all(&mut all.pieces(0, size), |part| {
            let Some(part) = part else { return };
            let (first, end) = (part.first, part.first + size);
            let low = if first == 0 {
                Edge::Fixed(0)
            } else {
                Edge::Behind(first, reach)
            };
            let high = if end >= n {
                Edge::Fixed(n)
            } else {
                Edge::Before(end, reach)
            };
            self.sweep(Edges { low, high }, part, None);
        });
        let half = size / 2;
        workers.all(&mut all.pieces(half, size), |part| {
            let Some(part) = part else { return };
            let border = part.first - half + size;
            if border < n {
                let low = Edge::Before(border, reach);
                let high = Edge::Behind(border, reach);
                self.sweep(Edges { low, high }, part, None);
            }
        });
    }

    fn share_rows<S: Stored>(
        &self,
        workers: &Workers,
        step: &Move,
        all: &mut SweepVectors<'_, S>,
        cancel: &mut CancelToken,
    ) -> bool {
        let mut later = all.sink.reborrow();
        let (x, out) = if step.into_second {
            (&*all.a, &mut *all.b)
        } else {
            (&*all.b, &mut *all.a)
        };
        let pieces = (EACH * workers.threads()).min(MOST);
        let long = (LONG / self.bytes).clamp(1, self.n.div_ceil(pieces));
        let long = long.next_multiple_of(tile_rows::<S>());
        let mut row = 0;
        for out in out.chunks_mut(pieces * long) {
            if cancel.is_cancelled() {
                return false;
            }
            let end = row + out.len();
            let mut outs = out.chunks_mut(long);
            let mut pieces: [Option<MoveRows<'_, S>>; MOST] = std::array::from_fn(|k| {
                let out = outs.next()?;
                let (sink, rest) = std::mem::replace(&mut later, Sink::Nothing).split_at(long);
                later = rest;
                let row = row + k * long;
                Some(MoveRows { row, out, sink })
            });
            workers.all(&mut pieces, |piece| {
                let Some(MoveRows { row, out, sink }) = piece else {
                    return;
                };
                let (row, place) = (*row, 0);
                self.make(step, RowBlock { row, out, place, x }, sink, 0);
            });
            row = end;
        }
        true
    }
}
