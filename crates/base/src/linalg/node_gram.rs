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
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::choice::{MOST_NODES, MOST_UPDATES};
use super::fill::EliminationPlan;
use super::node_block::{
    add_outer, apply, apply_transposed, at, at_mut, block_at, clear, invert, read, subtract,
    subtract_product, times, write, zero,
};
use super::product::Pairs;
use super::{Matrix, Pattern, Singular, inverse};
use crate::real::{BATCH, Lanes, Real};
use crate::simd::dispatch_simd_long;
use std::sync::Arc;

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
                $($size => {
                    const $K: usize = $size;
                    #[allow(non_upper_case_globals)] // a variable would be captured by closures, and read there
                    const $k: usize = $K;
                    $body
                })*
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
    #[inline(never)]
    pub fn with(plan: Arc<GramPlan>, weights: &Matrix) -> Option<Self> {
        let nodes = weights.rows();
        if nodes > MOST_NODES {
            return None;
        }
        let inverse = inverse(weights).expect("weights of nodes are independent");
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
    #[inline(never)]
    pub fn factor(&mut self, a: &[R], b: &[R]) -> Result<(), Singular> {
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd_long::<R, _>(k * k, #[inline(always)] || {
            self.multiply::<K>(k, a, b);
            self.eliminate::<K>(k)
        }))
    }

    /// Solves in place: `b` has the right-hand side of the matrix without P⁻¹.
    ///
    /// # Panics
    /// When `b` is too short.
    pub fn solve(&mut self, b: &mut [R]) {
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd_long::<R, _>(k * k, #[inline(always)] || {
            self.gather::<K>(k, b, true);
            self.substitute::<K, false>(k);
            self.scatter::<K>(k, b, false);
        }));
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

    /// Solves with the transposed matrix in place, P included: Sᵀ x = b.
    ///
    /// # Panics
    /// When `b` is too short.
    pub fn solve_transposed(&mut self, b: &mut [R]) {
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd_long::<R, _>(k * k, #[inline(always)] || {
            self.gather::<K>(k, b, false);
            self.substitute::<K, true>(k);
            self.scatter::<K>(k, b, true);
        }));
    }

    /// Takes `b` in the order of elimination, times P⁻¹ where it `is_weighted`.
    #[inline(always)]
    fn gather<const K: usize>(&mut self, k: usize, b: &[R], is_weighted: bool) {
        let (order, inverse) = (&self.plan.plan.order, self.inverse.flat());
        for (x, unknown) in self.x.chunks_exact_mut(k).zip(order) {
            let b = at::<R, K>(k, b, *unknown as usize);
            if !is_weighted {
                x.copy_from_slice(b);
                continue;
            }
            for (x, weights) in x.iter_mut().zip(inverse.chunks_exact(k)) {
                let mut sum = R::splat(0.0);
                for j in 0..k {
                    sum += b[j] * weights[j];
                }
                *x = sum;
            }
        }
    }

    /// Puts the solution where its unknowns are, times P⁻ᵀ where it `is_weighted`.
    #[inline(always)]
    fn scatter<const K: usize>(&self, k: usize, b: &mut [R], is_weighted: bool) {
        let (order, inverse) = (&self.plan.plan.order, self.inverse.flat());
        for (x, unknown) in self.x.chunks_exact(k).zip(order) {
            let b = at_mut::<R, K>(k, b, *unknown as usize);
            if !is_weighted {
                b.copy_from_slice(x);
                continue;
            }
            b.fill(R::splat(0.0));
            for (x, weights) in x.iter().zip(inverse.chunks_exact(k)) {
                for j in 0..k {
                    b[j] += *x * weights[j];
                }
            }
        }
    }

    /// L, D and U in turn, or those of the transposed matrix: U and L change places.
    #[inline(always)]
    fn substitute<const K: usize, const TRANSPOSED: bool>(&mut self, k: usize) {
        let plan = &self.plan.plan;
        let (m, count) = (plan.order.len(), plan.neighbours.len());
        let (diagonal, others) = self.values.split_at(m * k * k);
        let (mut lower, mut upper) = others.split_at(count * k * k);
        if TRANSPOSED {
            (lower, upper) = (upper, lower);
        }
        let x = &mut self.x[..];
        let (mut value, mut product) = ([R::splat(0.0); K], [R::splat(0.0); K]);
        let mut start = 0;
        for (step, end) in plan.starts[1..].iter().enumerate() {
            value[..k].copy_from_slice(at::<R, K>(k, x, step));
            for place in start..*end as usize {
                let row = plan.neighbours[place] as usize;
                multiply::<R, K, TRANSPOSED>(k, lower, place, &value, &mut product);
                subtract(k, at_mut::<R, K>(k, x, row), &product);
            }
            start = *end as usize;
            multiply::<R, K, TRANSPOSED>(k, diagonal, step, &value, &mut product);
            at_mut::<R, K>(k, x, step).copy_from_slice(&product[..k]);
        }
        for step in (0..m).rev() {
            value[..k].copy_from_slice(at::<R, K>(k, x, step));
            let end = start;
            start = plan.starts[step] as usize;
            for place in start..end {
                let col = plan.neighbours[place] as usize;
                multiply::<R, K, TRANSPOSED>(k, upper, place, at::<R, K>(k, x, col), &mut product);
                subtract(k, &mut value, &product);
            }
            at_mut::<R, K>(k, x, step).copy_from_slice(&value[..k]);
        }
    }
}

/// `out = A y` with the block in this place, or `out = Aᵀ y`.
#[inline(always)]
fn multiply<R: Real, const K: usize, const TRANSPOSED: bool>(
    k: usize,
    values: &[R],
    place: usize,
    y: &[R],
    out: &mut [R; K],
) {
    let block = block_at::<R, K>(k, values, place);
    if TRANSPOSED {
        apply_transposed(k, block, y, out);
    } else {
        apply(k, block, y, out);
    }
}

crate::compiled!(R in [f64, Lanes<BATCH>] {
    NodeGram::<R>::with as fn(_, _) -> _,
    NodeGram::<R>::factor as fn(_, _, _) -> _,
});
