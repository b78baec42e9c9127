//! Sparse LU with row pivoting: faer's, its ordering found once, its memory kept.
//!
//! The factored matrix is the equilibrated R A C, with largest entries near one in each row and column:
//! in a saddle-point matrix stiffness and constraint gradients can be 1e11 apart. R and C are powers of
//! two, so that they round nothing.

use super::choice::PANELS;
use super::{Assembly, Pattern, Singular};
use faer::dyn_stack::MemStack;
use faer::sparse::linalg::colamd;
use faer::sparse::linalg::lu::{
    LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu,
};
use faer::sparse::linalg::{LuError, SupernodalThreshold};
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par};
use std::mem::MaybeUninit;

/// A solution this much larger than its right-hand side, both equilibrated, tells of a singular matrix.
const LARGEST: f64 = 1.0 / (1024.0 * f64::EPSILON);

/// Above this the solution for the probe says no more than that the inverse is at least as large: the probe may be
/// nearly orthogonal to the left null vector. Below, the chance that it hides a singular matrix is 1e-8.
const SUSPECT: f64 = 6.7e7; // 1 / √ε

/// Parts of a null vector above this fraction of its largest count.
const PART: f64 = 1e-4;

/// Sparse LU of matrices of one pattern.
#[derive(Clone, Debug)]
pub struct Sparse {
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, f64>,
    matrix: SparseColMat<usize, f64>,
    /// Where each entry of the pattern goes.
    slots: Vec<usize>,
    row_scale: Vec<f64>,
    col_scale: Vec<f64>,
    /// A right-hand side that no left null vector is orthogonal to, but by chance.
    probe: Vec<f64>,
    x: Vec<f64>,
    memory: Vec<MaybeUninit<u8>>,
}

impl Sparse {
    /// Memory for matrices of this pattern, which is square, and their ordering.
    ///
    /// # Panics
    /// When the pattern is not square or memory is exhausted.
    pub fn new(pattern: &Pattern) -> Self {
        let (n, cols) = pattern.shape();
        assert_eq!(n, cols, "rows and columns of a matrix to factor");
        let (columns, slots) = Assembly::<f64>::new((n, n), &[(pattern, 0, 0)]).into_slots();
        let entries = columns.entries();
        let starts = (0..=n).map(|j| entries.partition_point(|(_, col)| *col < j));
        let rows = entries.iter().map(|(row, _)| *row).collect();
        let places = SymbolicSparseColMat::new_checked(n, n, starts.collect(), None, rows);
        let dense = 10.0 / (n.max(1) as f64).sqrt(); // as a part of n; colamd's own 10 √n
        let parameters = LuSymbolicParams {
            colamd_params: colamd::Control {
                dense_row: dense,
                dense_col: dense,
                aggressive: true,
            },
            supernodal_flop_ratio_threshold: SupernodalThreshold(PANELS),
            ..LuSymbolicParams::default()
        };
        let symbolic = match factorize_symbolic_lu(places.as_ref(), parameters) {
            Ok(symbolic) => symbolic,
            Err(error) => panic!("ordering {n} unknowns: {error:?}"),
        };
        let factoring = symbolic.factorize_numeric_lu_scratch::<f64>(Par::Seq, <_>::default());
        let solving = symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let transposed = symbolic.solve_transpose_in_place_scratch::<f64>(1, Par::Seq);
        let memory = factoring
            .or(solving)
            .or(transposed)
            .unaligned_bytes_required();
        Self {
            symbolic,
            numeric: NumericLu::new(),
            matrix: SparseColMat::new(places, vec![0.0; entries.len()]),
            slots,
            row_scale: vec![0.0; n],
            col_scale: vec![0.0; n],
            probe: (1..=n)
                .map(|k| 0.5 + (k as f64 * 0.618_033_988_749_895).fract())
                .collect(),
            x: vec![0.0; n],
            memory: vec![MaybeUninit::uninit(); memory],
        }
    }

    /// Factors the matrix with these values on the pattern; after the first time in the same memory,
    /// but where other pivots make more fill-in, or dense panels are worked with.
    ///
    /// # Errors
    /// A column that depends on those before it, to roundoff of the equilibrated matrix.
    ///
    /// # Panics
    /// When memory is exhausted.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), Singular> {
        let placed = self.matrix.val_mut();
        placed.fill(0.0);
        for (slot, value) in self.slots.iter().zip(values) {
            placed[*slot] += value;
        }
        self.equilibrate()?;
        if self.factor_equilibrated().is_ok() && self.inverse_norm() < LARGEST {
            Ok(())
        } else {
            Err(self.singular())
        }
    }

    /// Solves `A x = b` in place.
    pub fn solve(&mut self, b: &mut [f64]) {
        for ((x, b), scale) in self.x.iter_mut().zip(&*b).zip(&self.row_scale) {
            *x = scale * b;
        }
        self.solve_equilibrated(false);
        for ((b, x), scale) in b.iter_mut().zip(&self.x).zip(&self.col_scale) {
            *b = scale * x;
        }
    }

    /// Solves `A^T x = b` in place.
    pub fn solve_transposed(&mut self, b: &mut [f64]) {
        for ((x, b), scale) in self.x.iter_mut().zip(&*b).zip(&self.col_scale) {
            *x = scale * b;
        }
        self.solve_equilibrated(true);
        for ((b, x), scale) in b.iter_mut().zip(&self.x).zip(&self.row_scale) {
            *b = scale * x;
        }
    }

    /// Scales rows, then columns, and refuses a column of zeros or with a value that is not finite.
    fn equilibrate(&mut self) -> Result<(), Singular> {
        self.row_scale.fill(0.0);
        let (places, values) = self.matrix.parts_mut();
        for (column, scale) in self.col_scale.iter_mut().enumerate() {
            let range = places.col_range(column);
            let rows = &places.row_idx()[range.clone()];
            *scale = 0.0;
            for (row, value) in rows.iter().zip(&values[range]) {
                if !value.is_finite() {
                    return Err(Singular { column });
                }
                self.row_scale[*row] = self.row_scale[*row].max(value.abs());
            }
        }
        self.row_scale
            .iter_mut()
            .for_each(|x| *x = inverse_power(*x));
        for (column, scale) in self.col_scale.iter_mut().enumerate() {
            let range = places.col_range(column);
            let rows = &places.row_idx()[range.clone()];
            let values = &mut values[range];
            let mut largest = 0.0_f64;
            for (row, value) in rows.iter().zip(&mut *values) {
                *value *= self.row_scale[*row];
                largest = largest.max(value.abs());
            }
            if largest == 0.0 {
                return Err(Singular { column });
            }
            *scale = inverse_power(largest);
            for value in values {
                *value *= *scale;
            }
        }
        Ok(())
    }

    fn factor_equilibrated(&mut self) -> Result<(), usize> {
        let factored = self.symbolic.factorize_numeric_lu(
            &mut self.numeric,
            self.matrix.as_ref(),
            Par::Seq,
            MemStack::new(&mut self.memory),
            <_>::default(),
        );
        match factored {
            Ok(_) => Ok(()),
            Err(LuError::SymbolicSingular { index }) => Err(index),
            Err(LuError::Generic(error)) => {
                panic!("factoring {} unknowns: {error:?}", self.x.len())
            }
        }
    }

    fn solve_equilibrated(&mut self, is_transposed: bool) {
        let n = self.x.len();
        let lu = LuRef::new_unchecked(&self.symbolic, &self.numeric);
        let x = MatMut::from_column_major_slice_mut(&mut self.x, n, 1);
        let stack = MemStack::new(&mut self.memory);
        if is_transposed {
            lu.solve_transpose_in_place_with_conj(Conj::No, x, Par::Seq, stack);
        } else {
            lu.solve_in_place_with_conj(Conj::No, x, Par::Seq, stack);
        }
    }

    /// An estimate of the norm of the inverse, infinite where a pivot is zero: faer divides by it and says nothing.
    fn inverse_norm(&mut self) -> f64 {
        let norm = self.probed();
        if norm < SUSPECT {
            norm
        } else {
            self.iterated(norm)
        }
    }

    /// The size of the solution for the probe, which `x` becomes.
    fn probed(&mut self) -> f64 {
        self.x.copy_from_slice(&self.probe);
        self.solve_equilibrated(false);
        super::max_norm(&self.x)
    }

    /// The norm of the inverse of a nearly singular matrix, and its null vector in `x`, by inverse iteration.
    ///
    /// The solution for the probe, of size `norm`, tends to the null vector, the transposed solution for that to the
    /// left null vector, and the solution for that to the null vector again, whatever the probe is.
    fn iterated(&mut self, mut norm: f64) -> f64 {
        for is_transposed in [true, false] {
            if norm.is_finite() {
                self.x.iter_mut().for_each(|x| *x /= norm);
                self.solve_equilibrated(is_transposed);
                norm = super::max_norm(&self.x);
            }
        }
        norm
    }

    /// The last column with a part in the null vector, which [`Sparse::inverse_norm`] left in `x`.
    fn singular(&mut self) -> Singular {
        if !super::max_norm(&self.x).is_finite() {
            // beside an exactly singular matrix stands one that has factors, and almost its null vector
            let values = self.matrix.val_mut().iter_mut();
            for (k, value) in values.enumerate() {
                *value += 1e-8 * (k as f64 * 0.618_033_988_749_895).fract();
            }
            if let Err(index) = self.factor_equilibrated() {
                let column = self.symbolic.col_perm().arrays().0[index];
                return Singular { column };
            }
            let norm = self.probed();
            self.iterated(norm);
        }
        let column = self.null_vector().rposition(|part| part);
        Singular {
            column: column.unwrap_or(0),
        }
    }

    /// Which columns a null vector combines, once [`Sparse::factor`] found the matrix singular.
    pub(super) fn null_vector(&self) -> impl ExactSizeIterator<Item = bool> + DoubleEndedIterator {
        let least = PART * super::max_norm(&self.x);
        self.x.iter().map(move |x| x.abs() > least)
    }
}

/// The power of two that brings `x` into [1, 2), as near as there is one.
pub(crate) fn inverse_power(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}
