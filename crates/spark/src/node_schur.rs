//! Node Schur: the multipliers first, by the k m equations that are left when the stages are eliminated with h² terms
//! dropped but g_y and r_λ kept at their own nodes:
//!
//!     S_il = (Σ_j ā_ij â_jl) G_i B R_l     i = 1..k,  l = 0..k−1,   B = v_z p_z⁻¹
//!
//! with G_i = g_y and R_l = r_λ at nodes i and l, taken where the iteration starts, and B at its middle stage. Errors
//! shrink by O(h²) a correction for constant B and forces without z, else by O(h). With Λ = h λ it is O(1) as h → 0.
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::probe;
use super::sparse_schur::SparseNodeSchur;
use super::stages::{Stages, Unknowns};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::choice::{LARGEST_DENSE_INVERSE_MASS_RT, LARGEST_DENSE_NODE_SCHUR};
use liouville_base::linalg::{
    Lu, Matrix, Singular, add_scaled, as_is, combine, copy, copy_scaled, max_norm,
};
use liouville_base::newton::{Equations, Stop};
use liouville_base::real::Real;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_problem::{Mass, Mechanical, Model, Step, add_product, diagnose_rank, finite};
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
    /// What has been found for members that take no further corrections.
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
    Missing, // neither sparse nor small: full Newton is the better way
}

/// The stage equations of one step, solved by node Schur.
pub(super) struct SchurEquations<'a, R = f64> {
    solver: &'a mut NodeSchur<R>,
    pub(super) stages: &'a mut Stages<R>,
    model: &'a mut Model<R>,
    pub(super) step: Step<'a, R>,
    is_linearized: bool,
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
            kept: (!R::IS_SINGLE).then(|| Box::new(stages.unknowns.clone())),
        }
    }

    /// Whether there is a matrix to solve with.
    pub(super) fn is_able(&self) -> bool {
        !matches!(self.matrix, Schur::Missing)
    }

    /// Finds the moves −h b_j (B R2_j + R1_j), below the last bit of V_j, that the residuals still ask for.
    pub(super) fn find_lost_moves(&mut self, stages: &mut Stages<R>, step: Step<R>) {
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
                    copy_scaled(stages.lost_moves.row_mut(j), weight, u);
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

    /// The equations of one step, still to be linearised.
    pub(super) fn start<'a>(
        &'a mut self,
        stages: &'a mut Stages<R>,
        model: &'a mut Model<R>,
        step: Step<'a, R>,
    ) -> SchurEquations<'a, R> {
        SchurEquations {
            solver: self,
            stages,
            model,
            step,
            is_linearized: false,
        }
    }
}

impl<R: Real> SchurEquations<'_, R> {
    fn linearize(&mut self) -> Result<(), StepError> {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.linearize_blocks(),
        )
    }

    #[inline(always)]
    fn linearize_blocks(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (nodes, m) = (stages.tableau.intervals, model.problem.m);
        let middle = stages.tableau.stages / 2;
        let t = stages.stage_time(*step, middle);
        solver.mass.update(
            model,
            t,
            stages.y.row(middle),
            stages.unknowns.z.row(middle),
        )?;
        if m == 0 {
            return Ok(());
        }
        let times = stages.node_times(*step);
        let mut blocks = model.nodes_blocks(times, &stages.node_y, &stages.unknowns.lam);
        for j in 0..=nodes {
            let t = times.at(j);
            let [g_y, r_lam] = blocks.at(j);
            finite(g_y, Quantity::Derivative, t)?;
            finite(r_lam, Quantity::Derivative, t)?;
            copy(solver.g_y.row_mut(j), g_y);
            copy(solver.r_lam.row_mut(j), r_lam);
        }
        solver.factor().map_err(|_| {
            let (at, g_y) = (&solver.problem.patterns, solver.g_y.row(nodes));
            diagnose_rank(&at.g_y, g_y, StepError::SingularNewton)
        })
    }

    /// Λ: the velocities B R2_j + R1_j that the residuals alone would take away must meet g.
    #[inline(always)]
    fn solve_multipliers(&mut self) {
        let (solver, stages, h) = (&mut *self.solver, &mut *self.stages, self.step.h);
        let (nodes, m) = (stages.tableau.intervals, solver.problem.m);
        let at = &solver.problem.patterns;
        for j in 0..stages.tableau.stages {
            let u = solver.velocity.row_mut(j);
            copy(u, stages.momentum_residual.row(j));
            solver.mass.solve_velocity(u);
            if at.v_z.is_some() {
                add_scaled(u, 1.0, stages.velocity_residual.row(j));
            }
        }
        let lu = match &mut solver.matrix {
            Schur::Dense { lu, .. } => lu,
            Schur::Sparse(sparse) => {
                sparse.solve(
                    (&solver.a_bar, &solver.a_hat),
                    (&solver.velocity, &stages.momentum_residual),
                    (&stages.g, h),
                    &mut solver.d_lam,
                    &mut solver.d_z,
                );
                for (l, d_lam) in solver.d_lam.chunks_exact(m).enumerate() {
                    add_scaled(stages.unknowns.lam.row_mut(l), 1.0 / h, d_lam);
                }
                return;
            }
            Schur::Missing => return,
        };
        combine(
            solver.node_velocity.flat_mut(),
            &solver.a_bar,
            &solver.velocity,
            as_is,
        );
        for k in 0..nodes {
            let out = &mut solver.d_lam[k * m..(k + 1) * m];
            for (out, g) in out.iter_mut().zip(stages.g.row(k + 1)) {
                *out = -*g / R::splat(h);
            }
            at.g_y
                .multiply_add(solver.g_y.row(k + 1), 1.0, solver.node_velocity.row(k), out);
        }
        lu.solve(&mut solver.d_lam);
        solver.impulse.clear();
        for l in 0..nodes {
            let (d_lam, r_lam) = (&solver.d_lam[l * m..(l + 1) * m], solver.r_lam.row(l));
            at.r_lam
                .multiply_add(r_lam, 1.0, d_lam, solver.impulse.row_mut(l));
            add_scaled(stages.unknowns.lam.row_mut(l), 1.0 / h, d_lam);
        }
        self.combine_impulses();
    }

    /// Σ â_il R_l dΛ_l − R2_i
    #[inline(always)]
    fn combine_impulses(&mut self) {
        let residual = &self.stages.momentum_residual;
        combine(
            self.solver.d_z.flat_mut(),
            &self.solver.a_hat,
            &self.solver.impulse,
            #[inline(always)]
            |i, k, sums| {
                let residual = &residual.row(i)[k..k + sums.len()];
                for (sum, residual) in sums.iter_mut().zip(residual) {
                    *sum -= *residual;
                }
            },
        );
    }

    /// dZ_i = p_z⁻¹ (Σ â_il R_l dΛ_l − R2_i), dV_i = v_z dZ_i − R1_i; returns the largest dV.
    #[inline(always)]
    fn correct_stages(&mut self) -> R {
        let (solver, stages) = (&mut *self.solver, &mut *self.stages);
        if solver.problem.patterns.v_z.is_none() {
            // R1 is zero, and dV is dZ
            for i in 0..stages.tableau.stages {
                solver.mass.solve(solver.d_z.row_mut(i));
            }
            add_scaled(stages.unknowns.z.flat_mut(), 1.0, solver.d_z.flat());
            add_scaled(stages.unknowns.v.flat_mut(), 1.0, solver.d_z.flat());
            return max_norm(solver.d_z.flat());
        }
        for i in 0..stages.tableau.stages {
            let (d_z, d_v) = (solver.d_z.row_mut(i), solver.d_v.row_mut(i));
            solver.mass.solve(d_z);
            for (d_v, residual) in d_v.iter_mut().zip(stages.velocity_residual.row(i)) {
                *d_v = -*residual;
            }
            solver.mass.add_velocity(d_z, d_v);
        }
        add_scaled(stages.unknowns.z.flat_mut(), 1.0, solver.d_z.flat());
        add_scaled(stages.unknowns.v.flat_mut(), 1.0, solver.d_v.flat());
        max_norm(solver.d_v.flat())
    }

    /// What is corrected in the multipliers need not show in the velocities where r is not linear.
    #[inline(always)]
    fn multiplier_size(&mut self) -> R {
        let (solver, m) = (&mut *self.solver, self.model.problem.m);
        if self.model.problem.is_linear || m == 0 {
            return R::splat(0.0);
        }
        let corrections = solver.d_lam.chunks_exact(m).enumerate();
        corrections.fold(R::splat(0.0), |size, (l, d_lam)| {
            solver
                .mass
                .velocity_of(solver.r_lam.row(l), d_lam)
                .zip(size, f64::max)
        })
    }
}

impl<R: Real> Equations<R> for SchurEquations<'_, R> {
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    #[inline(always)]
    fn reach(&self, size: R) -> R {
        self.stages.reach(size)
    }

    #[inline(always)]
    fn moved(&self) -> R {
        self.stages.moved(self.step)
    }

    fn is_solved(&mut self) -> Result<bool, StepError> {
        self.stages.is_solved(self.model, self.step)
    }

    fn floor(&mut self) -> Result<f64, StepError> {
        probe::floor(self)
    }

    fn correct(&mut self) -> Result<R, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        if !self.is_linearized {
            self.linearize()?;
            self.is_linearized = true;
        }
        let size = dispatch_simd_long::<R, _>(
            self.solver.problem.n,
            #[inline(always)]
            || {
                if self.model.problem.m > 0 {
                    self.solve_multipliers();
                } else {
                    self.combine_impulses();
                }
                let size = self.correct_stages();
                let size = size.zip(self.multiplier_size(), f64::max);
                self.stages.relative(size, self.step)
            },
        );
        Ok(size)
    }

    #[inline(always)]
    fn keep(&mut self, members: R) {
        if let Some(kept) = &mut self.solver.kept {
            kept.copy_members(&self.stages.unknowns, members);
        }
    }

    #[inline(always)]
    fn put_back(&mut self, members: R) {
        if let Some(kept) = &self.solver.kept {
            self.stages.unknowns.copy_members(kept, members);
        }
    }
}
