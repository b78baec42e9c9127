//! The matrix of node Schur of a large mechanism: as sparse as its couplings, k by k blocks of each.

use crate::linalg::{Matrix, NodeGram, Pattern, Singular, at_size};
use crate::problem::mechanical::{Compliance, Mass, Mechanical};
use crate::real::Real;

/// From this order on, the sparse matrix is tried.
const LARGE: usize = 24;

/// `g_y` at the nodes 1..k, `r_λ` at the nodes 0..k−1, node by node within an entry, and the Schur
/// complement between them.
#[derive(Clone, Debug)]
pub(super) struct SparseSchur<R = f64> {
    nodes: usize,
    g_at: Vec<(u32, u32)>,
    r_at: Vec<(u32, u32)>,
    g_y: Vec<R>,
    r_lam: Vec<R>,
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
        if nodes * m < LARGE {
            return None;
        }
        let at = &problem.patterns;
        let compliance = Compliance::new(mass, &at.r_lam, nodes)?;
        let schur = NodeGram::new(&at.g_y, compliance.pattern(), product)?;
        Some(Self {
            nodes,
            g_at: short(&at.g_y),
            r_at: short(&at.r_lam),
            g_y: vec![R::splat(0.0); nodes * at.g_y.len()],
            r_lam: vec![R::splat(0.0); nodes * at.r_lam.len()],
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
            interleave::<R, K>(g_y, 1, &mut self.g_y);
            interleave::<R, K>(r_lam, 0, &mut self.r_lam);
        });
        let compliance = self.compliance.update(mass, &self.r_lam);
        self.schur.factor(&self.g_y, compliance)
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
            self.meet::<K>(a_bar, u, g, h);
            self.schur.solve(&mut self.multipliers);
            self.push::<K>(a_hat, residual, d_z);
            let m = self.multipliers.len() / K;
            for (c, lam) in self.multipliers.as_chunks::<K>().0.iter().enumerate() {
                for l in 0..K {
                    d_lam[l * m + c] = lam[l];
                }
            }
        });
    }

    /// −g/h + `G_i` Σ ā_ij u_j
    fn meet<const K: usize>(&mut self, a_bar: &Matrix, u: &Matrix<R>, g: &Matrix<R>, h: f64) {
        let multipliers = self.multipliers.as_chunks_mut::<K>().0;
        let vectors = self.vectors.as_chunks_mut::<K>().0;
        let minus = -1.0 / h;
        for i in 0..K {
            for (out, g) in multipliers.iter_mut().zip(g.row(i + 1)) {
                out[i] = *g * minus;
            }
            let (first, rest) = a_bar.row(i).split_at(1);
            for (out, u) in vectors.iter_mut().zip(u.row(0)) {
                out[i] = *u * first[0];
            }
            for (j, weight) in rest.iter().enumerate() {
                for (out, u) in vectors.iter_mut().zip(u.row(j + 1)) {
                    out[i] += *u * *weight;
                }
            }
        }
        for ((row, col), g_y) in self.g_at.iter().zip(self.g_y.as_chunks::<K>().0) {
            let (out, v) = (&mut multipliers[*row as usize], &vectors[*col as usize]);
            for i in 0..K {
                out[i] += g_y[i] * v[i];
            }
        }
    }

    fn push<const K: usize>(&mut self, a_hat: &Matrix, residual: &Matrix<R>, d_z: &mut Matrix<R>) {
        let multipliers = self.multipliers.as_chunks::<K>().0;
        let vectors = self.vectors.as_chunks_mut::<K>().0;
        vectors.fill([R::splat(0.0); K]);
        for ((row, col), r_lam) in self.r_at.iter().zip(self.r_lam.as_chunks::<K>().0) {
            let (out, lam) = (&mut vectors[*row as usize], &multipliers[*col as usize]);
            for l in 0..K {
                out[l] += r_lam[l] * lam[l];
            }
        }
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

/// K rows from the `first` on, side by side entry by entry.
fn interleave<R: Real, const K: usize>(rows: &Matrix<R>, first: usize, out: &mut [R]) {
    let out = out.as_chunks_mut::<K>().0;
    for i in 0..K {
        for (out, value) in out.iter_mut().zip(rows.row(first + i)) {
            out[i] = *value;
        }
    }
}

#[allow(clippy::cast_possible_truncation)] // more coordinates would not fit in memory
fn short(pattern: &Pattern) -> Vec<(u32, u32)> {
    let entries = pattern.entries().iter();
    entries
        .map(|(row, col)| (*row as u32, *col as u32))
        .collect()
}
