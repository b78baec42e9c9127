//! Inverses of matrices that fall into small blocks, as the masses of rigid bodies do.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::choice::LARGEST_BLOCK;
use super::kernels::short;
use super::{Lu, Pattern, Singular};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd;
use std::sync::Arc;

/// The blocks of a matrix, which may stand anywhere.
#[derive(Debug)]
pub struct BlockPlan {
    /// Where the inverse is not zero: block by block, column by column.
    pattern: Pattern,
    /// The orders of the blocks, and the unknowns of one after the other.
    orders: Vec<usize>,
    unknowns: Vec<u32>,
    /// Where each entry of the matrix goes.
    slots: Vec<u32>,
}

/// The inverse of a block-diagonal matrix.
#[derive(Clone, Debug)]
pub struct Blocks<R = f64> {
    plan: Arc<BlockPlan>,
    inverse: Vec<R>,
    /// Whether the determinant is negative, of the first of several members.
    is_negative: bool,
    /// By its order, the memory that a block is inverted in.
    lu: Vec<Lu<R>>,
}

impl BlockPlan {
    /// The blocks of matrices of this pattern; `None` where one is large.
    #[allow(clippy::cast_possible_truncation)] // more unknowns would not fit in memory
    pub fn new(pattern: &Pattern) -> Option<Self> {
        let n = pattern.shape().0;
        let of = components(pattern);
        let mut blocks: Vec<Vec<u32>> = vec![Vec::new(); n];
        let mut place = vec![0; n];
        for unknown in 0..n {
            let block = &mut blocks[of[unknown]];
            place[unknown] = block.len();
            block.push(unknown as u32);
        }
        if blocks.iter().any(|block| block.len() > LARGEST_BLOCK) {
            return None;
        }
        let mut first = vec![0; n];
        let mut entries = Vec::new();
        for (number, block) in blocks.iter().enumerate() {
            first[number] = entries.len();
            let cols = block.iter().map(|col| *col as usize);
            entries.extend(cols.flat_map(|col| block.iter().map(move |row| (*row as usize, col))));
        }
        let slot = |(row, col): &(usize, usize)| {
            let block = of[*row];
            (first[block] + place[*col] * blocks[block].len() + place[*row]) as u32
        };
        let slots = pattern.entries().iter().map(slot).collect();
        blocks.retain(|block| !block.is_empty());
        Some(Self {
            pattern: Pattern {
                rows: n,
                cols: n,
                entries,
            },
            orders: blocks.iter().map(Vec::len).collect(),
            unknowns: blocks.concat(),
            slots,
        })
    }
}

impl<R: Real> Blocks<R> {
    /// Memory for matrices of this pattern; `None` where a block is large.
    pub fn new(pattern: &Pattern) -> Option<Self> {
        Some(Self::of(Arc::new(BlockPlan::new(pattern)?)))
    }

    /// Memory for matrices of these blocks.
    #[inline(never)]
    pub fn of(plan: Arc<BlockPlan>) -> Self {
        let largest = plan.orders.iter().copied().max().unwrap_or(0);
        Self {
            inverse: vec![R::splat(0.0); plan.pattern.len()],
            is_negative: false,
            lu: (0..=largest).map(Lu::new).collect(),
            plan,
        }
    }

    /// Where the inverse is not zero.
    pub fn pattern(&self) -> &Pattern {
        &self.plan.pattern
    }

    /// The inverse, in the order of its pattern.
    pub fn values(&self) -> &[R] {
        &self.inverse
    }

    /// Whether the determinant of the matrix is negative, of the first of several members.
    pub(super) fn is_negative(&self) -> bool {
        self.is_negative
    }

    /// Inverts the matrix with these values on its pattern.
    ///
    /// # Errors
    /// The first column without a pivot.
    #[inline(never)]
    pub fn factor(&mut self, values: &[R]) -> Result<(), Singular> {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.invert_each(values),
        )
    }

    #[inline(always)]
    fn invert_each(&mut self, values: &[R]) -> Result<(), Singular> {
        self.inverse.fill(R::splat(0.0));
        self.is_negative = false;
        for (slot, value) in self.plan.slots.iter().zip(values) {
            self.inverse[*slot as usize] += *value;
        }
        let (mut rest, mut unknowns) = (&mut self.inverse[..], &self.plan.unknowns[..]);
        for order in &self.plan.orders {
            let (block, others) = rest.split_at_mut(order * order);
            let (own, next) = unknowns.split_at(*order);
            let inverted = invert(&mut self.lu[*order], block);
            self.is_negative ^= inverted.map_err(|singular| Singular {
                column: own[singular.column] as usize,
            })?;
            (rest, unknowns) = (others, next);
        }
        Ok(())
    }

    /// Solves `A x = b` in place.
    #[inline]
    pub fn solve(&self, b: &mut [R]) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.multiply_each(b),
        );
    }

    #[inline(always)]
    fn multiply_each(&self, b: &mut [R]) {
        let (mut rest, mut unknowns) = (&self.inverse[..], &self.plan.unknowns[..]);
        for order in &self.plan.orders {
            let (own, next) = unknowns.split_at(*order);
            let (block, others) = rest.split_at(order * order);
            if R::IS_SINGLE {
                short!(*order, N => multiply::<R, N>(block, own, b), ());
            } else {
                multiply_members(block, own, b);
            }
            (rest, unknowns) = (others, next);
        }
    }

    /// Solves `A^T x = b` in place.
    pub fn solve_transposed(&self, b: &mut [R]) {
        let (mut rest, mut unknowns) = (&self.inverse[..], &self.plan.unknowns[..]);
        for order in &self.plan.orders {
            let (own, next) = unknowns.split_at(*order);
            let (block, others) = rest.split_at(order * order);
            let mut sums = [R::splat(0.0); LARGEST_BLOCK];
            for (sum, column) in sums.iter_mut().zip(block.chunks_exact(*order)) {
                for (x, unknown) in column.iter().zip(own) {
                    *sum += *x * b[*unknown as usize];
                }
            }
            for (sum, unknown) in sums.iter().zip(own) {
                b[*unknown as usize] = *sum;
            }
            (rest, unknowns) = (others, next);
        }
    }
}

/// The unknowns of one block, multiplied by its inverse.
#[inline]
fn multiply<R: Real, const N: usize>(inverse: &[R], unknowns: &[u32], b: &mut [R]) {
    let (columns, Some(unknowns)) = (inverse.as_chunks::<N>().0, unknowns.first_chunk::<N>())
    else {
        return;
    };
    let mut sum = [R::splat(-0.0); N];
    for (column, unknown) in columns.iter().zip(unknowns) {
        let x = b[*unknown as usize];
        for i in 0..N {
            sum[i] += column[i] * x;
        }
    }
    for (sum, unknown) in sum.iter().zip(unknowns) {
        b[*unknown as usize] = *sum;
    }
}

/// The same of several members, whose sums are vectors already.
#[inline(always)]
fn multiply_members<R: Real>(inverse: &[R], unknowns: &[u32], b: &mut [R]) {
    let mut sums = [R::splat(0.0); LARGEST_BLOCK];
    for (i, sum) in sums.iter_mut().enumerate().take(unknowns.len()) {
        let mut total = R::splat(-0.0);
        for (column, unknown) in inverse.chunks_exact(unknowns.len()).zip(unknowns) {
            total += column[i] * b[*unknown as usize];
        }
        *sum = total;
    }
    for (sum, unknown) in sums.iter().zip(unknowns) {
        b[*unknown as usize] = *sum;
    }
}

/// A block becomes its inverse; returns whether its determinant is negative, of the first of several members.
#[inline(always)]
fn invert<R: Real>(lu: &mut Lu<R>, block: &mut [R]) -> Result<bool, Singular> {
    let order = lu.order();
    if let [value] = block {
        *value = R::splat(1.0) / *value;
        let is_fine = value.all(|x| x != 0.0 && x.is_finite());
        return if is_fine {
            Ok(value.member(0) < 0.0)
        } else {
            Err(Singular { column: 0 })
        };
    }
    for (k, value) in block.iter().enumerate() {
        lu.matrix_mut()[(k % order, k / order)] = *value;
    }
    lu.factor()?;
    block.fill(R::splat(0.0));
    for (k, column) in block.chunks_exact_mut(order).enumerate() {
        column[k] = R::splat(1.0);
        lu.solve(column);
    }
    Ok(lu.is_negative())
}

/// For each unknown the first of those it is connected with.
fn components(pattern: &Pattern) -> Vec<usize> {
    fn root(of: &mut [usize], mut k: usize) -> usize {
        while of[k] != k {
            of[k] = of[of[k]];
            k = of[k];
        }
        k
    }
    let mut of: Vec<usize> = (0..pattern.shape().0).collect();
    for (row, col) in pattern.entries() {
        let (a, b) = (root(&mut of, *row), root(&mut of, *col));
        of[a.max(b)] = a.min(b);
    }
    (0..of.len()).map(|k| root(&mut of, k)).collect()
}

crate::compiled!(R in [f64, Lanes<BATCH>] {
    Blocks::<R>::of as fn(_) -> _,
    Blocks::<R>::factor as fn(_, _) -> _,
});
