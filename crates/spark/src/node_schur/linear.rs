//! The matrix of node Schur at a solution, to correct solutions of the linearised step with, and its transpose:
//!
//!     p_zᵀ η_j − v_zᵀ σ_j = a_j      −Σ_i â_il R_lᵀ η_i = b_l      σ_j + Σ_i ā_ij G_iᵀ ν_i = c_j
//!     Sᵀ ν = b_l + R_lᵀ Σ_i â_il p_z⁻ᵀ (a_i + v_zᵀ c_i)

use super::super::derivatives::Derivatives;
use super::super::stages::Stages;
use super::{NodeSchur, Residuals, Schur};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, as_is, combine, copy, copy_scaled};
use liouville_base::simd::dispatch_simd_long;
use liouville_problem::Model;

/// Node Schur of one linearised step. Vectors are in the order of full Newton: momenta and Z, constraints and Λ, and
/// where v is not z velocities and V.
#[derive(Clone, Debug)]
pub(crate) struct LinearSchur {
    inner: NodeSchur,
    /// ā and â transposed.
    a_bar: Matrix,
    a_hat: Matrix,
    /// Right-hand sides, their signs changed.
    momentum: Matrix,
    velocity: Matrix,
    g: Matrix,
}

impl LinearSchur {
    /// Memory for the linearised steps of a system; `None` where the matrix would be dense and large.
    pub(crate) fn new(model: &Model, stages: &Stages) -> Option<Self> {
        let inner = NodeSchur::new(model, stages);
        let transposed = |a: &Matrix| Matrix::from_fn(a.cols(), a.rows(), |i, j| a[(j, i)]);
        inner.has_matrix().then(|| Self {
            a_bar: transposed(&inner.a_bar),
            a_hat: transposed(&inner.a_hat),
            momentum: inner.d_z.clone(),
            velocity: inner.d_v.clone(),
            g: stages.g.clone(),
            inner,
        })
    }

    /// Factors the matrix with these derivatives, the mass in the middle of the step.
    pub(crate) fn factor(&mut self, of: &Derivatives) -> Result<(), StepError> {
        let (inner, middle) = (&mut self.inner, of.p_z.rows() / 2);
        let mass = &mut inner.mass;
        mass.set(of.p_z.row(middle), of.v_z.row(middle))?;
        if inner.problem.m == 0 {
            return Ok(());
        }
        copy(inner.g_y.flat_mut(), of.g_y.flat());
        copy(inner.r_lam.flat_mut(), of.r_lam.flat());
        inner.factor().map_err(|_| StepError::SingularNewton)
    }

    /// Solves in place.
    pub(crate) fn solve(&mut self, x: &mut [f64]) {
        let Self { inner, g, .. } = self;
        let (stages, m) = (self.momentum.flat().len(), inner.problem.m);
        let lam = stages..stages + inner.d_lam.len();
        copy_scaled(self.momentum.flat_mut(), -1.0, &x[..stages]);
        copy_scaled(&mut g.flat_mut()[m..], -1.0, &x[lam.clone()]);
        let has_velocity = x.len() > lam.end;
        if has_velocity {
            copy_scaled(self.velocity.flat_mut(), -1.0, &x[lam.end..]);
        }
        let residuals = Residuals {
            momentum: &self.momentum,
            velocity: &self.velocity,
            g,
        };
        dispatch_simd_long::<f64, _>(inner.problem.n, || inner.solve(residuals, 1.0));
        copy(&mut x[..stages], inner.d_z.flat());
        copy(&mut x[lam.clone()], &inner.d_lam);
        if has_velocity {
            copy(&mut x[lam.end..], inner.d_v.flat());
        }
    }

    /// Solves with the transposed matrix in place.
    pub(crate) fn solve_transposed(&mut self, x: &mut [f64]) {
        let Self { inner, .. } = self;
        let (n, m) = (inner.problem.n, inner.problem.m);
        let (eta, rest) = x.split_at_mut(self.momentum.flat().len());
        let (nu, sigma) = rest.split_at_mut(inner.d_lam.len());
        // d_z holds p_z⁻ᵀ (a + v_zᵀ c), then the part by ν
        copy(inner.d_z.flat_mut(), eta);
        for (i, sigma) in sigma.chunks_exact(n).enumerate() {
            (inner.mass).add_velocity_transposed(1.0, sigma, inner.d_z.row_mut(i));
        }
        for i in 0..inner.d_z.rows() {
            inner.mass.solve_transposed(inner.d_z.row_mut(i));
        }
        if m > 0 {
            self.solve_nodes(nu);
            let Self { inner, .. } = self;
            let moves = &self.velocity;
            if sigma.is_empty() {
                add_scaled(eta, -1.0, moves.flat());
            } else {
                add_scaled(sigma, -1.0, moves.flat());
            }
            let rows = eta.chunks_exact_mut(n).enumerate();
            for (i, eta) in rows {
                if let Some(sigma) = sigma.chunks_exact(n).nth(i) {
                    inner.mass.add_velocity_transposed(1.0, sigma, eta);
                }
                inner.mass.solve_transposed(eta);
            }
        } else {
            copy(eta, inner.d_z.flat());
        }
    }

    /// ν from b and the momenta in d_z, and Σ_i ā_ij G_iᵀ ν_i for each stage.
    fn solve_nodes(&mut self, nu: &mut [f64]) {
        let Self { inner, .. } = self;
        let (at, m) = (&inner.problem.patterns, inner.problem.m);
        let lu = match &mut inner.matrix {
            Schur::Dense { lu, .. } => lu,
            Schur::Sparse(sparse) => {
                let weights = (&self.a_hat, &self.a_bar);
                return sparse.solve_transposed(weights, &inner.d_z, nu, &mut self.velocity);
            }
            Schur::Missing => return,
        };
        combine(inner.impulse.flat_mut(), &self.a_hat, &inner.d_z, as_is);
        for (l, nu) in nu.chunks_exact_mut(m).enumerate() {
            at.r_lam
                .multiply_add_transposed(inner.r_lam.row(l), 1.0, inner.impulse.row(l), nu);
        }
        lu.solve_transposed(nu);
        inner.node_velocity.clear();
        for (k, nu) in nu.chunks_exact(m).enumerate() {
            let out = inner.node_velocity.row_mut(k);
            at.g_y
                .multiply_add_transposed(inner.g_y.row(k + 1), 1.0, nu, out);
        }
        combine(
            self.velocity.flat_mut(),
            &self.a_bar,
            &inner.node_velocity,
            as_is,
        );
    }
}
