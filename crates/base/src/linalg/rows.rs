//! A sparse matrix of constant values, row by row, to multiply with.

use super::PatternError;
use crate::real::Real;

/// A sparse matrix by rows: row i has the entries `starts[i]..starts[i + 1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    width: usize,
    starts: Vec<usize>,
    cols: Vec<u32>,
    values: Vec<f64>,
}

impl Rows {
    /// A matrix from its entries in any order; those at the same place are added.
    ///
    /// # Errors
    /// The first entry outside the matrix.
    ///
    /// # Panics
    /// When there are 2^32 columns or more, or `row`, `col` and `values` differ in length.
    pub fn new(
        (rows, cols): (usize, usize),
        row: &[usize],
        col: &[usize],
        values: &[f64],
    ) -> Result<Self, PatternError> {
        assert!(u32::try_from(cols).is_ok(), "number of columns");
        let count = values.len();
        assert!(
            row.len() == count && col.len() == count,
            "number of entries"
        );
        let mut starts = vec![0; rows + 1];
        for (&row, &col) in row.iter().zip(col) {
            if row >= rows || col >= cols {
                return Err(PatternError {
                    row,
                    col,
                    rows,
                    cols,
                });
            }
            starts[row + 1] += 1;
        }
        for i in 0..rows {
            starts[i + 1] += starts[i];
        }
        let mut matrix = Self {
            width: cols,
            cols: vec![0; count],
            values: vec![0.0; count],
            starts: starts.clone(),
        };
        #[allow(clippy::cast_possible_truncation)] // the columns are fewer
        for ((&row, &col), &value) in row.iter().zip(col).zip(values) {
            let place = starts[row];
            starts[row] += 1;
            matrix.cols[place] = col as u32;
            matrix.values[place] = value;
        }
        Ok(matrix)
    }

    /// Number of rows and columns.
    pub fn shape(&self) -> (usize, usize) {
        (self.starts.len() - 1, self.width)
    }

    /// Columns of a row, and the values there.
    #[inline]
    pub fn row(&self, i: usize) -> (&[u32], &[f64]) {
        let entries = self.starts[i]..self.starts[i + 1];
        (&self.cols[entries.clone()], &self.values[entries])
    }

    /// How many bytes it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.cols) + size_of_val(&*self.values)
    }

    /// Columns and values of a row.
    #[inline]
    pub fn entries(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[i]..self.starts[i + 1];
        let cols = self.cols[entries.clone()].iter().map(|col| *col as usize);
        cols.zip(self.values[entries].iter().copied())
    }

    /// The largest distance of an entry from the diagonal.
    pub fn reach(&self) -> usize {
        let rows = 0..self.starts.len() - 1;
        let distances = rows.flat_map(|i| self.entries(i).map(move |(j, _)| i.abs_diff(j)));
        distances.max().unwrap_or(0)
    }

    /// `(A x)_i`
    #[inline]
    fn row_times<R: Real>(&self, i: usize, x: &[R]) -> R {
        let entries = self.starts[i]..self.starts[i + 1];
        let mut sum = R::splat(0.0);
        for (&col, &value) in self.cols[entries.clone()].iter().zip(&self.values[entries]) {
            sum += R::splat(value) * x[col as usize];
        }
        sum
    }

    /// `out += factor * A x`
    ///
    /// # Panics
    /// When `x` is shorter than a row or `out` shorter than a column.
    pub fn multiply_add<R: Real>(&self, factor: f64, x: &[R], out: &mut [R]) {
        for (i, out) in out[..self.starts.len() - 1].iter_mut().enumerate() {
            *out += R::splat(factor) * self.row_times(i, x);
        }
    }

    /// `xᵀ A x` for a square matrix.
    ///
    /// # Panics
    /// When `x` is shorter than a row or a column.
    pub fn form<R: Real>(&self, x: &[R]) -> R {
        let rows = x[..self.starts.len() - 1].iter().enumerate();
        rows.fold(R::splat(0.0), |sum, (i, x_i)| {
            sum + *x_i * self.row_times(i, x)
        })
    }
}
