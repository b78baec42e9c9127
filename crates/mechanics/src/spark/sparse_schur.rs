//! The matrix of node Schur of a large mechanism: as sparse as its couplings, k by k blocks of each.

#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use crate::problem::{Compliance, Mass, Mechanical};
use liouville_base::at_size;
use liouville_base::linalg::{Matrix, NodeGram, NodeRows, Singular};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd_nested;

/// From this order on, the sparse matrix is tried, and from half of it on where most of `g_y` is zero. Measured
/// on plane chains, sparse over dense: 0.85 of a step at order 16, 0.77 at 20, 0.5 at 32; with 3 rods in space,
/// order 24, 0.63.
const LARGE: usize = 24;

/// `g_y` at the nodes 1..k, `r_λ` at the nodes 0..k−1, and the Schur complement between them.
#[derive(Clone, Debug)]
pub(super) struct SparseSchur<R = f64> {
    nodes: usize,
    g_y: NodeRows<R>,
    r_lam: NodeRows<R>,
    compliance: Compliance<R>,
    schur: NodeGram<R>,
    multipliers: Vec<R>,
    /// Velocities at the nodes, then impulses from there.
    vectors: Vec<R>,
}

impl<R: Real> SparseSchur<R> {
    /// Memory for this problem and ā â; `None` where dense matrices are as good, or there is much fill-in.
    pub(super) fn new(problem: &Mechanical, mass: &Mass<R>, product: &Matrix) -> Option<Self> {
        let (n, m, nodes) = (problem.n, problem.m, product.rows());
        let order = nodes * m;
        if order < LARGE && (2 * order < LARGE || !problem.is_sparse()) {
            return None;
        }
        let g_y = NodeRows::new(&problem.patterns.g_y, nodes);
        let r_lam = NodeRows::new(&problem.patterns.r_lam, nodes);
        let compliance = Compliance::new(mass, r_lam.pattern(), nodes)?;
        let schur = NodeGram::new(g_y.pattern(), compliance.pattern(), product)?;
        Some(Self {
            nodes,
            g_y,
            r_lam,
            compliance,
            schur,
            multipliers: vec![R::splat(0.0); nodes * m],
            vectors: vec![R::splat(0.0); nodes * n],
        })
    }

    /// Factors with these blocks, a row a node.
    pub(super) fn factor(
        &mut self,
        mass: &Mass<R>,
        g_y: &Matrix<R>,
        r_lam: &Matrix<R>,
    ) -> Result<(), Singular> {
        at_size!(self.nodes, K => {
            self.g_y.set::<K>(std::array::from_fn(|i| g_y.row(i + 1)));
            self.r_lam.set::<K>(std::array::from_fn(|l| r_lam.row(l)));
        });
        let compliance = self.compliance.update(mass, self.r_lam.values());
        self.schur.factor(self.g_y.values(), compliance)
    }

    /// dΛ that makes velocities `u` of the stages meet g, and the impulses R_l dΛ_l, whose combinations
    /// Σ â_il R_l dΛ_l less `residual` become `d_z`.
    pub(super) fn solve(
        &mut self,
        (a_bar, a_hat): (&Matrix, &Matrix),
        (u, residual): (&Matrix<R>, &Matrix<R>),
        (g, h): (&Matrix<R>, f64),
        d_lam: &mut [R],
        d_z: &mut Matrix<R>,
    ) {
        at_size!(self.nodes, K => {
            dispatch_simd_nested::<R, _>(u.cols(), #[inline(always)] || self.meet::<K>(a_bar, u, g, h));
            self.schur.solve(&mut self.multipliers);
            dispatch_simd_nested::<R, _>(u.cols(), #[inline(always)] || {
                self.push::<K>(a_hat, residual, d_z);
                let multipliers = self.multipliers.as_chunks::<K>().0;
                for (l, d_lam) in d_lam.chunks_exact_mut(multipliers.len()).enumerate() {
                    for (out, lam) in d_lam.iter_mut().zip(multipliers) {
                        *out = lam[l];
                    }
                }
            });
        });
    }

    /// −g/h + `G_i` Σ ā_ij u_j
    #[inline(always)]
    fn meet<const K: usize>(&mut self, a_bar: &Matrix, u: &Matrix<R>, g: &Matrix<R>, h: f64) {
        let multipliers = self.multipliers.as_chunks_mut::<K>().0;
        let vectors = self.vectors.as_chunks_mut::<K>().0;
        let g: [&[R]; K] = std::array::from_fn(|i| g.row(i + 1));
        let minus = -1.0 / h;
        for (c, out) in multipliers.iter_mut().enumerate() {
            *out = g.map(|g| g[c] * minus);
        }
        vectors.fill([R::splat(0.0); K]);
        for j in 0..u.rows() {
            let weights: [f64; K] = std::array::from_fn(|i| a_bar[(i, j)]);
            for (out, u) in vectors.iter_mut().zip(u.row(j)) {
                for i in 0..K {
                    out[i] += *u * weights[i];
                }
            }
        }
        self.g_y.multiply_add(vectors, multipliers);
    }

    #[inline(always)]
    fn push<const K: usize>(&mut self, a_hat: &Matrix, residual: &Matrix<R>, d_z: &mut Matrix<R>) {
        let multipliers = self.multipliers.as_chunks::<K>().0;
        let vectors = self.vectors.as_chunks_mut::<K>().0;
        vectors.fill([R::splat(0.0); K]);
        self.r_lam.multiply_add(multipliers, vectors);
        for i in 0..d_z.rows() {
            let weights: [f64; K] = std::array::from_fn(|l| a_hat[(i, l)]);
            let residual = residual.row(i);
            for ((out, v), residual) in d_z.row_mut(i).iter_mut().zip(&*vectors).zip(residual) {
                let mut sum = R::splat(0.0);
                for l in 0..K {
                    sum += v[l] * weights[l];
                }
                *out = sum - *residual;
            }
        }
    }
}
