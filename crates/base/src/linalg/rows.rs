//! A sparse matrix row by row, to multiply with: of constants, or with the values of several nodes side by side.

use super::node_block::{at, at_mut};
use super::{Pattern, PatternError};
use crate::real::Real;

/// A sparse matrix by rows: row i has the entries `starts[i]..starts[i + 1]`, with K values each.
///
/// At K nodes a matrix has one pattern, and the values of the nodes follow one another within an entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows<R = f64> {
    width: usize,
    starts: Vec<usize>,
    cols: Vec<u32>,
    values: Vec<R>,
    /// Which entry of its pattern each is; none where it was made with its values.
    from: Vec<u32>,
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
            from: Vec::new(),
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

    /// Columns of a row, and the values there.
    #[inline]
    pub fn row(&self, i: usize) -> (&[u32], &[f64]) {
        let entries = self.starts[i]..self.starts[i + 1];
        (&self.cols[entries.clone()], &self.values[entries])
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.cols) + size_of_val(&*self.values)
    }

    /// Columns and values of a row.
    #[inline]
    pub fn entries(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let (cols, values) = self.row(i);
        let cols = cols.iter().map(|col| *col as usize);
        cols.zip(values.iter().copied())
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
        let (cols, values) = self.row(i);
        let mut sum = R::splat(0.0);
        for (&col, &value) in cols.iter().zip(values) {
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

    /// The elements of A x, one after another.
    ///
    /// # Panics
    /// When `x` is shorter than a row.
    #[inline]
    pub fn products(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        let starts = self.starts.iter().zip(&self.starts[1..]);
        starts.map(|(start, end)| {
            // two bonds hold most coordinates of most molecules
            match (&self.cols[*start..*end], &self.values[*start..*end]) {
                ([i, j], [a, b]) => a * x[*i as usize] + b * x[*j as usize],
                (cols, values) => {
                    let terms = cols.iter().zip(values);
                    terms.map(|(col, value)| value * x[*col as usize]).sum()
                }
            }
        })
    }

    /// `out += Aᵀ x`
    ///
    /// # Panics
    /// When `out` is shorter than a row.
    #[inline]
    pub fn add_transposed_product(&self, x: &[f64], out: &mut [f64]) {
        for (i, x) in x[..self.starts.len() - 1].iter().enumerate() {
            let (cols, values) = self.row(i);
            for (col, value) in cols.iter().zip(values) {
                out[*col as usize] += value * x;
            }
        }
    }
}

impl<R: Real> Rows<R> {
    /// A matrix of zeros of this pattern, with so many values an entry.
    #[allow(clippy::cast_possible_truncation)] // more entries would not fit in memory
    pub fn of(pattern: &Pattern, nodes: usize) -> Self {
        let (entries, (rows, cols)) = (pattern.entries(), pattern.shape());
        let mut from: Vec<u32> = (0..entries.len() as u32).collect();
        from.sort_by_key(|k| entries[*k as usize]);
        let place = |k: &u32| entries[*k as usize];
        let start = |row| from.partition_point(|k| place(k).0 < row);
        Self {
            width: cols,
            starts: (0..=rows).map(start).collect(),
            cols: from.iter().map(|k| place(k).1 as u32).collect(),
            values: vec![R::splat(0.0); nodes * from.len()],
            from,
        }
    }

    /// A matrix of zeros with the same pattern, with so many values an entry.
    pub fn at<S: Real>(&self, nodes: usize) -> Rows<S> {
        Rows {
            width: self.width,
            starts: self.starts.clone(),
            cols: self.cols.clone(),
            values: vec![S::splat(0.0); nodes * self.from.len()],
            from: self.from.clone(),
        }
    }

    /// Number of rows and columns.
    pub fn shape(&self) -> (usize, usize) {
        (self.starts.len() - 1, self.width)
    }

    /// Where it is not zero, in the order of the values.
    pub fn pattern(&self) -> Pattern {
        let rows = self.starts.iter().zip(&self.starts[1..]).enumerate();
        let entries = rows.flat_map(|(row, (start, end))| {
            let cols = self.cols[*start..*end].iter();
            cols.map(move |col| (row, *col as usize))
        });
        Pattern {
            rows: self.starts.len() - 1,
            cols: self.width,
            entries: entries.collect(),
        }
    }

    /// The values, node by node within an entry.
    pub fn values(&self) -> &[R] {
        &self.values
    }

    /// Takes the values of each node, in the order of the pattern that it was made of.
    ///
    /// # Panics
    /// When there are fewer values than entries.
    #[allow(clippy::inline_always)] // loops over the nodes are unrolled where their number is known
    #[inline(always)]
    pub fn set<'v>(&mut self, nodes: usize, of_node: impl Fn(usize) -> &'v [R]) {
        for i in 0..nodes {
            let of_node = of_node(i);
            for (values, from) in self.values.chunks_exact_mut(nodes).zip(&self.from) {
                values[i] = of_node[*from as usize];
            }
        }
    }

    /// `out += A x` at each of k nodes, in memory for K: [`at_nodes`](crate::at_nodes).
    ///
    /// # Panics
    /// When `x` or `out` is too short.
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    #[inline(always)]
    pub fn add_product<const K: usize>(&self, k: usize, x: &[R], out: &mut [R]) {
        let (mut sum, mut values) = ([R::splat(0.0); K], self.values.chunks_exact(k));
        let rows = self.starts.iter().zip(&self.starts[1..]);
        for (out, (start, end)) in out.chunks_exact_mut(k).zip(rows) {
            sum[..k].copy_from_slice(out);
            for (col, value) in self.cols[*start..*end].iter().zip(&mut values) {
                let x = at::<R, K>(k, x, *col as usize);
                for i in 0..k {
                    sum[i] += value[i] * x[i];
                }
            }
            out.copy_from_slice(&sum[..k]);
        }
    }

    /// `out += Aᵀ x` at each of k nodes, in memory for K.
    ///
    /// # Panics
    /// When `x` or `out` is too short.
    #[allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set
    #[inline(always)]
    pub fn add_product_transposed<const K: usize>(&self, k: usize, x: &[R], out: &mut [R]) {
        let mut values = self.values.chunks_exact(k);
        let rows = self.starts.iter().zip(&self.starts[1..]);
        for (x, (start, end)) in x.chunks_exact(k).zip(rows) {
            for (col, value) in self.cols[*start..*end].iter().zip(&mut values) {
                let out = at_mut::<R, K>(k, out, *col as usize);
                for i in 0..k {
                    out[i] += value[i] * x[i];
                }
            }
        }
    }
}
