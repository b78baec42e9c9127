//! The matrix of node Schur of a large mechanism: as sparse as its couplings, with k by k blocks.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use liouville_base::at_nodes;
use liouville_base::linalg::choice::SPARSE_NODE_SCHUR;
use liouville_base::linalg::{Matrix, Singular};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd_long;
use liouville_problem::{Mass, Mechanical, SparseSchur};

/// `g_y` at the nodes 1..k, `r_λ` at the nodes 0..k−1, and the Schur complement between them.
#[derive(Clone, Debug)]
pub(super) struct SparseNodeSchur<R = f64> {
    nodes: usize,
    schur: SparseSchur<R>,
    multipliers: Vec<R>,
    /// Velocities at the nodes, then impulses from there.
    vectors: Vec<R>,
}

impl<R: Real> SparseNodeSchur<R> {
    /// Memory for this problem and ā â; `None` where dense matrices are as good, or there is much fill-in.
    pub(super) fn new(problem: &Mechanical, mass: &Mass<R>, product: &Matrix) -> Option<Self> {
        let (nodes, order) = (product.rows(), product.rows() * problem.m);
        let least = if problem.is_sparse() {
            SPARSE_NODE_SCHUR / 2
        } else {
            SPARSE_NODE_SCHUR
        };
        if order < least {
            return None;
        }
        Some(Self {
            nodes,
            schur: SparseSchur::new(problem, mass, product)?,
            multipliers: vec![R::splat(0.0); order],
            vectors: vec![R::splat(0.0); nodes * problem.n],
        })
    }

    /// Factors with these blocks, a row a node.
    pub(super) fn factor(
        &mut self,
        mass: &Mass<R>,
        g_y: &Matrix<R>,
        r_lam: &Matrix<R>,
    ) -> Result<(), Singular> {
        at_nodes!(R, self.nodes, (K, k) => self.schur.factor::<K>(
            k,
            mass,
            |i| g_y.row(i + 1),
            |l| r_lam.row(l),
        ))
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
        at_nodes!(R, self.nodes, (K, k) => {
            dispatch_simd_long::<R, _>(u.cols(), #[inline(always)] || self.apply_g::<K>(k, a_bar, u, g, h));
            self.schur.solve(&mut self.multipliers);
            dispatch_simd_long::<R, _>(u.cols(), #[inline(always)] || {
                self.apply_r::<K>(k, a_hat, residual, d_z);
                let m = self.multipliers.len() / k;
                for (l, d_lam) in d_lam.chunks_exact_mut(m).enumerate() {
                    for (out, lam) in d_lam.iter_mut().zip(self.multipliers.chunks_exact(k)) {
                        *out = lam[l];
                    }
                }
            });
        });
    }

    /// −g/h + `G_i` Σ ā_ij u_j
    #[inline(always)]
    fn apply_g<const K: usize>(
        &mut self,
        k: usize,
        a_bar: &Matrix,
        u: &Matrix<R>,
        g: &Matrix<R>,
        h: f64,
    ) {
        let (multipliers, vectors) = (&mut self.multipliers[..], &mut self.vectors[..]);
        let minus = -1.0 / h;
        for i in 0..k {
            for (out, g) in multipliers.chunks_exact_mut(k).zip(g.row(i + 1)) {
                out[i] = *g * minus;
            }
        }
        vectors.fill(R::splat(0.0));
        let mut weights = [0.0; K];
        for j in 0..u.rows() {
            for i in 0..k {
                weights[i] = a_bar[(i, j)];
            }
            for (out, u) in vectors.chunks_exact_mut(k).zip(u.row(j)) {
                for i in 0..k {
                    out[i] += *u * weights[i];
                }
            }
        }
        self.schur.g_y().add_product::<K>(k, vectors, multipliers);
    }

    /// Σ â_il R_l dΛ_l − residual
    #[inline(always)]
    fn apply_r<const K: usize>(
        &mut self,
        k: usize,
        a_hat: &Matrix,
        residual: &Matrix<R>,
        d_z: &mut Matrix<R>,
    ) {
        let vectors = &mut self.vectors[..];
        vectors.fill(R::splat(0.0));
        (self.schur.r_lam()).add_product::<K>(k, &self.multipliers, vectors);
        let mut weights = [0.0; K];
        for i in 0..d_z.rows() {
            for l in 0..k {
                weights[l] = a_hat[(i, l)];
            }
            let (vectors, residual) = (vectors.chunks_exact(k), residual.row(i));
            for ((out, v), residual) in d_z.row_mut(i).iter_mut().zip(vectors).zip(residual) {
                let mut sum = R::splat(0.0);
                for l in 0..k {
                    sum += v[l] * weights[l];
                }
                *out = sum - *residual;
            }
        }
    }

    /// ν from Sᵀ ν = b_l + R_lᵀ Σ â_il d_z_i, where `nu` is b, and Σ_i ā_ij G_iᵀ ν_i of each stage; the weights are
    /// those of â and ā, transposed.
    pub(super) fn solve_transposed(
        &mut self,
        (a_hat, a_bar): (&Matrix, &Matrix),
        d_z: &Matrix<R>,
        nu: &mut [R],
        moves: &mut Matrix<R>,
    ) {
        let m = nu.len() / self.nodes;
        at_nodes!(R, self.nodes, (K, k) => dispatch_simd_long::<R, _>(d_z.cols(), #[inline(always)] || {
            let (multipliers, vectors) = (&mut self.multipliers[..], &mut self.vectors[..]);
            for (l, nu) in nu.chunks_exact(m).enumerate() {
                for (out, nu) in multipliers.chunks_exact_mut(k).zip(nu) {
                    out[l] = *nu;
                }
            }
            vectors.fill(R::splat(0.0));
            for i in 0..d_z.rows() {
                for (out, x) in vectors.chunks_exact_mut(k).zip(d_z.row(i)) {
                    for l in 0..k {
                        out[l] += *x * a_hat[(l, i)];
                    }
                }
            }
            (self.schur.r_lam()).add_product_transposed::<K>(k, vectors, multipliers);
            self.schur.solve_transposed(multipliers);
            for (l, nu) in nu.chunks_exact_mut(m).enumerate() {
                for (out, nu) in nu.iter_mut().zip(multipliers.chunks_exact(k)) {
                    *out = nu[l];
                }
            }
            vectors.fill(R::splat(0.0));
            (self.schur.g_y()).add_product_transposed::<K>(k, multipliers, vectors);
            for j in 0..moves.rows() {
                for (out, v) in moves.row_mut(j).iter_mut().zip(vectors.chunks_exact(k)) {
                    let mut sum = R::splat(0.0);
                    for i in 0..k {
                        sum += v[i] * a_bar[(j, i)];
                    }
                    *out = sum;
                }
            }
        }));
    }
}
