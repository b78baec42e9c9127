//! Dense LU of small matrices.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Matrix;
use super::kernels::short;
use super::{add_scaled, dot, max_norm};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd;

/// No pivot in this column: it depends on the columns before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Singular {
    /// The column.
    pub column: usize,
}

/// Dense LU with row pivoting, each row measured by its own largest entry; each of several members has
/// pivots of its own.
#[derive(Clone, Debug)]
pub struct Lu<R = f64> {
    factors: Matrix<R>,
    /// For each column the row it was swapped with, of each member.
    swaps: Vec<usize>,
    scale: Vec<R>,
    /// Candidates for a pivot.
    sizes: Vec<R>,
}

impl<R: Real> Lu<R> {
    /// Memory for matrices of order `n`.
    pub fn new(n: usize) -> Self {
        Self {
            factors: Matrix::zeros(n, n),
            swaps: vec![0; n * R::MEMBERS],
            scale: vec![R::splat(0.0); n],
            sizes: vec![R::splat(0.0); n],
        }
    }

    /// The order of the matrix.
    pub fn order(&self) -> usize {
        self.scale.len()
    }

    /// The matrix to factor, to be overwritten; call [`Lu::factor`] afterwards.
    pub fn matrix_mut(&mut self) -> &mut Matrix<R> {
        &mut self.factors
    }

    /// Factors the matrix that was written to [`Lu::matrix_mut`].
    ///
    /// # Errors
    /// The first column whose best pivot is at roundoff of its row.
    #[inline(never)]
    pub fn factor(&mut self) -> Result<(), Singular> {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.eliminate(),
        )
    }

    #[inline(always)]
    fn eliminate(&mut self) -> Result<(), Singular> {
        let n = self.order();
        for i in 0..n {
            self.scale[i] = max_norm(self.factors.row(i));
        }
        for k in 0..n {
            self.pivot(k)?;
            let (head, tail) = self.factors.flat_mut().split_at_mut((k + 1) * n);
            let pivot_row = &head[k * n..];
            let inverse = R::splat(1.0) / pivot_row[k];
            for row in tail.chunks_exact_mut(n) {
                let factor = row[k] * inverse;
                row[k] = factor;
                if factor.all(|factor| factor != 0.0) {
                    add_scaled(&mut row[k + 1..], -factor, &pivot_row[k + 1..]);
                } else {
                    eliminate_some(&mut row[k + 1..], factor, &pivot_row[k + 1..]);
                }
            }
            self.factors[(k, k)] = inverse; // solves multiply
        }
        self.factors.transpose(); // solves go by columns, whose elements do not wait for each other
        Ok(())
    }

    /// Brings the largest pivot of column `k` into its place, for each member.
    #[inline(always)]
    fn pivot(&mut self, k: usize) -> Result<(), Singular> {
        let n = self.order();
        #[allow(clippy::cast_precision_loss)]
        let tiny = 4.0 * n as f64 * f64::EPSILON;
        if !R::IS_SINGLE {
            for i in k..n {
                self.sizes[i] = self.factors[(i, k)].map(f64::abs) / self.scale[i];
            }
        }
        let (factors, scale, sizes) = (&self.factors, &self.scale, &self.sizes);
        let swaps = &mut self.swaps[k * R::MEMBERS..(k + 1) * R::MEMBERS];
        for (member, swap) in swaps.iter_mut().enumerate() {
            let (mut best, mut size) = (k, 0.0);
            for i in k..n {
                let candidate = if R::IS_SINGLE {
                    factors[(i, k)].member(member).abs() / scale[i].member(member)
                } else {
                    sizes[i].member(member)
                };
                if candidate > size {
                    (best, size) = (i, candidate);
                }
            }
            if !(size > tiny && size.is_finite()) {
                return Err(Singular { column: k });
            }
            *swap = best;
        }
        let first = swaps[0];
        if swaps.iter().all(|swap| *swap == first) {
            self.factors.swap_rows(k, first);
            self.scale.swap(k, first);
            return Ok(());
        }
        for (member, swap) in swaps.iter().enumerate() {
            for j in 0..n {
                swap_member(self.factors.flat_mut(), k * n + j, swap * n + j, member);
            }
            swap_member(&mut self.scale, k, *swap, member);
        }
        Ok(())
    }

    /// Solves `A x = b` in place.
    #[inline(always)]
    pub fn solve(&self, b: &mut [R]) {
        for (k, swaps) in self.swaps.chunks_exact(R::MEMBERS).enumerate() {
            swap(b, k, swaps);
        }
        if R::IS_SINGLE {
            self.solve_alone(b);
        } else {
            self.solve_long(b);
        }
    }

    #[inline]
    fn solve_alone(&self, b: &mut [R]) {
        short!(self.order(), N => self.solve_short::<N>(b), self.solve_long(b));
    }

    #[inline(always)]
    fn solve_long(&self, b: &mut [R]) {
        let n = self.order();
        for j in 0..n {
            let (head, tail) = b.split_at_mut(j + 1);
            add_scaled(tail, -head[j], &self.factors.row(j)[j + 1..]);
        }
        for j in (0..n).rev() {
            let (head, tail) = b.split_at_mut(j);
            let column = self.factors.row(j);
            tail[0] *= column[j];
            add_scaled(head, -tail[0], column);
        }
    }

    /// The same with loops of known length.
    #[inline]
    fn solve_short<const N: usize>(&self, b: &mut [R]) {
        let (columns, []) = self.factors.flat().as_chunks::<N>() else {
            return;
        };
        let (Some(columns), Some(b)) = (columns.first_chunk::<N>(), b.first_chunk_mut::<N>())
        else {
            return;
        };
        for j in 0..N {
            for i in j + 1..N {
                b[i] += columns[j][i] * -b[j];
            }
        }
        for j in (0..N).rev() {
            b[j] *= columns[j][j];
            for i in 0..j {
                b[i] += columns[j][i] * -b[j];
            }
        }
    }

    /// Solves `A^T x = b` in place.
    #[inline(never)]
    pub fn solve_transposed(&self, b: &mut [R]) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.eliminate_transposed(b),
        );
    }

    #[inline(always)]
    fn eliminate_transposed(&self, b: &mut [R]) {
        let n = self.order();
        for j in 0..n {
            let (head, tail) = b.split_at_mut(j);
            let column = self.factors.row(j);
            tail[0] = (tail[0] - dot(column, head)) * column[j];
        }
        for j in (0..n).rev() {
            let (head, tail) = b.split_at_mut(j + 1);
            head[j] -= dot(&self.factors.row(j)[j + 1..], tail);
        }
        for (k, swaps) in self.swaps.chunks_exact(R::MEMBERS).enumerate().rev() {
            swap(b, k, swaps);
        }
    }
}

impl<R: Real> Lu<R> {
    /// Whether the determinant of the matrix is negative, of the first of several members.
    #[inline(always)]
    pub fn is_negative(&self) -> bool {
        let mut is_negative = false;
        for (k, swaps) in self.swaps.chunks_exact(R::MEMBERS).enumerate() {
            is_negative ^= (swaps[0] != k) ^ (self.factors[(k, k)].member(0) < 0.0);
        }
        is_negative
    }
}

impl Lu {
    /// The determinant of the matrix.
    pub fn determinant(&self) -> f64 {
        let pivots = self.swaps.iter().enumerate().map(|(k, swap)| {
            let sign = if k == *swap { 1.0 } else { -1.0 };
            sign / self.factors[(k, k)]
        });
        pivots.product()
    }
}

/// The inverse of a matrix; `None` where it is singular.
pub fn inverse(matrix: &Matrix) -> Option<Matrix> {
    let n = matrix.rows();
    let mut lu = Lu::new(n);
    lu.matrix_mut().flat_mut().copy_from_slice(matrix.flat());
    lu.factor().ok()?;
    let mut columns = Matrix::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.0 });
    for col in 0..n {
        lu.solve(columns.row_mut(col));
    }
    Some(Matrix::from_fn(n, n, |i, j| columns[(j, i)]))
}

/// `row -= factor * pivot_row` for those members whose factor is not zero: they alone do that.
#[cold]
fn eliminate_some<R: Real>(row: &mut [R], factor: R, pivot_row: &[R]) {
    for member in 0..R::MEMBERS {
        let factor = factor.member(member);
        if factor == 0.0 {
            continue;
        }
        for (out, x) in row.iter_mut().zip(pivot_row) {
            out.set_member(member, out.member(member) + -factor * x.member(member));
        }
    }
}

/// Swaps place `k` with that of each member.
#[inline(always)]
fn swap<R: Real>(x: &mut [R], k: usize, with: &[usize]) {
    if with.iter().all(|other| *other == with[0]) {
        x.swap(k, with[0]);
        return;
    }
    for (member, other) in with.iter().enumerate() {
        swap_member(x, k, *other, member);
    }
}

#[inline(always)]
fn swap_member<R: Real>(x: &mut [R], i: usize, j: usize, member: usize) {
    let (a, b) = (x[i].member(member), x[j].member(member));
    x[i].set_member(member, b);
    x[j].set_member(member, a);
}

crate::compiled!(R in [f64, Lanes<BATCH>] {
    Lu::<R>::factor as fn(_) -> _,
    Lu::<R>::solve_transposed as fn(_, _),
});
