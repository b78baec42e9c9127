//! Sparsity patterns, for matrices whose values come from a tape.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Matrix;
use crate::real::Real;

/// Where the nonzeros of a matrix are; their values come from a tape, in the same order.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) entries: Vec<(usize, usize)>,
}

/// A pattern with an entry outside its matrix.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("entry ({row}, {col}) is outside a {rows} by {cols} matrix")]
#[allow(missing_docs)]
pub struct PatternError {
    pub row: usize,
    pub col: usize,
    pub rows: usize,
    pub cols: usize,
}

impl Pattern {
    /// A pattern of `(row, column)` entries, each at most once.
    ///
    /// # Errors
    /// The first entry outside the matrix.
    pub fn new(
        rows: usize,
        cols: usize,
        entries: Vec<(usize, usize)>,
    ) -> Result<Self, PatternError> {
        match entries
            .iter()
            .find(|(row, col)| *row >= rows || *col >= cols)
        {
            Some(&(row, col)) => Err(PatternError {
                row,
                col,
                rows,
                cols,
            }),
            None => Ok(Self {
                rows,
                cols,
                entries,
            }),
        }
    }

    /// The diagonal of a matrix of order `n`.
    pub fn diagonal(n: usize) -> Self {
        Self {
            rows: n,
            cols: n,
            entries: (0..n).map(|k| (k, k)).collect(),
        }
    }

    /// The pattern of the transposed matrix, its entries in the order of this one's.
    #[must_use]
    pub fn transposed(&self) -> Self {
        Self {
            rows: self.cols,
            cols: self.rows,
            entries: self.entries.iter().map(|(row, col)| (*col, *row)).collect(),
        }
    }

    /// The pattern of some rows, in ascending order, its entries in the order of this one's.
    #[must_use]
    pub fn of_rows(&self, rows: &[usize]) -> Self {
        let place = |(row, col): &(usize, usize)| Some((rows.binary_search(row).ok()?, *col));
        Self {
            rows: rows.len(),
            cols: self.cols,
            entries: self.entries.iter().filter_map(place).collect(),
        }
    }

    /// The pattern of a matrix without zeros, column by column.
    pub fn full(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            entries: (0..cols)
                .flat_map(|col| (0..rows).map(move |row| (row, col)))
                .collect(),
        }
    }

    /// Number of rows and columns.
    pub fn shape(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    /// The (row, column) of each entry.
    #[inline]
    pub fn entries(&self) -> &[(usize, usize)] {
        &self.entries
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether the matrix is structurally zero.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Whether all entries lie on the diagonal.
    pub fn is_diagonal(&self) -> bool {
        self.entries.iter().all(|(row, col)| row == col)
    }

    /// `out += factor * A x`
    #[inline(always)]
    pub fn multiply_add<R: Real>(&self, values: &[R], factor: f64, x: &[R], out: &mut [R]) {
        for (&(row, col), value) in self.entries.iter().zip(values) {
            out[row] += *value * factor * x[col];
        }
    }

    /// `out += factor * Aᵀ x`
    #[inline(always)]
    pub fn multiply_add_transposed<R: Real>(
        &self,
        values: &[R],
        factor: f64,
        x: &[R],
        out: &mut [R],
    ) {
        for (&(row, col), value) in self.entries.iter().zip(values) {
            out[col] += *value * factor * x[row];
        }
    }

    /// Adds `factor * A` to `target`, its corner at `(row, col)`.
    #[inline(always)]
    pub fn add_to<R: Real>(
        &self,
        values: &[R],
        factor: f64,
        target: &mut Matrix<R>,
        row: usize,
        col: usize,
    ) {
        for (&(i, j), value) in self.entries.iter().zip(values) {
            target[(row + i, col + j)] += *value * factor;
        }
    }

    /// Adds Aᵀ to `target`, from its row `first` on.
    pub fn add_transposed<R: Real>(&self, values: &[R], target: &mut Matrix<R>, first: usize) {
        for (&(i, j), value) in self.entries.iter().zip(values) {
            target[(first + j, i)] += *value;
        }
    }
}
