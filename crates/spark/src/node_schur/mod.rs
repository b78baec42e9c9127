//! Node Schur: the multipliers first, by the k m equations that are left when the stages are eliminated with h² terms
//! dropped but g_y and r_λ kept at their own nodes:
//!
//!     S_il = (Σ_j ā_ij â_jl) G_i B R_l     i = 1..k,  l = 0..k−1,   B = v_z p_z⁻¹
//!
//! with G_i = g_y and R_l = r_λ at nodes i and l, taken where the iteration starts, and B at its middle stage. Errors
//! shrink by O(h²) a correction for constant B and forces without z, else by O(h). With Λ = h λ it is O(1) as h → 0.
//! `reactions` improves corrections that r_y makes slow.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

mod equations;
mod linear;
mod reactions;

use super::sparse_schur::SparseNodeSchur;
use super::stages::{Stages, Unknowns};
pub(super) use linear::LinearSchur;
use liouville_base::linalg::choice::{LARGEST_DENSE_INVERSE_MASS_RT, LARGEST_DENSE_NODE_SCHUR};
use liouville_base::linalg::{Lu, Matrix, Singular, add_scaled, as_is, combine, copy, copy_scaled};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_problem::{Mass, Mechanical, Model, Step, add_product};
use reactions::Reactions;
use std::sync::Arc;

/// The blocks and the factored Schur complement.
#[derive(Clone, Debug)]
pub(super) struct NodeSchur<R = f64> {
    problem: Arc<Mechanical>,
    mass: Mass<R>,
    /// ā without its first row, which is zero, and â without its last column, and ā â.
    a_bar: Matrix,
    a_hat: Matrix,
    product: Matrix,
    g_y: Matrix<R>,
    r_lam: Matrix<R>,
    matrix: Schur<R>,
    velocity: Matrix<R>,
    node_velocity: Matrix<R>,
    d_lam: Vec<R>,
    impulse: Matrix<R>,
    d_z: Matrix<R>,
    d_v: Matrix<R>,
    reactions: Reactions<R>,
    /// Unknowns of members that take no further corrections.
    kept: Option<Box<Unknowns<R>>>,
}

/// S, factored.
#[derive(Clone, Debug)]
enum Schur<R> {
    Dense {
        inverse_mass_rt: Vec<Matrix<R>>,
        lu: Lu<R>,
    },
    Sparse(Box<SparseNodeSchur<R>>),
    /// Neither sparse nor small: full Newton is faster.
    Missing,
}

/// Residuals of the stage equations: of momenta, of velocities, and of g at the nodes.
#[derive(Clone, Copy)]
struct Residuals<'a, R> {
    momentum: &'a Matrix<R>,
    velocity: &'a Matrix<R>,
    g: &'a Matrix<R>,
}

impl<R: Real> NodeSchur<R> {
    pub(super) fn new(model: &Model<R>, stages: &Stages<R>) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let at = &model.problem.patterns;
        let (a_bar, a_hat) = (&stages.tableau.a_bar, &stages.tableau.a_hat);
        let product = Matrix::from_fn(k, k, |i, l| {
            (0..s).map(|j| a_bar[(i + 1, j)] * a_hat[(j, l)]).sum()
        });
        let mass = Mass::new(model);
        let matrix = match SparseNodeSchur::new(&model.problem, &mass, &product) {
            Some(sparse) => Schur::Sparse(Box::new(sparse)),
            None if k * m > LARGEST_DENSE_NODE_SCHUR
                || k * m * n > LARGEST_DENSE_INVERSE_MASS_RT =>
            {
                Schur::Missing
            }
            None => Schur::Dense {
                inverse_mass_rt: vec![Matrix::zeros(m, n); k],
                lu: Lu::new(k * m),
            },
        };
        Self {
            problem: model.problem.clone(),
            mass,
            product,
            a_bar: Matrix::from_fn(k, s, |i, j| a_bar[(i + 1, j)]),
            a_hat: Matrix::from_fn(s, k, |i, l| a_hat[(i, l)]),
            g_y: Matrix::zeros(k + 1, at.g_y.len()),
            r_lam: Matrix::zeros(k + 1, at.r_lam.len()),
            matrix,
            velocity: Matrix::zeros(s, n),
            node_velocity: Matrix::zeros(k, n),
            d_lam: vec![R::splat(0.0); k * m],
            impulse: Matrix::zeros(k, n),
            d_z: Matrix::zeros(s, n),
            d_v: Matrix::zeros(s, n),
            reactions: Reactions::new((k, at.r_y.len()), &Matrix::zeros(s, n)),
            kept: (!R::IS_SINGLE).then(|| Box::new(stages.unknowns.clone())),
        }
    }

    /// Whether there is a matrix to solve with.
    pub(super) fn has_matrix(&self) -> bool {
        !matches!(self.matrix, Schur::Missing)
    }

    /// Finds the displacements −h b_j (B R2_j + R1_j), below the last bit of V_j, that the residuals still imply.
    pub(super) fn find_lost_displacements(&mut self, stages: &mut Stages<R>, step: Step<R>) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                stages.subtract_impulses(step);
                for j in 0..stages.tableau.stages {
                    let u = self.velocity.row_mut(j);
                    copy(u, stages.momentum_residual.row(j));
                    self.mass.solve_velocity(u);
                    add_scaled(u, 1.0, stages.velocity_residual.row(j));
                    let weight = -step.h * stages.tableau.b[j];
                    copy_scaled(stages.lost_displacements.row_mut(j), weight, u);
                }
            },
        );
    }

    /// Factors S with the blocks there are.
    #[inline(always)]
    fn factor(&mut self) -> Result<(), Singular> {
        let (inverse_mass_rt, lu) = match &mut self.matrix {
            Schur::Sparse(sparse) => return sparse.factor(&self.mass, &self.g_y, &self.r_lam),
            Schur::Dense {
                inverse_mass_rt,
                lu,
            } => (inverse_mass_rt, lu),
            Schur::Missing => return Err(Singular { column: 0 }),
        };
        let (at, m) = (&self.problem.patterns, self.problem.m);
        lu.matrix_mut().clear();
        for (l, inverse_mass_rt) in inverse_mass_rt.iter_mut().enumerate() {
            let r_lam = self.r_lam.row(l);
            self.mass.inverse_mass_rt(&at.r_lam, r_lam, inverse_mass_rt);
            for k in 0..self.product.rows() {
                let (g_y, corner) = (self.g_y.row(k + 1), (k * m, l * m));
                let factor = self.product[(k, l)];
                add_product(
                    &at.g_y,
                    g_y,
                    factor,
                    inverse_mass_rt,
                    lu.matrix_mut(),
                    corner,
                );
            }
        }
        lu.factor()
    }
}

impl<R: Real> NodeSchur<R> {
    /// Corrections dΛ, dZ and dV for these residuals.
    #[inline(always)]
    fn solve(&mut self, of: Residuals<R>, h: f64) {
        if self.problem.m > 0 {
            self.solve_multipliers(of, h);
        } else {
            self.combine_impulses(of);
        }
        self.solve_stages(of);
    }

    /// dΛ, by the constraints g on the velocities B R2_j + R1_j of the residuals.
    #[inline(always)]
    fn solve_multipliers(&mut self, of: Residuals<R>, h: f64) {
        let (nodes, m) = (self.product.rows(), self.problem.m);
        let at = &self.problem.patterns;
        for j in 0..self.velocity.rows() {
            let u = self.velocity.row_mut(j);
            copy(u, of.momentum.row(j));
            self.mass.solve_velocity(u);
            if at.v_z.is_some() {
                add_scaled(u, 1.0, of.velocity.row(j));
            }
        }
        let lu = match &mut self.matrix {
            Schur::Dense { lu, .. } => lu,
            Schur::Sparse(sparse) => {
                sparse.solve(
                    (&self.a_bar, &self.a_hat),
                    (&self.velocity, of.momentum),
                    (of.g, h),
                    &mut self.d_lam,
                    &mut self.d_z,
                );
                return;
            }
            Schur::Missing => return,
        };
        combine(
            self.node_velocity.flat_mut(),
            &self.a_bar,
            &self.velocity,
            as_is,
        );
        for k in 0..nodes {
            let out = &mut self.d_lam[k * m..(k + 1) * m];
            for (out, g) in out.iter_mut().zip(of.g.row(k + 1)) {
                *out = -*g / R::splat(h);
            }
            at.g_y
                .multiply_add(self.g_y.row(k + 1), 1.0, self.node_velocity.row(k), out);
        }
        lu.solve(&mut self.d_lam);
        self.impulse.clear();
        for l in 0..nodes {
            let (d_lam, r_lam) = (&self.d_lam[l * m..(l + 1) * m], self.r_lam.row(l));
            at.r_lam
                .multiply_add(r_lam, 1.0, d_lam, self.impulse.row_mut(l));
        }
        self.combine_impulses(of);
    }

    /// Σ â_il R_l dΛ_l − R2_i
    #[inline(always)]
    fn combine_impulses(&mut self, of: Residuals<R>) {
        let residual = of.momentum;
        combine(
            self.d_z.flat_mut(),
            &self.a_hat,
            &self.impulse,
            #[inline(always)]
            |i, k, sums| {
                let residual = &residual.row(i)[k..k + sums.len()];
                for (sum, residual) in sums.iter_mut().zip(residual) {
                    *sum -= *residual;
                }
            },
        );
    }

    /// dZ_i = p_z⁻¹ (Σ â_il R_l dΛ_l − R2_i), dV_i = v_z dZ_i − R1_i
    #[inline(always)]
    fn solve_stages(&mut self, of: Residuals<R>) {
        if self.problem.patterns.v_z.is_none() {
            // R1 is zero, and dV is dZ
            for i in 0..self.d_z.rows() {
                self.mass.solve(self.d_z.row_mut(i));
            }
            return;
        }
        for i in 0..self.d_z.rows() {
            let (d_z, d_v) = (self.d_z.row_mut(i), self.d_v.row_mut(i));
            self.mass.solve(d_z);
            for (d_v, residual) in d_v.iter_mut().zip(of.velocity.row(i)) {
                *d_v = -*residual;
            }
            self.mass.add_velocity(d_z, d_v);
        }
    }
}
