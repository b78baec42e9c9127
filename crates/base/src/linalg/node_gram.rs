//! Matrices of small blocks P_il (A_i B_l), of sparse A at k nodes and B at k nodes, factored.
//!
//! With P the k by k matrix of weights and the unknowns ordered by rows of A first, nodes second,
//!
//!     S_cd = P⁻¹ [ P_il (A_i B_l)_cd ]_il      k by k, one block for each entry of A B
//!
//! which is (A B)_cd times the identity where A and B are the same at all nodes, and near it otherwise:
//! such blocks are eliminated without pivoting, as A B itself would be, at k³ times the cost. They are kept
//! column by column, so that a product with a vector adds columns, and as the factors of L D U: what one step
//! of a solve leaves for the next is then a single product.
//!
//! Loops go up to k, the number of nodes, in memory for K: [`at_nodes`](crate::at_nodes).
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::choice::{MOST_NODES, MOST_UPDATES};
use super::fill::EliminationPlan;
use super::product::Pairs;
use super::{Lu, Matrix, Pattern, Singular};
use crate::real::{Real, Scalar};
use crate::simd::dispatch_simd;
use std::sync::Arc;

/// Pivots below this fraction of what stood in their place are roundoff.
const TINY: f64 = 1e3 * f64::EPSILON;

/// Runs `$body` with `$k` equal to `$nodes` and the constant `$K` no less: K itself for one member, so that loops over
/// the nodes are unrolled, and [`MOST_NODES`] for several, where each of their operations is a vector already.
#[macro_export]
macro_rules! at_nodes {
    ($R:ty, $nodes:expr, ($K:ident, $k:ident) => $body:expr) => {
        $crate::at_nodes!(@ $R, $nodes, $K, $k, $body, 1 2 3 4 5 6 7 8)
    };
    (@ $R:ty, $nodes:expr, $K:ident, $k:ident, $body:expr, $($size:literal)*) => {
        if <$R as $crate::real::Scalar>::IS_SINGLE {
            match $nodes {
                $($size => { const $K: usize = $size; let $k = $K; $body })*
                more => unreachable!("{more} nodes"),
            }
        } else {
            const $K: usize = $crate::linalg::choice::MOST_NODES;
            let $k = $nodes.min($K);
            $body
        }
    };
}

/// The entries of A and B whose product each value of the matrix is a sum of, and the order of elimination.
#[derive(Clone, Debug)]
pub struct GramPlan {
    pairs: Pairs,
    plan: EliminationPlan,
}

impl GramPlan {
    /// The plan for A and B of these patterns; `None` where fill-in would be large.
    ///
    /// # Panics
    /// When A has not as many columns as B has rows.
    pub fn new(a: &Pattern, b: &Pattern) -> Option<Self> {
        let m = a.shape().0;
        let (places, pairs) = Pairs::new(a, b);
        let mut couplings = places.clone();
        couplings.extend(places.iter().map(|(row, col)| (*col, *row)));
        couplings.extend((0..m).map(|row| (row, row)));
        couplings.sort_unstable();
        couplings.dedup();
        let pattern = |entries| Pattern {
            rows: m,
            cols: m,
            entries,
        };
        let plan = EliminationPlan::new(&pattern(couplings), MOST_UPDATES)?;
        let slots = plan.slots(&pattern(places));
        Some(Self {
            pairs: pairs.moved(&slots, plan.places()),
            plan,
        })
    }
}

/// The matrix, factored. Values of A and B, and vectors, stand node by node within an entry.
#[derive(Clone, Debug)]
pub struct NodeGram<R = f64> {
    nodes: usize,
    plan: Arc<GramPlan>,
    /// P⁻¹, and (P⁻¹)_ij P_jl with i the fastest and l the slowest.
    inverse: Matrix,
    weights: Vec<f64>,
    values: Vec<R>,
    scale: Vec<R>,
    x: Vec<R>,
}

impl<R: Real> NodeGram<R> {
    /// Memory for A and B of these patterns and the weights P; `None` where fill-in would be large or
    /// nodes are many.
    ///
    /// # Panics
    /// When P is singular, or A has not as many columns as B has rows.
    pub fn new(a: &Pattern, b: &Pattern, weights: &Matrix) -> Option<Self> {
        Self::with(Arc::new(GramPlan::new(a, b)?), weights)
    }

    /// The same with a plan that is there already.
    ///
    /// # Panics
    /// When P is singular.
    pub fn with(plan: Arc<GramPlan>, weights: &Matrix) -> Option<Self> {
        let nodes = weights.rows();
        if nodes > MOST_NODES {
            return None;
        }
        let inverse = inverse(weights);
        let weigh = |i: usize, j: usize, l: usize| inverse[(i, j)] * weights[(j, l)];
        let each = |l| (0..nodes).flat_map(move |j| (0..nodes).map(move |i| (i, j, l)));
        let (m, places) = (plan.plan.order.len(), plan.plan.places());
        Some(Self {
            nodes,
            weights: (0..nodes)
                .flat_map(each)
                .map(|(i, j, l)| weigh(i, j, l))
                .collect(),
            values: vec![R::splat(0.0); places * nodes * nodes],
            scale: vec![R::splat(0.0); m],
            x: vec![R::splat(0.0); m * nodes],
            inverse,
            plan,
        })
    }

    /// Factors the matrix of A and B with these values.
    ///
    /// # Errors
    /// The first row of A that depends on those eliminated before it.
    ///
    /// # Panics
    /// When there are fewer values than entries.
    pub fn factor(&mut self, a: &[R], b: &[R]) -> Result<(), Singular> {
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd::<R, _>(#[inline(always)] || {
            self.multiply::<K>(k, a, b);
            self.eliminate::<K>(k)
        }))
    }

    /// Solves in place: `b` has the right-hand side of the matrix without P⁻¹.
    ///
    /// # Panics
    /// When `b` is too short.
    pub fn solve(&mut self, b: &mut [R]) {
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd::<R, _>(#[inline(always)] || self.substitute::<K>(k, b)));
    }

    #[inline(always)]
    fn multiply<const K: usize>(&mut self, k: usize, a: &[R], b: &[R]) {
        let (mut sum, mut column) = (zero::<R, K>(), [R::splat(0.0); K]);
        for (block, pairs) in self
            .values
            .chunks_exact_mut(k * k)
            .zip(self.plan.pairs.each())
        {
            clear(k, &mut sum);
            for (i, j) in pairs {
                add_outer(
                    k,
                    &mut sum,
                    at::<R, K>(k, a, *i as usize),
                    at::<R, K>(k, b, *j as usize),
                );
            }
            for l in 0..k {
                column[..k].fill(R::splat(0.0));
                for j in 0..k {
                    let weights = &self.weights[(l * k + j) * k..][..k];
                    for i in 0..k {
                        column[i] += sum[l][j] * weights[i];
                    }
                }
                at_mut::<R, K>(k, block, l).copy_from_slice(&column[..k]);
            }
        }
    }

    #[inline(always)]
    fn eliminate<const K: usize>(&mut self, k: usize) -> Result<(), Singular> {
        let plan = &self.plan.plan;
        let (m, count) = (plan.order.len(), plan.neighbours.len());
        let values = &mut self.values[..];
        for (scale, block) in self.scale.iter_mut().zip(values.chunks_exact(k * k)) {
            *scale = block[0].map(f64::abs);
        }
        let [mut inverse, mut factor, mut other, mut product] = [zero::<R, K>(); 4];
        let (mut targets, mut start) = (&plan.targets[..], 0);
        for (step, end) in plan.starts[1..].iter().enumerate() {
            let (at, degree) = (start..*end as usize, *end as usize - start);
            start = at.end;
            read(k, values, step, &mut inverse);
            if !invert(k, &mut inverse, self.scale[step]) {
                let column = plan.order[step] as usize;
                return Err(Singular { column });
            }
            write(k, values, step, &inverse);
            for row in at.clone() {
                let (now, rest) = targets.split_at(degree);
                targets = rest;
                read(k, values, m + row, &mut other);
                times(k, &other, &inverse, &mut factor);
                write(k, values, m + row, &factor);
                for (col, target) in at.clone().zip(now) {
                    read(k, values, m + count + col, &mut other);
                    subtract_product(k, values, *target as usize, &factor, &other);
                }
            }
            for col in at {
                read(k, values, m + count + col, &mut other);
                times(k, &inverse, &other, &mut product);
                write(k, values, m + count + col, &product);
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn substitute<const K: usize>(&mut self, k: usize, b: &mut [R]) {
        let plan = &self.plan.plan;
        let (m, count) = (plan.order.len(), plan.neighbours.len());
        let (diagonal, others) = self.values.split_at(m * k * k);
        let (lower, upper) = others.split_at(count * k * k);
        let x = &mut self.x[..];
        let inverse = self.inverse.flat();
        for (x, unknown) in x.chunks_exact_mut(k).zip(&plan.order) {
            let b = at::<R, K>(k, b, *unknown as usize);
            for (x, weights) in x.iter_mut().zip(inverse.chunks_exact(k)) {
                let mut sum = R::splat(0.0);
                for j in 0..k {
                    sum += b[j] * weights[j];
                }
                *x = sum;
            }
        }
        let (mut value, mut product) = ([R::splat(0.0); K], [R::splat(0.0); K]);
        let mut start = 0;
        for (step, end) in plan.starts[1..].iter().enumerate() {
            value[..k].copy_from_slice(at::<R, K>(k, x, step));
            for place in start..*end as usize {
                let row = plan.neighbours[place] as usize;
                apply(k, block_at::<R, K>(k, lower, place), &value, &mut product);
                subtract(k, at_mut::<R, K>(k, x, row), &product);
            }
            start = *end as usize;
            apply(k, block_at::<R, K>(k, diagonal, step), &value, &mut product);
            at_mut::<R, K>(k, x, step).copy_from_slice(&product[..k]);
        }
        for (step, unknown) in plan.order.iter().enumerate().rev() {
            value[..k].copy_from_slice(at::<R, K>(k, x, step));
            let end = start;
            start = plan.starts[step] as usize;
            for place in start..end {
                let col = plan.neighbours[place] as usize;
                apply(
                    k,
                    block_at::<R, K>(k, upper, place),
                    at::<R, K>(k, x, col),
                    &mut product,
                );
                subtract(k, &mut value, &product);
            }
            at_mut::<R, K>(k, x, step).copy_from_slice(&value[..k]);
            at_mut::<R, K>(k, b, *unknown as usize).copy_from_slice(&value[..k]);
        }
    }
}

/// The columns of a block, of which the first k numbers of the first k are used.
type Block<R, const K: usize> = [[R; K]; K];

#[inline(always)]
fn zero<R: Real, const K: usize>() -> Block<R, K> {
    [[R::splat(0.0); K]; K]
}

#[inline(always)]
fn clear<R: Real, const K: usize>(k: usize, block: &mut Block<R, K>) {
    for column in block.iter_mut().take(k) {
        column[..k].fill(R::splat(0.0));
    }
}

/// The k numbers in this place.
#[inline(always)]
pub(super) fn at<R: Scalar, const K: usize>(k: usize, values: &[R], place: usize) -> &[R] {
    if R::IS_SINGLE {
        &values.as_chunks::<K>().0[place] // a length known to the compiler
    } else {
        &values[place * k..(place + 1) * k]
    }
}

#[inline(always)]
fn at_mut<R: Scalar, const K: usize>(k: usize, values: &mut [R], place: usize) -> &mut [R] {
    if R::IS_SINGLE {
        &mut values.as_chunks_mut::<K>().0[place]
    } else {
        &mut values[place * k..(place + 1) * k]
    }
}

/// The k by k numbers in this place, column by column.
#[inline(always)]
fn block_at<R: Scalar, const K: usize>(k: usize, values: &[R], place: usize) -> &[R] {
    if R::IS_SINGLE {
        values.as_chunks::<K>().0[place * K..(place + 1) * K].as_flattened()
    } else {
        &values[place * k * k..(place + 1) * k * k]
    }
}

#[inline(always)]
fn block_at_mut<R: Scalar, const K: usize>(k: usize, values: &mut [R], place: usize) -> &mut [R] {
    if R::IS_SINGLE {
        values.as_chunks_mut::<K>().0[place * K..(place + 1) * K].as_flattened_mut()
    } else {
        &mut values[place * k * k..(place + 1) * k * k]
    }
}

#[inline(always)]
fn read<R: Real, const K: usize>(k: usize, values: &[R], place: usize, block: &mut Block<R, K>) {
    let columns = block_at::<R, K>(k, values, place).chunks_exact(k);
    for (out, column) in block.iter_mut().zip(columns) {
        out[..k].copy_from_slice(column);
    }
}

#[inline(always)]
fn write<R: Real, const K: usize>(k: usize, values: &mut [R], place: usize, block: &Block<R, K>) {
    let columns = block_at_mut::<R, K>(k, values, place).chunks_exact_mut(k);
    for (out, column) in columns.zip(block) {
        out.copy_from_slice(&column[..k]);
    }
}

#[inline(always)]
fn add_outer<R: Real, const K: usize>(k: usize, sum: &mut Block<R, K>, a: &[R], b: &[R]) {
    for l in 0..k {
        for i in 0..k {
            sum[l][i] += a[i] * b[l];
        }
    }
}

/// `out = A y`, with the columns of A one after another.
#[inline(always)]
fn apply<R: Real, const K: usize>(k: usize, columns: &[R], y: &[R], out: &mut [R; K]) {
    for i in 0..k {
        out[i] = columns[i] * y[0];
    }
    for l in 1..k {
        for i in 0..k {
            out[i] += columns[l * k + i] * y[l];
        }
    }
}

/// `out = A y`, A being a block.
#[inline(always)]
fn apply_block<R: Real, const K: usize>(k: usize, a: &Block<R, K>, y: &[R; K], out: &mut [R; K]) {
    for i in 0..k {
        out[i] = a[0][i] * y[0];
    }
    for l in 1..k {
        for i in 0..k {
            out[i] += a[l][i] * y[l];
        }
    }
}

/// `x -= y`
#[inline(always)]
fn subtract<R: Real, const K: usize>(k: usize, x: &mut [R], y: &[R; K]) {
    for i in 0..k {
        x[i] -= y[i];
    }
}

/// `out = A B`
#[inline(always)]
fn times<R: Real, const K: usize>(
    k: usize,
    a: &Block<R, K>,
    b: &Block<R, K>,
    out: &mut Block<R, K>,
) {
    for l in 0..k {
        apply_block(k, a, &b[l], &mut out[l]);
    }
}

/// Subtracts `A B` from the block in this place.
#[inline(always)]
fn subtract_product<R: Real, const K: usize>(
    k: usize,
    values: &mut [R],
    place: usize,
    a: &Block<R, K>,
    b: &Block<R, K>,
) {
    let mut product = [R::splat(0.0); K];
    let columns = block_at_mut::<R, K>(k, values, place).chunks_exact_mut(k);
    for (column, b) in columns.zip(b) {
        apply_block(k, a, b, &mut product);
        subtract(k, column, &product);
    }
}

/// Inverts a block whose diagonal dominates; false where a pivot is roundoff of `scale`.
#[inline(always)]
fn invert<R: Real, const K: usize>(k: usize, a: &mut Block<R, K>, scale: R) -> bool {
    for p in 0..k {
        let pivot = a[p][p];
        let is_fine = |member| {
            let (pivot, scale): (f64, f64) = (pivot.member(member), scale.member(member));
            pivot.abs() > TINY * scale && pivot.is_finite()
        };
        if !(0..R::MEMBERS).all(is_fine) {
            return false;
        }
        let inverse = R::splat(1.0) / pivot;
        a[p][p] = R::splat(1.0);
        for i in 0..k {
            a[p][i] *= inverse;
        }
        let pivot_column = a[p];
        for l in 0..k {
            if l != p {
                let factor = a[l][p];
                a[l][p] = R::splat(0.0);
                for i in 0..k {
                    a[l][i] -= factor * pivot_column[i];
                }
            }
        }
    }
    true
}

fn inverse(matrix: &Matrix) -> Matrix {
    let n = matrix.rows();
    let mut lu = Lu::new(n);
    lu.matrix_mut().flat_mut().copy_from_slice(matrix.flat());
    lu.factor().expect("weights of nodes are independent");
    let mut inverse = Matrix::zeros(n, n);
    for col in 0..n {
        let mut x = vec![0.0; n];
        x[col] = 1.0;
        lu.solve(&mut x);
        for (row, x) in x.iter().enumerate() {
            inverse[(row, col)] = *x;
        }
    }
    inverse
}
