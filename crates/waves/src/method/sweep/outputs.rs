//! Sums of the same vectors at several outputs.
//!
//! An output has two vectors: sums of the even and of the odd terms of a series. A block of terms in tiles is added to
//! all outputs, tile by tile, with the sums of a tile in registers.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::Sweeper;
use super::sink::{copy, tile_rows, tiled};
use liouville_base::error::StepError;
use liouville_base::run::resize;
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews, Stored};

/// Multiplications between two polls for cancellation.
const POLL: usize = 1 << 24;

/// Pieces for each thread.
const EACH: usize = 4;

/// Two sums for each output, tile by tile.
#[derive(Clone, Debug)]
pub struct Outputs<S> {
    values: Vec<S>,
    rows: usize,
    count: usize,
}

impl<S> Default for Outputs<S> {
    fn default() -> Self {
        Self {
            values: Vec::new(),
            rows: 0,
            count: 0,
        }
    }
}

impl<S: Stored> Outputs<S> {
    /// Makes all sums zero: of vectors of so many rows, at so many outputs.
    ///
    /// # Errors
    /// There is no memory for them.
    pub fn reset(&mut self, rows: usize, count: usize) -> Result<(), StepError> {
        (self.rows, self.count) = (rows, count);
        resize(&mut self.values, tiled::<S>(rows, 2 * count), S::splat(0.0))
    }

    /// Copies a sum of an output.
    pub fn read(&self, output: usize, part: usize, out: &mut [S]) {
        let rows = tile_rows::<S>();
        for (tile, out) in out.chunks_mut(rows).enumerate() {
            let from = ((tile * self.count + output) * 2 + part) * rows;
            out.copy_from_slice(&self.values[from..from + out.len()]);
        }
    }
}

/// A block of the terms of a series, and their weights at each output.
#[derive(Clone, Debug)]
pub struct TermBlock<S> {
    tiles: Vec<S>,
    rows: usize,
    /// The terms in a block, an even number.
    count: usize,
    /// Weights of the terms, one output after another.
    weights: Vec<f64>,
    /// How many terms each output takes.
    taken: Vec<usize>,
}

impl<S> Default for TermBlock<S> {
    fn default() -> Self {
        Self {
            tiles: Vec::new(),
            rows: 0,
            count: 0,
            weights: Vec::new(),
            taken: Vec::new(),
        }
    }
}

impl<S: Stored> TermBlock<S> {
    /// Memory for `count` terms of so many rows.
    ///
    /// # Errors
    /// There is none.
    pub fn reset(&mut self, rows: usize, count: usize) -> Result<(), StepError> {
        (self.rows, self.count) = (rows, count);
        resize(&mut self.tiles, tiled::<S>(rows, count), S::splat(0.0))
    }

    /// The terms, for moves that make them.
    pub fn sink(&mut self) -> super::Sink<'_, S> {
        super::Sink::Copies(&mut self.tiles, self.count)
    }

    /// Sets a term.
    pub fn set(&mut self, term: usize, value: &[S]) {
        copy(&mut self.tiles, (self.count, term), 0, value);
    }

    /// Forgets the weights.
    pub fn clear_weights(&mut self) {
        self.weights.clear();
        self.taken.clear();
    }

    /// Appends the weights of the next output, of at most as many terms as there are.
    pub fn push_weights(&mut self, weights: impl Iterator<Item = f64>) {
        let start = self.weights.len();
        self.weights.extend(weights.take(self.count));
        self.taken.push(self.weights.len() - start);
        self.weights.resize(start + self.count, 0.0);
    }
}

impl<S: Stored> Sweeper<S> {
    /// Adds the even terms of a block to one sum of each output, and the odd ones to the other: `swapped` to the first.
    ///
    /// # Errors
    /// The run was cancelled; the sums are undefined then.
    pub fn add_terms(
        &mut self,
        block: &TermBlock<S>,
        outputs: &mut Outputs<S>,
        swapped: bool,
    ) -> Result<(), StepError> {
        let of_tile = 2 * outputs.count * tile_rows::<S>();
        let each = block.count * outputs.count * tile_rows::<S>() * S::MEMBERS;
        let now = (POLL / each).max(1);
        let machine = self.machine;
        let add = |first: usize, sums: &mut [S]| {
            let part = AddTerms {
                block,
                rows: outputs.rows,
                of_tile,
                first: first / of_tile,
                swapped,
                sums,
            };
            S::run(machine, part);
        };
        let workers = self.workers.as_ref().filter(|_| self.is_worth_sharing());
        let pieces = workers.map_or(1, |workers| EACH * workers.threads());
        for (k, sums) in outputs
            .values
            .chunks_mut(of_tile * now * pieces)
            .enumerate()
        {
            if self.cancel.is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let first = k * of_tile * now * pieces;
            match workers {
                Some(workers) => {
                    let size = of_tile * sums.len().div_ceil(of_tile * pieces);
                    workers.each(size, sums, &mut [], |from, sums, _| add(first + from, sums));
                }
                None => add(first, sums),
            }
        }
        Ok(())
    }
}

/// Some tiles of the outputs.
struct AddTerms<'a, S> {
    block: &'a TermBlock<S>,
    rows: usize,
    of_tile: usize,
    /// The first tile of `sums`.
    first: usize,
    swapped: bool,
    sums: &'a mut [S],
}

impl<S: Stored> Kernel<S> for AddTerms<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let (rows, block) = (tile_rows::<S>(), self.block);
        for (k, sums) in self.sums.chunks_mut(self.of_tile).enumerate() {
            let tile = self.first + k;
            let terms = &block.tiles[tile * rows * block.count..][..rows * block.count];
            let here = rows.min(self.rows - tile * rows);
            for (j, sums) in sums.chunks_mut(2 * rows).enumerate() {
                let weights = &block.weights[j * block.count..][..block.taken[j]];
                for (part, sum) in sums.chunks_mut(rows).enumerate() {
                    let first = part ^ usize::from(self.swapped);
                    let mut add = AddTile {
                        terms,
                        weights: weights.get(first..).unwrap_or(&[]),
                        first: first * rows,
                        sum,
                    };
                    views.each(here, &mut add);
                }
            }
        }
    }
}

/// Every other term of a tile, added to a sum.
struct AddTile<'a, S> {
    terms: &'a [S],
    weights: &'a [f64],
    /// Place of the first term.
    first: usize,
    sum: &'a mut [S],
}

impl<S> ForEach<S> for AddTile<'_, S> {
    #[inline(always)]
    fn visit<V: SimdView<Stored = S>>(&mut self, view: V) -> bool {
        let mut sum = view.load(self.sum, 0);
        let mut place = self.first;
        for weight in self.weights.iter().step_by(2) {
            sum = sum + view.load(self.terms, place).scaled(*weight);
            place += 2 * tile_rows::<S>();
        }
        view.store(self.sum, 0, sum);
        true
    }
}
