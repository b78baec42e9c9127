//! Products with a sparse symmetric matrix most of which lies on a few diagonals.

use super::row_product::update_rows;
use super::rows::ListedRows;
use super::{Diagonals, RowBlock, Update};
use liouville_base::linalg::Rows;
use liouville_base::simd::{InstructionSet, Stored};
use std::collections::HashMap;

/// Diagonals, and the entries beside them.
#[derive(Clone, Debug)]
pub struct Sparse {
    diagonals: Diagonals,
    /// The entries on no stored diagonal.
    rest: ListedRows,
}

impl Sparse {
    /// The same matrix by its diagonals; none if they hold less than half of it or are not symmetric.
    pub fn new(rows: &Rows) -> Option<Self> {
        let (n, width) = rows.shape();
        let entries = || (0..n).flat_map(|i| rows.entries(i).map(move |(j, value)| (i, j, value)));
        let mut counts = HashMap::new();
        for (i, j, _) in entries().filter(|(i, j, _)| j >= i) {
            *counts.entry(j - i).or_insert(0) += 1;
        }
        counts.retain(|offset, count| 2 * *count >= n.saturating_sub(*offset));
        let mut offsets: Vec<usize> = counts.into_keys().collect();
        offsets.sort_unstable();
        let empty = |offset: &usize| vec![0.0; n.saturating_sub(*offset)];
        let mut above: Vec<Vec<f64>> = offsets.iter().map(empty).collect();
        let mut below = above.clone();
        let (mut of_row, mut col, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let mut numbers = Vec::new();
        for (i, j, value) in entries() {
            if let Ok(k) = offsets.binary_search(&i.abs_diff(j)) {
                let side = if j > i { &mut above } else { &mut below };
                side[k][i.min(j)] += value;
                continue;
            }
            if numbers.last() != Some(&i) {
                numbers.push(i);
            }
            of_row.push(numbers.len() - 1);
            col.push(j);
            values.push(value);
        }
        if offsets.first() == Some(&0) {
            above[0].clone_from(&below[0]);
        }
        if width != n || 2 * values.len() > entries().count() || above != below {
            return None;
        }
        let diagonals: Vec<_> = offsets.into_iter().zip(above).collect();
        Some(Self {
            diagonals: Diagonals::new(n, &diagonals),
            rest: ListedRows {
                rows: Rows::new((numbers.len(), n), &of_row, &col, &values).ok()?,
                numbers,
            },
        })
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.diagonals.size()
    }

    /// The largest distance of an entry from the diagonal.
    pub fn reach(&self) -> usize {
        let ListedRows { numbers, rows } = &self.rest;
        let numbers = numbers.iter().enumerate();
        let distances = numbers.flat_map(|(k, i)| rows.entries(k).map(|(j, _)| i.abs_diff(j)));
        distances.max().unwrap_or(0).max(self.diagonals.reach())
    }

    /// How many bytes all rows are.
    pub(super) fn bytes(&self) -> usize {
        self.diagonals.bytes() + self.rest.rows.bytes()
    }

    /// Updates a block of rows.
    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        update: Update,
        block: RowBlock<'_, S>,
    ) {
        let RowBlock { row, out, place, x } = block;
        let diagonals = RowBlock {
            row,
            out: &mut *out,
            place,
            x,
        };
        update_rows(&self.diagonals, machine, update, diagonals);
        let rest = RowBlock { row, out, place, x };
        update_rows(&self.rest, machine, Update::added(update.factor), rest);
    }
}
