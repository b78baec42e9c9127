//! The full simplified Newton iteration: all unknowns of a step together, with f_y, f_z, p_y and r_y, for forces
//! too stiff for node Schur. Unknowns are dZ_i, dΛ_k with Λ = h λ and, where v is not z, dV_j:
//!
//!     Σ_j (δ_ij p_z(i) − h aᶠ_ij f_z(j)) dZ_j + Σ_j C_ij dV_j − Σ_k â_ik r_λ(k) dΛ_k = −R2_i
//!     Σ_j (δ_ij − h aᵛ_ij v_y(i)) dV_j − v_z(i) dZ_i                                  = −R1_i
//!     Σ_j ā_kj g_y(k) dV_j                                                             = −g_k/h
//!     C_ij = h aᵛ_ij p_y(i) − h² Σ_l aᶠ_il f_y(l) aᵛ_lj − h² Σ_k â_ik r_y(k) ā_kj
//!
//! Nonholonomic constraints, alone or beside holonomic ones, make z1 meet the stages through k. To (S1)–(S4) and
//! (U1)–(U3) come reactions at the stages and
//!
//!     0 = Σ_j b_j P_{i−1}(c_j) k(T_j, Y_j, Z_j)    i = 1..s−1        0 = k(t1, y1, z1)
//!
//! with P the shifted Legendre polynomials; further unknowns are dN_i with N = h ν, dz1 and dΛ of the last node, and
//! the end of the step is treated as a further stage with the coefficients b. Source: jay2009lagrange.
//!
//! The matrix is O(1) as h → 0. It is made and factored once a step, where the iteration starts; a dense one by dV
//! first.

mod blocks;
mod linearize;

use super::derivatives::Derivatives;
use super::equations::{CorrectStages, StageEquations};
use super::stages::Stages;
pub(super) use blocks::Offsets;
use blocks::SparkBlocks;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Singular, add_scaled, copy, copy_scaled, dot, max_norm};
use liouville_base::newton::{BlockMatrix, Signs};
use liouville_base::real::Real;
use liouville_base::tableau;
use liouville_problem::{Mass, Model, finite, finite_k};

/// The matrix of all unknowns of a step.
#[derive(Clone, Debug)]
pub(super) struct FullMatrix<R = f64> {
    offsets: Offsets,
    blocks: SparkBlocks<R>,
    matrix: BlockMatrix<R>,
}

impl<R: Real> FullMatrix<R> {
    pub(super) fn new(model: &Model<R>, tableau: &tableau::Spark) -> Self {
        let (offsets, blocks, matrix) = SparkBlocks::new(model, tableau);
        Self {
            offsets,
            blocks,
            matrix,
        }
    }

    /// Factors the matrix with these derivatives.
    ///
    /// # Errors
    /// It is singular, or that of one of several members is where they have the same units: alone each has its own.
    pub(super) fn factor(&mut self, of: &Derivatives<R>, h: f64) -> Result<(), Singular> {
        self.blocks.write(&mut self.matrix, of, h);
        self.matrix.factor()?;
        if self.matrix.has_units() && !R::IS_SINGLE {
            return Err(Singular { column: 0 });
        }
        Ok(())
    }

    /// Solves in place, in the order of equations and unknowns.
    pub(super) fn solve(&mut self, x: &mut [R]) {
        self.matrix.solve(x);
    }

    /// Solves with the transposed matrix in place.
    pub(super) fn solve_transposed(&mut self, x: &mut [R]) {
        self.matrix.solve_transposed(x);
    }
}

/// The Newton matrix, and the memory of solving with it.
#[derive(Clone, Debug)]
pub(super) struct FullNewton {
    of: FullMatrix,
    /// Gives the size of multipliers in velocities, where reactions are not linear.
    mass: Mass,
    unknowns: Vec<f64>,
    derivatives: Derivatives,
}

/// Full Newton with z at the end of the step, an unknown where there are nonholonomic constraints.
pub(super) struct FullSolver<'a> {
    pub(super) newton: &'a mut FullNewton,
    pub(super) z1: &'a mut [f64],
}

/// The stage equations of one step, solved by full Newton.
type FullEquations<'a> = StageEquations<'a, FullSolver<'a>>;

impl FullNewton {
    pub(super) fn new(model: &Model, stages: &Stages) -> Self {
        let (problem, tableau) = (&model.problem, &stages.tableau);
        let of = FullMatrix::new(model, tableau);
        Self {
            mass: Mass::new(model),
            unknowns: vec![0.0; of.matrix.order()],
            derivatives: Derivatives::new(problem, tableau),
            of,
        }
    }
}

impl FullEquations<'_> {
    /// Whether forces have turned the sign of the matrix, which is replaced by the one without them.
    fn is_turned_by_forces(&mut self) -> bool {
        let FullNewton {
            of, derivatives, ..
        } = &mut *self.solver.newton;
        let own = of.matrix.is_negative();
        let is_turned =
            own.is_some() && of.factor(derivatives, 0.0).is_ok() && of.matrix.is_negative() != own;
        if is_turned {
            self.stages.signs = Signs::Reversed;
        }
        is_turned
    }

    /// The right-hand sides, but for those of the end.
    fn set_residuals(&mut self) {
        let (solver, stages, h) = (&mut *self.solver.newton, &*self.stages, self.step.h);
        let Offsets { lam, nu, order, .. } = solver.of.offsets;
        let out = &mut solver.unknowns;
        copy_scaled(out, -1.0, stages.momentum_residual.flat());
        let constraints = &stages.g.flat()[self.model.problem.m..];
        for (out, g) in out[lam..].iter_mut().zip(constraints) {
            *out = -g / h;
        }
        if let Some(own) = &solver.of.blocks.own {
            let l = self.model.problem.l();
            for (i, out) in out[nu..order - l].chunks_exact_mut(l).enumerate() {
                out.fill(0.0);
                for (j, weight) in own.moments.row(i).iter().enumerate() {
                    add_scaled(out, -weight, stages.k.row(j));
                }
            }
        }
        if self.model.problem.patterns.v_z.is_some() {
            out[order..].fill(0.0);
            copy_scaled(&mut out[order..], -1.0, stages.velocity_residual.flat());
        }
    }

    /// The right-hand sides of (U2), (U3) and of k at the end.
    fn set_end_residuals(&mut self) -> Result<(), StepError> {
        let (solver, stages, z1) = (&mut *self.solver.newton, &*self.stages, &*self.solver.z1);
        let Offsets { lam, nu, order, .. } = solver.of.offsets;
        let problem = &self.model.problem;
        let (n, m, l) = (problem.n, problem.m, problem.l());
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        let state = self.step.state;
        let [p, w, _] = self.model.end(t, y1, z1);
        finite(p, Quantity::Momentum, t)?;
        finite(w, Quantity::Hidden, t)?;
        let out = &mut solver.unknowns[s * n..lam];
        copy(out, &state.p_low);
        for impulse in stages.impulses.flat().chunks_exact(n) {
            add_scaled(out, 1.0, impulse);
        }
        for ((out, p), p0) in out.iter_mut().zip(p).zip(&state.p) {
            *out -= p - p0;
        }
        copy_scaled(&mut solver.unknowns[lam + k * m..nu], -1.0, w);
        let [value, _] = self
            .model
            .nonholonomic(t, y1, z1, stages.unknowns.nu.row(s - 1));
        finite_k(value, m, t)?;
        copy_scaled(&mut solver.unknowns[order - l..order], -1.0, value);
        Ok(())
    }

    /// Corrects everything by the solution; returns the largest velocity.
    fn add_corrections(&mut self) -> f64 {
        let (solver, unknowns) = (&mut *self.solver.newton, &mut self.stages.unknowns);
        let Offsets {
            lam, nu, order, v, ..
        } = solver.of.offsets;
        let (d, h) = (&solver.unknowns, self.step.h);
        let (d_z, d_v) = (&d[..lam], &d[v..v + lam]);
        let stages = unknowns.z.flat().len();
        add_scaled(unknowns.z.flat_mut(), 1.0, d_z);
        add_scaled(self.solver.z1, 1.0, &d_z[stages..]);
        add_scaled(unknowns.v.flat_mut(), 1.0, d_v);
        add_scaled(unknowns.lam.flat_mut(), 1.0 / h, &d[lam..nu]);
        add_scaled(unknowns.nu.flat_mut(), 1.0 / h, &d[nu..order]);
        max_norm(d_v)
    }

    /// The largest velocity that corrections of the multipliers give: where reactions are not linear, it need not
    /// show in the velocities.
    fn multiplier_size(&mut self) -> f64 {
        let (solver, problem) = (&mut *self.solver.newton, &self.model.problem);
        if problem.is_linear {
            return 0.0;
        }
        let Offsets { lam, nu, order, .. } = solver.of.offsets;
        let (mass, d, mut size) = (&mut solver.mass, &solver.unknowns, 0.0_f64);
        if problem.m > 0 {
            for (j, d_lam) in d[lam..nu].chunks_exact(problem.m).enumerate() {
                size = size.max(mass.velocity_of(solver.derivatives.r_lam.row(j), d_lam));
            }
        }
        if let (Some(own), Some(of)) = (&problem.nonholonomic, &solver.derivatives.own) {
            for (j, d_nu) in d[nu..order].chunks_exact(own.l).enumerate() {
                let r_nu = of.r_nu.row(j);
                size = size.max(mass.velocity_by(&own.patterns.r_nu, r_nu, d_nu));
            }
        }
        size
    }
}

impl CorrectStages<f64> for FullEquations<'_> {
    fn correct_unknowns(&mut self) -> Result<f64, StepError> {
        self.set_residuals();
        if self.solver.newton.of.blocks.own.is_some() {
            self.set_end_residuals()?;
        }
        if !self.is_linearized {
            self.linearize()?;
            self.is_linearized = true;
        }
        let newton = &mut *self.solver.newton;
        newton.of.solve(&mut newton.unknowns);
        let size = self.add_corrections().max(self.multiplier_size());
        Ok(self.stages.relative(size, self.step))
    }

    /// The matrix of a single stage is symmetric, if the forces have a potential.
    fn corrects_against(&self) -> bool {
        let (problem, stages) = (&self.model.problem, &*self.stages);
        if stages.tableau.stages > 1 || problem.m + problem.l() > 0 || !stages.velocity_is_z {
            return false;
        }
        let residual = stages.momentum_residual.flat();
        dot(residual, &self.solver.newton.unknowns[..residual.len()]) > 0.0
    }

    /// Without constraints the matrix is p_z of the stages as h → 0; with them it is factored for h = 0 where nodes are.
    fn has_reversed(&mut self, is_doubtful: bool) -> bool {
        let (problem, matrix) = (&self.model.problem, &self.solver.newton.of.matrix);
        if problem.m + problem.l() > 0 {
            return is_doubtful && self.stages.signs.are_regarded() && self.is_turned_by_forces();
        }
        if matrix.is_negative() != Some(true) {
            return false;
        }
        // of an even number of stages the sign of the mass itself does not matter
        let is_even = self.stages.tableau.stages.is_multiple_of(2);
        is_even
            || self.update_mass().is_ok() && self.solver.newton.mass.is_negative() == Some(false)
    }
}
