//! A small dense matrix.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use crate::real::Real;
use std::ops::{Index, IndexMut};

/// A dense matrix, row by row.
#[derive(Debug, PartialEq)]
pub struct Matrix<R = f64> {
    rows: usize,
    cols: usize,
    data: Vec<R>,
}

crate::clone_in_place!([R: Clone] Matrix<R> { rows, cols, data });
crate::checkpoint!([R: Real] Matrix<R> { data });

impl<R: Real> Matrix<R> {
    /// A matrix of zeros.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            data: vec![R::splat(0.0); rows * cols],
        }
    }

    /// A matrix from a function of row and column.
    pub fn from_fn(rows: usize, cols: usize, f: impl Fn(usize, usize) -> R) -> Self {
        let data = (0..rows)
            .flat_map(|i| (0..cols).map(move |j| (i, j)))
            .map(|(i, j)| f(i, j));
        Self {
            rows,
            cols,
            data: data.collect(),
        }
    }

    /// Row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[R] {
        &self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// Row `i`, to write.
    #[inline(always)]
    pub fn row_mut(&mut self, i: usize) -> &mut [R] {
        &mut self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// Number of rows.
    #[inline(always)]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[inline(always)]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Every entry set to zero.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.data.fill(R::splat(0.0));
    }

    /// All entries, row by row.
    #[inline(always)]
    pub fn flat(&self) -> &[R] {
        &self.data
    }

    /// All entries, row by row, to write.
    #[inline(always)]
    pub fn flat_mut(&mut self) -> &mut [R] {
        &mut self.data
    }

    /// A square matrix becomes its transpose.
    #[inline(always)]
    pub(super) fn transpose(&mut self) {
        let n = self.cols;
        for i in 1..n {
            let (above, row) = self.data.split_at_mut(i * n);
            for (j, value) in row[..i].iter_mut().enumerate() {
                std::mem::swap(value, &mut above[j * n + i]);
            }
        }
    }

    #[inline(always)]
    pub(super) fn swap_rows(&mut self, i: usize, j: usize) {
        if i != j {
            let (low, high) = (i.min(j), i.max(j));
            let (head, tail) = self.data.split_at_mut(high * self.cols);
            head[low * self.cols..(low + 1) * self.cols].swap_with_slice(&mut tail[..self.cols]);
        }
    }
}

impl<R> Index<(usize, usize)> for Matrix<R> {
    type Output = R;
    #[inline(always)]
    fn index(&self, (i, j): (usize, usize)) -> &R {
        &self.data[i * self.cols + j]
    }
}

impl<R> IndexMut<(usize, usize)> for Matrix<R> {
    #[inline(always)]
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut R {
        &mut self.data[i * self.cols + j]
    }
}
