//! Matrices as the steppers need them: small and dense, a sparsity pattern, and two factorisations.
//!
//! Everything is sized once and then overwritten; nothing here allocates after construction.

use std::ops::{Index, IndexMut};

/// A dense matrix, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    cols: usize,
    data: Vec<f64>,
}

impl Matrix {
    /// A matrix of zeros.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            cols,
            data: vec![0.0; rows * cols],
        }
    }

    /// A matrix from a function of row and column.
    pub fn from_fn(rows: usize, cols: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        let data = (0..rows)
            .flat_map(|i| (0..cols).map(move |j| (i, j)))
            .map(|(i, j)| f(i, j));
        Self {
            cols,
            data: data.collect(),
        }
    }

    /// Row `i`.
    #[inline]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// Row `i`, to write.
    #[inline]
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.data.len().checked_div(self.cols).unwrap_or(0)
    }

    /// Every entry set to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
    }

    /// All entries, row by row.
    #[inline]
    pub fn flat(&self) -> &[f64] {
        &self.data
    }

    /// All entries, row by row, to write.
    #[inline]
    pub fn flat_mut(&mut self) -> &mut [f64] {
        &mut self.data
    }

    fn swap_rows(&mut self, i: usize, j: usize) {
        if i != j {
            let (low, high) = (i.min(j), i.max(j));
            let (head, tail) = self.data.split_at_mut(high * self.cols);
            head[low * self.cols..(low + 1) * self.cols].swap_with_slice(&mut tail[..self.cols]);
        }
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;
    #[inline]
    fn index(&self, (i, j): (usize, usize)) -> &f64 {
        &self.data[i * self.cols + j]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    #[inline]
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut f64 {
        &mut self.data[i * self.cols + j]
    }
}

/// `out += factor * x`
#[inline]
pub fn add_scaled(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out += factor * x;
    }
}

/// Runs `$small` with the constant `$N` equal to `$n` up to 8, and `$any` beyond: the vectors of small
/// systems are so short that a loop of unknown length costs more than its work.
macro_rules! short {
    ($n:expr, $N:ident => $small:expr, $any:expr) => {
        short!(@ $n, $N, $small, $any, 1 2 3 4 5 6 7 8)
    };
    (@ $n:expr, $N:ident, $small:expr, $any:expr, $($size:literal)*) => {
        match $n {
            $($size => { const $N: usize = $size; $small })*
            _ => $any,
        }
    };
}

/// `out_ik = finish(i, k, Σ_j weights_ij x_jk)`, for as many rows as both `out` and `weights` have.
#[inline]
pub fn combine(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    short!(x.cols, N => combine_short::<N>(out, weights, x, finish), combine_long(out, weights, x, finish));
}

#[inline]
fn combine_short<const N: usize>(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    let (out, x) = (out.as_chunks_mut::<N>().0, x.data.as_chunks::<N>().0);
    for (i, (out, weights)) in out
        .iter_mut()
        .zip(weights.data.chunks_exact(weights.cols))
        .enumerate()
    {
        let mut sum = [0.0; N];
        for (weight, x) in weights.iter().zip(x) {
            for k in 0..N {
                sum[k] += weight * x[k];
            }
        }
        for k in 0..N {
            out[k] = finish(i, k, sum[k]);
        }
    }
}

fn combine_long(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    let rows = weights.data.chunks_exact(weights.cols);
    for (i, (out, weights)) in out.chunks_exact_mut(x.cols).zip(rows).enumerate() {
        out.fill(0.0);
        for (weight, x) in weights.iter().zip(x.data.chunks_exact(x.cols)) {
            add_scaled(out, *weight, x);
        }
        for (k, out) in out.iter_mut().enumerate() {
            *out = finish(i, k, *out);
        }
    }
}

/// `out = x`
#[inline]
pub fn copy<T: Copy>(out: &mut [T], x: &[T]) {
    assert_eq!(out.len(), x.len(), "sizes of a copy");
    short!(
        x.len(),
        N => if let (Some(out), Some(x)) = (out.first_chunk_mut::<N>(), x.first_chunk::<N>()) { *out = *x; },
        out.copy_from_slice(x)
    );
}

/// `out = factor * x`
#[inline]
pub fn copy_scaled(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = factor * x;
    }
}

/// Largest magnitude; NaN counts as infinite.
#[inline]
pub fn max_norm(x: &[f64]) -> f64 {
    let mut largest = 0.0_f64;
    let mut finite = true;
    for x in x {
        largest = largest.max(x.abs());
        finite &= !x.is_nan();
    }
    if finite { largest } else { f64::INFINITY }
}

/// Where the nonzeros of a matrix are; their values come from a tape, in the same order.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    rows: usize,
    cols: usize,
    entries: Vec<(usize, usize)>,
}

/// A pattern with an entry outside its matrix, or one too many.
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
    /// A pattern of `(row, column)` entries.
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
    #[inline]
    pub fn multiply_add(&self, values: &[f64], factor: f64, x: &[f64], out: &mut [f64]) {
        for (&(row, col), value) in self.entries.iter().zip(values) {
            out[row] += factor * value * x[col];
        }
    }

    /// Adds `factor * A` to `target`, its corner at `(row, col)`.
    pub fn add_to(&self, values: &[f64], factor: f64, target: &mut Matrix, row: usize, col: usize) {
        for (&(i, j), value) in self.entries.iter().zip(values) {
            target[(row + i, col + j)] += factor * value;
        }
    }
}

/// No pivot in this column: it depends on the columns before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Singular {
    /// The column.
    pub column: usize,
}

/// Dense LU with row pivoting, each row measured by its own largest entry.
#[derive(Clone, Debug)]
pub struct Lu {
    factors: Matrix,
    swaps: Vec<usize>,
    scale: Vec<f64>,
}

impl Lu {
    /// Memory for matrices of order `n`.
    pub fn new(n: usize) -> Self {
        Self {
            factors: Matrix::zeros(n, n),
            swaps: vec![0; n],
            scale: vec![0.0; n],
        }
    }

    /// The order of the matrix.
    pub fn order(&self) -> usize {
        self.swaps.len()
    }

    /// The matrix to factor, to be overwritten; call [`Lu::factor`] afterwards.
    pub fn matrix_mut(&mut self) -> &mut Matrix {
        &mut self.factors
    }

    /// Factors the matrix that was written to [`Lu::matrix_mut`].
    ///
    /// # Errors
    /// The first column whose best pivot is at roundoff of its row.
    pub fn factor(&mut self) -> Result<(), Singular> {
        let n = self.order();
        #[allow(clippy::cast_precision_loss)]
        let tiny = 4.0 * n as f64 * f64::EPSILON;
        for i in 0..n {
            self.scale[i] = max_norm(self.factors.row(i));
        }
        for k in 0..n {
            let (mut best, mut size) = (k, 0.0);
            for i in k..n {
                let candidate = self.factors[(i, k)].abs() / self.scale[i];
                if candidate > size {
                    (best, size) = (i, candidate);
                }
            }
            if !(size > tiny && size.is_finite()) {
                return Err(Singular { column: k });
            }
            self.factors.swap_rows(k, best);
            self.scale.swap(k, best);
            self.swaps[k] = best;
            let (head, tail) = self.factors.data.split_at_mut((k + 1) * n);
            let pivot_row = &head[k * n..];
            let inverse = 1.0 / pivot_row[k];
            for row in tail.chunks_exact_mut(n) {
                let factor = row[k] * inverse;
                row[k] = factor;
                if factor != 0.0 {
                    add_scaled(&mut row[k + 1..], -factor, &pivot_row[k + 1..]);
                }
            }
            self.factors[(k, k)] = inverse; // solves multiply
        }
        Ok(())
    }

    /// Solves `A x = b` in place.
    #[inline]
    pub fn solve(&self, b: &mut [f64]) {
        let n = self.order();
        for (k, swap) in self.swaps.iter().enumerate() {
            b.swap(k, *swap);
        }
        for i in 1..n {
            let (head, tail) = b.split_at_mut(i);
            tail[0] -= dot(&self.factors.row(i)[..i], head);
        }
        for i in (0..n).rev() {
            let (head, tail) = b.split_at_mut(i + 1);
            let row = self.factors.row(i);
            head[i] = (head[i] - dot(&row[i + 1..], tail)) * row[i];
        }
    }

    /// Solves `A^T x = b` in place.
    pub fn solve_transposed(&self, b: &mut [f64]) {
        let n = self.order();
        for i in 0..n {
            let row = self.factors.row(i);
            b[i] *= row[i];
            let (head, tail) = b.split_at_mut(i + 1);
            add_scaled(tail, -head[i], &row[i + 1..]);
        }
        for i in (1..n).rev() {
            let (head, tail) = b.split_at_mut(i);
            add_scaled(head, -tail[0], &self.factors.row(i)[..i]);
        }
        for (k, swap) in self.swaps.iter().enumerate().rev() {
            b.swap(k, *swap);
        }
    }
}

#[inline]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// A square matrix ready to be solved with, as its pattern allows; the choice is made once.
#[derive(Clone, Debug)]
pub enum Factor {
    /// Reciprocals of the diagonal.
    Diagonal(Vec<f64>),
    /// Dense LU.
    Dense(Lu),
}

impl Factor {
    /// Memory for matrices of this pattern.
    pub fn new(pattern: &Pattern) -> Self {
        let (n, _) = pattern.shape();
        if pattern.is_diagonal() {
            Self::Diagonal(vec![0.0; n])
        } else {
            Self::Dense(Lu::new(n))
        }
    }

    /// Factors the matrix with these values on its pattern.
    ///
    /// # Errors
    /// The first column without a pivot.
    pub fn factor(&mut self, pattern: &Pattern, values: &[f64]) -> Result<(), Singular> {
        match self {
            Self::Diagonal(inverse) => {
                inverse.fill(0.0);
                for (&(row, _), value) in pattern.entries.iter().zip(values) {
                    inverse[row] = 1.0 / value;
                }
                match inverse.iter().position(|x| *x == 0.0 || !x.is_finite()) {
                    Some(column) => Err(Singular { column }),
                    None => Ok(()),
                }
            }
            Self::Dense(lu) => {
                lu.matrix_mut().clear();
                pattern.add_to(values, 1.0, lu.matrix_mut(), 0, 0);
                lu.factor()
            }
        }
    }

    /// Solves `A x = b` in place.
    #[inline]
    pub fn solve(&self, b: &mut [f64]) {
        match self {
            Self::Diagonal(inverse) => b
                .iter_mut()
                .zip(inverse)
                .for_each(|(b, inverse)| *b *= inverse),
            Self::Dense(lu) => lu.solve(b),
        }
    }
}

/// Rows whose combination vanishes: the first row that depends on those before it, and those it needs.
pub fn dependent_rows(mut matrix: Matrix) -> Option<Vec<usize>> {
    let (rows, cols) = (matrix.rows(), matrix.cols);
    let mut combination = Matrix::from_fn(rows, rows, |i, j| f64::from(u8::from(i == j)));
    let mut pivots: Vec<(usize, usize)> = Vec::new();
    for i in 0..rows {
        let scale = max_norm(matrix.row(i));
        for &(pivot_row, col) in &pivots {
            let factor = matrix[(i, col)] / matrix[(pivot_row, col)];
            for j in 0..cols {
                let above = matrix[(pivot_row, j)];
                matrix[(i, j)] -= factor * above;
            }
            for j in 0..rows {
                let above = combination[(pivot_row, j)];
                combination[(i, j)] -= factor * above;
            }
        }
        let col = (0..cols).max_by(|a, b| matrix[(i, *a)].abs().total_cmp(&matrix[(i, *b)].abs()));
        match col {
            Some(col) if matrix[(i, col)].abs() > 1e-11 * scale => pivots.push((i, col)),
            _ => {
                let largest = max_norm(combination.row(i));
                let takes_part = |k: &usize| combination[(i, *k)].abs() > 1e-9 * largest;
                return Some((0..=i).filter(takes_part).collect());
            }
        }
    }
    None
}
