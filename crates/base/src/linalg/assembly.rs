//! One sparse matrix made of blocks, whose places are found once.

use super::Pattern;
use crate::real::Real;
use std::ops::Mul;

/// The sum of blocks put at their places in a larger matrix, where they may overlap.
///
/// The pattern is the union of theirs, column by column; what [`Assembly::add`] does is one loop.
#[derive(Clone, Debug)]
pub struct Assembly<R = f64> {
    pattern: Pattern,
    values: Vec<R>,
    /// For each block, where each of its entries goes.
    slots: Vec<Vec<usize>>,
}

impl<R: Real> Assembly<R> {
    /// A matrix of zeros of this shape, for blocks `(pattern, row, column)` with their corners there.
    ///
    /// # Panics
    /// When a block does not lie inside the matrix.
    pub fn new((rows, cols): (usize, usize), blocks: &[(&Pattern, usize, usize)]) -> Self {
        for (pattern, row, col) in blocks {
            let (height, width) = pattern.shape();
            assert!(
                row + height <= rows && col + width <= cols,
                "a {height} by {width} block at ({row}, {col}) lies in a {rows} by {cols} matrix"
            );
        }
        let places: Vec<Vec<(usize, usize)>> = blocks
            .iter()
            .map(|(pattern, row, col)| {
                let entries = pattern.entries().iter();
                entries.map(|(i, j)| (col + j, row + i)).collect()
            })
            .collect();
        let mut union: Vec<(usize, usize)> = places.concat();
        union.sort_unstable();
        union.dedup();
        let slot = |place: &(usize, usize)| union.partition_point(|other| other < place);
        let slots = places.iter().map(|block| block.iter().map(slot).collect());
        Self {
            slots: slots.collect(),
            values: vec![R::splat(0.0); union.len()],
            pattern: Pattern {
                rows,
                cols,
                entries: union.into_iter().map(|(col, row)| (row, col)).collect(),
            },
        }
    }

    /// Every value set to zero.
    pub fn clear(&mut self) {
        self.values.fill(R::splat(0.0));
    }

    /// Adds `factor` times the block with these values on its own pattern.
    ///
    /// # Panics
    /// When there is no such block, or it has not as many values.
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    #[inline(always)]
    pub fn add<F: Copy>(&mut self, block: usize, values: &[R], factor: F)
    where
        R: Mul<F, Output = R>,
    {
        let slots = &self.slots[block];
        assert_eq!(slots.len(), values.len(), "values of block {block}");
        for (slot, value) in slots.iter().zip(values) {
            self.values[*slot] += *value * factor;
        }
    }

    /// Where any block has an entry, column by column.
    pub fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// The values, in the order of the pattern.
    pub fn values(&self) -> &[R] {
        &self.values
    }

    /// The pattern, and where the entries of the first block are in it.
    pub(super) fn into_slots(mut self) -> (Pattern, Vec<usize>) {
        (self.pattern, self.slots.swap_remove(0))
    }
}
