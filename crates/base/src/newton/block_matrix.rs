//! The matrix of a Newton iteration, assembled from blocks.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::condensed::Condensed;
use super::units::Units;
use crate::linalg::{Assembly, Factor, Matrix, Pattern, Singular, SparseOf, prefers_sparse};
use crate::real::Real;
use std::ops::Mul;

/// A block of a [`BlockMatrix`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockHandle(usize);

/// Blocks of one pattern, side by side and below one another.
#[derive(Clone, Copy, Debug)]
pub struct BlockGrid {
    first: usize,
    cols: usize,
}

impl BlockGrid {
    /// The block in row `i` and column `j` of the grid.
    pub fn at(self, i: usize, j: usize) -> BlockHandle {
        BlockHandle(self.first + i * self.cols + j)
    }
}

/// The places of all blocks of a matrix. Blocks may overlap: they are added.
#[derive(Debug, Default)]
pub struct BlockLayout<'a> {
    blocks: Vec<(&'a Pattern, usize, usize)>,
}

impl<'a> BlockLayout<'a> {
    /// A block with its corner at (`row`, `col`).
    pub fn place(&mut self, pattern: &'a Pattern, row: usize, col: usize) -> BlockHandle {
        self.blocks.push((pattern, row, col));
        BlockHandle(self.blocks.len() - 1)
    }

    /// `rows` by `cols` blocks that touch, the first with its corner at (`row`, `col`).
    pub fn grid(
        &mut self,
        pattern: &'a Pattern,
        (rows, cols): (usize, usize),
        (row, col): (usize, usize),
    ) -> BlockGrid {
        let (first, (height, width)) = (self.blocks.len(), pattern.shape());
        for i in 0..rows {
            for j in 0..cols {
                self.place(pattern, row + i * height, col + j * width);
            }
        }
        BlockGrid { first, cols }
    }

    /// `count` blocks down the diagonal from (`row`, `col`) on, the one after the other.
    pub fn diagonal(
        &mut self,
        pattern: &'a Pattern,
        count: usize,
        (row, col): (usize, usize),
    ) -> BlockGrid {
        let (first, (height, width)) = (self.blocks.len(), pattern.shape());
        for i in 0..count {
            self.place(pattern, row + i * height, col + i * width);
        }
        BlockGrid { first, cols: 1 }
    }

    /// The square matrix of these blocks, of `order` unknowns followed by `condensed` ones, which a dense elimination
    /// takes first (static condensation).
    ///
    /// # Panics
    /// When a block does not lie inside the matrix.
    pub fn build<R: Real>(&self, order: usize, condensed: usize) -> BlockMatrix<R> {
        let all = order + condensed;
        let assembly = Assembly::new((all, all), &self.blocks);
        let pattern = assembly.pattern();
        // large ones are sparse whatever their pattern
        let is_large = prefers_sparse(order, order * order);
        let dense = (condensed > 0 && !is_large)
            .then(|| Condensed::new(pattern, order))
            .filter(|dense| !prefers_sparse(order, dense.entries()));
        let factors = match dense {
            Some(dense) => BlockFactors::Condensed(Box::new(dense)),
            None if condensed == 0 => BlockFactors::Direct(Factor::new(pattern)),
            None => {
                let sparse = SparseOf::new::<R>(pattern);
                BlockFactors::Direct(Factor::Sparse(Box::new(sparse)))
            }
        };
        BlockMatrix {
            assembly,
            factors,
            units: None,
            has_units: false,
        }
    }
}

/// How the matrix is factored; chosen by its pattern.
#[derive(Clone, Debug)]
enum BlockFactors<R> {
    /// The whole matrix at once.
    Direct(Factor<R>),
    /// The last unknowns first.
    Condensed(Box<Condensed<R>>),
}

impl<R: Real> BlockFactors<R> {
    fn factor(&mut self, pattern: &Pattern, values: &[R]) -> Result<(), Singular> {
        match self {
            Self::Direct(factor) => factor.factor(pattern, values),
            Self::Condensed(condensed) => condensed.factor(values),
        }
    }

    fn is_negative(&self) -> Option<bool> {
        match self {
            Self::Direct(factor) => factor.is_negative(),
            Self::Condensed(condensed) => condensed.is_negative(),
        }
    }

    /// Solves in place with the matrix of these values, which was factored.
    fn solve(&mut self, values: &[R], b: &mut [R]) {
        match self {
            Self::Direct(factor) => factor.solve(b),
            Self::Condensed(condensed) => condensed.solve(values, b),
        }
    }

    /// The same with the transposed matrix.
    fn solve_transposed(&mut self, values: &[R], b: &mut [R]) {
        match self {
            Self::Direct(factor) => factor.solve_transposed(b),
            Self::Condensed(condensed) => condensed.solve_transposed(values, b),
        }
    }
}

/// A Newton matrix: values are added to its blocks, then it is factored and solved with.
#[derive(Clone, Debug)]
pub struct BlockMatrix<R = f64> {
    assembly: Assembly<R>,
    factors: BlockFactors<R>,
    /// Units of its own, and whether the factors are of the matrix in them: where its own do for telling whether it is
    /// singular, it is factored as it stands.
    units: Option<Box<Units<R>>>,
    has_units: bool,
}

impl<R: Real> BlockMatrix<R> {
    /// Every value set to zero.
    pub fn clear(&mut self) {
        self.assembly.clear();
    }

    /// Adds `factor` times a block with these values on its pattern.
    ///
    /// # Panics
    /// When the block is of another matrix, or has not as many values.
    #[inline(always)]
    pub fn add<F: Copy>(&mut self, BlockHandle(block): BlockHandle, values: &[R], factor: F)
    where
        R: Mul<F, Output = R>,
    {
        self.assembly.add(block, values, factor);
    }

    /// All values, those of overlapping blocks added.
    pub fn values(&self) -> &[R] {
        self.assembly.values()
    }

    /// Factors the assembled matrix, in other units where it is singular in its own.
    ///
    /// # Errors
    /// The first column without a pivot.
    pub fn factor(&mut self) -> Result<(), Singular> {
        let (pattern, values) = (self.assembly.pattern(), self.assembly.values());
        self.has_units = false;
        self.factors.factor(pattern, values).or_else(|_| {
            let units = (self.units).get_or_insert_with(|| Units::new(pattern).into());
            self.has_units = true;
            self.factors.factor(pattern, units.measure(pattern, values))
        })
    }

    /// Solves `A x = b` in place.
    pub fn solve(&mut self, b: &mut [R]) {
        let values = self.assembly.values();
        let Some(units) = self.units.as_deref().filter(|_| self.has_units) else {
            return self.factors.solve(values, b);
        };
        units.scale_equations(b);
        self.factors.solve(units.values(), b);
        units.scale_unknowns(b);
    }

    /// Solves `A^T x = b` in place.
    pub fn solve_transposed(&mut self, b: &mut [R]) {
        let values = self.assembly.values();
        let Some(units) = self.units.as_deref().filter(|_| self.has_units) else {
            return self.factors.solve_transposed(values, b);
        };
        units.scale_unknowns(b);
        self.factors.solve_transposed(units.values(), b);
        units.scale_equations(b);
    }

    /// Whether its factors are those of the matrix in other units, of all members if of one.
    pub fn has_units(&self) -> bool {
        self.has_units
    }

    /// Whether its determinant is negative, of the first of several members; `None` where that is not known, as of
    /// sparse factors. Units are positive, and change no sign.
    pub fn is_negative(&self) -> Option<bool> {
        self.factors.is_negative()
    }

    /// Whether its factors are sparse.
    pub fn is_sparse(&self) -> bool {
        matches!(self.factors, BlockFactors::Direct(Factor::Sparse(_)))
    }

    /// Number of unknowns.
    pub fn order(&self) -> usize {
        self.assembly.pattern().shape().0
    }
}

impl BlockMatrix {
    /// The matrix, dense.
    pub fn to_dense(&self) -> Matrix {
        let mut dense = Matrix::zeros(self.order(), self.order());
        let pattern = self.assembly.pattern();
        pattern.add_to(self.assembly.values(), 1.0, &mut dense, 0, 0);
        dense
    }
}
