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
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::choice::{MOST_NODES, MOST_UPDATES, MOST_WIDE_NODES};
use super::fill::EliminationPlan;
use super::product::Pairs;
use super::{Lu, Matrix, Pattern, Singular};
use crate::real::Real;
use crate::simd::dispatch_simd;
use std::array::from_fn;

/// Pivots below this fraction of what stood in their place are roundoff.
const TINY: f64 = 1e3 * f64::EPSILON;

/// Runs `$body` with the constant `$K` equal to `$k`.
#[macro_export]
macro_rules! at_size {
    ($k:expr, $K:ident => $body:expr) => {
        $crate::at_size!(@ $k, $K, $body, 1 2 3 4 5 6 7 8)
    };
    (@ $k:expr, $K:ident, $body:expr, $($size:literal)*) => {
        match $k {
            $($size => { const $K: usize = $size; $body })*
            more => unreachable!("{more} nodes"),
        }
    };
}

/// The matrix, factored. Values of A and B, and vectors, stand node by node within an entry.
#[derive(Clone, Debug)]
pub struct NodeGram<R = f64> {
    nodes: usize,
    /// The entries of A and B whose product each value is a sum of.
    pairs: Pairs,
    /// P⁻¹, and (P⁻¹)_ij P_jl with i the fastest and l the slowest.
    inverse: Matrix,
    weights: Vec<f64>,
    plan: EliminationPlan,
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
        let (nodes, m) = (weights.rows(), a.shape().0);
        if nodes > MOST_NODES {
            return None;
        }
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
        let inverse = inverse(weights);
        let weigh = |i: usize, j: usize, l: usize| inverse[(i, j)] * weights[(j, l)];
        let each = |l| (0..nodes).flat_map(move |j| (0..nodes).map(move |i| (i, j, l)));
        Some(Self {
            nodes,
            pairs: pairs.moved(&slots, plan.places()),
            weights: (0..nodes)
                .flat_map(each)
                .map(|(i, j, l)| weigh(i, j, l))
                .collect(),
            values: vec![R::splat(0.0); plan.places() * nodes * nodes],
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
        at_size!(self.nodes, K => dispatch_simd_nodes::<R, K, _>(#[inline(always)] || {
            self.multiply::<K>(a, b);
            self.eliminate::<K>()
        }))
    }

    /// Solves in place: `b` has the right-hand side of the matrix without P⁻¹.
    ///
    /// # Panics
    /// When `b` is too short.
    pub fn solve(&mut self, b: &mut [R]) {
        at_size!(self.nodes, K => dispatch_simd_nodes::<R, K, _>(#[inline(always)] || self.substitute::<K>(b)));
    }

    #[inline(always)]
    fn multiply<const K: usize>(&mut self, a: &[R], b: &[R]) {
        let (a, b) = (a.as_chunks::<K>().0, b.as_chunks::<K>().0);
        let values = self.values.as_chunks_mut::<K>().0;
        let weight = |l, j, i| self.weights[(l * K + j) * K + i];
        let weights: [Block<f64, K>; K] = from_fn(|l| from_fn(|j| from_fn(|i| weight(l, j, i))));
        for (block, pairs) in values.chunks_exact_mut(K).zip(self.pairs.each()) {
            let mut sum = [[R::splat(0.0); K]; K];
            for (i, j) in pairs {
                add_outer(&mut sum, &a[*i as usize], &b[*j as usize]);
            }
            for l in 0..K {
                let mut column = [R::splat(0.0); K];
                for j in 0..K {
                    for i in 0..K {
                        column[i] += sum[l][j] * weights[l][j][i];
                    }
                }
                block[l] = column;
            }
        }
    }

    #[inline(always)]
    fn eliminate<const K: usize>(&mut self) -> Result<(), Singular> {
        let plan = &self.plan;
        let (m, count) = (plan.order.len(), plan.neighbours.len());
        let values = self.values.as_chunks_mut::<K>().0;
        for (scale, block) in self.scale.iter_mut().zip(values.chunks_exact(K)) {
            *scale = block[0][0].map(f64::abs);
        }
        let (mut targets, mut start) = (&plan.targets[..], 0);
        for (step, end) in plan.starts[1..].iter().enumerate() {
            let (at, degree) = (start..*end as usize, *end as usize - start);
            start = at.end;
            let Some(inverse) = inverted(block(values, step), self.scale[step]) else {
                let column = plan.order[step] as usize;
                return Err(Singular { column });
            };
            put(values, step, inverse);
            for row in at.clone() {
                let (now, rest) = targets.split_at(degree);
                targets = rest;
                let factor = times(&block(values, m + row), &inverse);
                put(values, m + row, factor);
                for (col, target) in at.clone().zip(now) {
                    let other = block(values, m + count + col);
                    subtract_product(values, *target as usize, &factor, &other);
                }
            }
            for col in at {
                let scaled = times(&inverse, &block(values, m + count + col));
                put(values, m + count + col, scaled);
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn substitute<const K: usize>(&mut self, b: &mut [R]) {
        let plan = &self.plan;
        let (m, count) = (plan.order.len(), plan.neighbours.len());
        let (diagonal, others) = self.values.as_chunks::<K>().0.split_at(m * K);
        let (lower, upper) = others.split_at(count * K);
        let (x, b) = (self.x.as_chunks_mut::<K>().0, b.as_chunks_mut::<K>().0);
        let rows: [[f64; K]; K] = from_fn(|i| from_fn(|j| self.inverse[(i, j)]));
        for (x, unknown) in x.iter_mut().zip(&plan.order) {
            let b = &b[*unknown as usize];
            *x = from_fn(|i| (0..K).fold(R::splat(0.0), |sum, j| sum + b[j] * rows[i][j]));
        }
        let mut start = 0;
        for (step, (end, inverse)) in plan.starts[1..]
            .iter()
            .zip(diagonal.chunks_exact(K))
            .enumerate()
        {
            let at = start..*end as usize;
            start = at.end;
            let value = x[step];
            let blocks = lower[at.start * K..at.end * K].chunks_exact(K);
            for (k, block) in plan.neighbours[at].iter().zip(blocks) {
                subtract(&mut x[*k as usize], block, &value);
            }
            x[step] = applied(inverse, &value);
        }
        for (step, unknown) in plan.order.iter().enumerate().rev() {
            let at = plan.starts[step] as usize..start;
            start = at.start;
            let mut value = x[step];
            let blocks = upper[at.start * K..at.end * K].chunks_exact(K);
            for (k, block) in plan.neighbours[at].iter().zip(blocks) {
                subtract(&mut value, block, &x[*k as usize]);
            }
            x[step] = value;
            b[*unknown as usize] = value;
        }
    }
}

/// Runs `f`, which is to be inlined, with wide registers where it works on several members at up to
/// [`MOST_WIDE_NODES`] nodes.
#[inline(always)]
pub fn dispatch_simd_nodes<R: Real, const K: usize, O>(f: impl FnOnce() -> O) -> O {
    if K <= MOST_WIDE_NODES {
        dispatch_simd::<R, _>(f)
    } else {
        f()
    }
}

/// The columns of a block.
type Block<R, const K: usize> = [[R; K]; K];

#[inline(always)]
fn block<R: Real, const K: usize>(columns: &[[R; K]], place: usize) -> Block<R, K> {
    let columns = &columns[place * K..(place + 1) * K];
    from_fn(|l| columns[l])
}

#[inline(always)]
fn put<R: Real, const K: usize>(columns: &mut [[R; K]], place: usize, block: Block<R, K>) {
    columns[place * K..(place + 1) * K].copy_from_slice(&block);
}

#[inline(always)]
fn add_outer<R: Real, const K: usize>(sum: &mut Block<R, K>, a: &[R; K], b: &[R; K]) {
    for l in 0..K {
        for i in 0..K {
            sum[l][i] += a[i] * b[l];
        }
    }
}

/// `A y`, A being the first columns.
#[inline(always)]
fn applied<R: Real, const K: usize>(columns: &[[R; K]], y: &[R; K]) -> [R; K] {
    let mut sum = columns[0].map(|x| x * y[0]);
    for (column, y) in columns[..K].iter().zip(y).skip(1) {
        for i in 0..K {
            sum[i] += column[i] * *y;
        }
    }
    sum
}

#[inline(always)]
fn times<R: Real, const K: usize>(a: &Block<R, K>, b: &Block<R, K>) -> Block<R, K> {
    from_fn(|l| applied(a, &b[l]))
}

#[inline(always)]
fn subtract_product<R: Real, const K: usize>(
    columns: &mut [[R; K]],
    place: usize,
    a: &Block<R, K>,
    b: &Block<R, K>,
) {
    for (column, b) in columns[place * K..(place + 1) * K].iter_mut().zip(b) {
        subtract(column, a, b);
    }
}

/// `x -= A y`, A being the first columns.
#[inline(always)]
fn subtract<R: Real, const K: usize>(x: &mut [R; K], columns: &[[R; K]], y: &[R; K]) {
    let product = applied(columns, y);
    for i in 0..K {
        x[i] -= product[i];
    }
}

/// The inverse of a block whose diagonal dominates; `None` where a pivot is roundoff of `scale`.
#[inline(always)]
fn inverted<R: Real, const K: usize>(mut a: Block<R, K>, scale: R) -> Option<Block<R, K>> {
    for p in 0..K {
        let pivot = a[p][p];
        let is_fine = |k| {
            let (pivot, scale): (f64, f64) = (pivot.member(k), scale.member(k));
            pivot.abs() > TINY * scale && pivot.is_finite()
        };
        if !(0..R::MEMBERS).all(is_fine) {
            return None;
        }
        let inverse = R::splat(1.0) / pivot;
        a[p][p] = R::splat(1.0);
        for x in &mut a[p] {
            *x *= inverse;
        }
        let pivot_row = a[p];
        for (i, row) in a.iter_mut().enumerate() {
            if i != p {
                let factor = row[p];
                row[p] = R::splat(0.0);
                for l in 0..K {
                    row[l] -= factor * pivot_row[l];
                }
            }
        }
    }
    Some(a)
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
