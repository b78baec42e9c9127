//! Rows shared by threads.
//!
//! Each thread sweeps over rows of its own with several moves, fewer rows with each move, so that it reads no rows of its
//! neighbours. The rows left out lie around the borders, more with each move, and are computed in the same way next. Where
//! these are more than all rows, threads share the rows of one move at a time.

use super::blocking::LONG;
use super::wavefront::{Edge, Edges, SweepPlan, SweepRows};
use super::{Move, Sums};
use crate::problem::RowBlock;
use liouville_base::cancel::CancelToken;
use liouville_base::parallel::Workers;
use liouville_base::simd::Stored;

/// Most pieces at a time.
const MOST: usize = 64;
/// Pieces for each thread, as rows take unequal time.
const EACH: usize = 4;

/// All of a and b, and of their sums.
pub(super) struct SweepVectors<'a, S> {
    pub(super) a: &'a mut [S],
    pub(super) b: &'a mut [S],
    pub(super) sums: Sums<'a, S>,
}

impl<S> SweepVectors<'_, S> {
    /// All of it as one part.
    pub(super) fn part(&mut self) -> SweepRows<'_, S> {
        let sums = self.sums.as_mut();
        SweepRows {
            first: 0,
            a: self.a,
            b: self.b,
            sums: sums.map(|(a, b)| (&mut **a, &mut **b)),
        }
    }

    /// Pieces of `size` rows, from `first` on.
    fn pieces(&mut self, first: usize, size: usize) -> [Option<SweepRows<'_, S>>; MOST] {
        let mut a = self.a[first..].chunks_mut(size);
        let mut b = self.b[first..].chunks_mut(size);
        let sums = self.sums.as_mut();
        let mut sums =
            sums.map(|(a, b)| (a[first..].chunks_mut(size), b[first..].chunks_mut(size)));
        std::array::from_fn(|k| {
            Some(SweepRows {
                first: first + k * size,
                a: a.next()?,
                b: b.next()?,
                sums: sums.as_mut().and_then(|(a, b)| a.next().zip(b.next())),
            })
        })
    }
}

/// Rows of one move.
struct MoveRows<'a, S> {
    row: usize,
    out: &'a mut [S],
    sum: Option<&'a mut [S]>,
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
        let size = self.n.div_ceil(workers.threads().min(MOST));
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
        let sums = all.sums.as_mut();
        let (x, out, mut sum) = if step.into_second {
            (&*all.a, &mut *all.b, sums.map(|(_, sum)| &mut **sum))
        } else {
            (&*all.b, &mut *all.a, sums.map(|(sum, _)| &mut **sum))
        };
        let pieces = (EACH * workers.threads()).min(MOST);
        let long = (LONG / self.bytes).clamp(1, self.n.div_ceil(pieces));
        let mut row = 0;
        for out in out.chunks_mut(pieces * long) {
            if cancel.is_cancelled() {
                return false;
            }
            let (rows, later) = match sum.take() {
                Some(sum) => {
                    let (now, later) = sum.split_at_mut(out.len());
                    (Some(now), Some(later))
                }
                None => (None, None),
            };
            sum = later;
            let end = row + out.len();
            let mut outs = out.chunks_mut(long);
            let mut sums = rows.map(|rows| rows.chunks_mut(long));
            let mut pieces: [Option<MoveRows<'_, S>>; MOST] = std::array::from_fn(|k| {
                Some(MoveRows {
                    row: row + k * long,
                    out: outs.next()?,
                    sum: sums.as_mut().and_then(Iterator::next),
                })
            });
            workers.all(&mut pieces, |piece| {
                let Some(MoveRows { row, out, sum }) = piece else {
                    return;
                };
                let (row, place) = (*row, 0);
                self.make(step, RowBlock { row, out, place, x }, sum.as_deref_mut());
            });
            row = end;
        }
        true
    }
}
