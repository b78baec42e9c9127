//! The full simplified Newton iteration: stages and multipliers together, with f_y, f_z, p_y and r_y,
//! for forces too stiff for node Schur. Unknowns are dZ_i, dΛ_k with Λ = h λ; dV_i is eliminated by
//!
//!     E dV = v_z dZ − R1,      E_ij = δ_ij − h aᵛ_ij v_y(i)
//!
//! and with C the coefficients of dV in the momentum equations,
//!
//!     C_ij = h aᵛ_ij p_y(i) − h² Σ_l aᶠ_il f_y(l) aᵛ_lj − h² Σ_k â_ik r_y(k) ā_kj
//!     [ δ_ij p_z(i) − h aᶠ_ij f_z(j) + (C E⁻¹)_ij v_z(j)    −â_ik r_λ(k) ] [ dZ ]   [ −R2 + C E⁻¹ R1 ]
//!     [ (D E⁻¹)_kj v_z(j),  D_kj = ā_kj g_y(k)                   0      ] [ dΛ ] = [ −g/h + D E⁻¹ R1 ]
//!
//! All blocks are frozen at the start of the iteration.

use super::stages::{Stages, Step};
use crate::problem::{Mass, Model, diagnose_rank, finite};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Lu, Matrix, Pattern, add_scaled, combine, copy, dot, max_norm};
use liouville_base::newton::{Equations, Stop};

/// The factored Newton matrix and what the right-hand sides need.
#[derive(Clone, Debug)]
pub(super) struct FullNewton {
    /// C over D, then C E⁻¹ over D E⁻¹: s n + k m by s n.
    coupling: Matrix,
    /// E, where v depends on y.
    elimination: Option<Lu>,
    /// v_z of each stage, dense; none where v = z.
    v_z: Vec<Matrix>,
    newton: Lu,
    f_y: Curvature,
    r_y: Curvature,
    /// What tells the size of a multiplier, where r is not linear.
    mass: Mass,
    r_lam: Matrix,
    unknowns: Vec<f64>,
    d_v: Matrix,
}

/// Derivatives by y at all stages or nodes, and what of them is in each block of C.
#[derive(Clone, Debug)]
struct Curvature {
    /// Row i s + j has the weights aᶠ_il aᵛ_lj, or those of the nodes.
    weights: Matrix,
    values: Matrix,
    blocks: Matrix,
}

impl Curvature {
    fn new(stages: usize, entries: usize, of_row: &Matrix, of_col: &Matrix, count: usize) -> Self {
        let weight = |ij: usize, l| of_row[(ij / stages, l)] * of_col[(l, ij % stages)];
        Self {
            weights: Matrix::from_fn(stages * stages, count, weight),
            values: Matrix::zeros(count, entries),
            blocks: Matrix::zeros(stages * stages, entries),
        }
    }

    /// Adds −h² Σ_l of all blocks.
    fn add_to(&mut self, pattern: &Pattern, h: f64, n: usize, coupling: &mut Matrix) {
        if pattern.is_empty() {
            return;
        }
        let (blocks, factor) = (self.blocks.flat_mut(), -h * h);
        combine(blocks, &self.weights, &self.values, |_, _, _| ());
        let stages = coupling.cols() / n;
        for ij in 0..stages * stages {
            let (row, col) = (ij / stages * n, ij % stages * n);
            pattern.add_to(self.blocks.row(ij), factor, coupling, row, col);
        }
    }
}

/// The stage equations of one step, solved by full Newton.
pub(super) struct Solve<'a> {
    solver: &'a mut FullNewton,
    stages: &'a mut Stages,
    model: &'a mut Model,
    step: Step<'a>,
    is_frozen: bool,
}

impl FullNewton {
    pub(super) fn new(model: &Model, stages: &Stages) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        let (at, tableau) = (&model.problem.patterns, &stages.tableau);
        let v_depends_on_y = !at.v_y.is_empty();
        let v_z_count = if at.v_z.is_some() { s } else { 0 };
        Self {
            coupling: Matrix::zeros(s * n + k * m, s * n),
            elimination: v_depends_on_y.then(|| Lu::new(s * n)),
            v_z: vec![Matrix::zeros(n, n); v_z_count],
            newton: Lu::new(s * n + k * m),
            f_y: Curvature::new(s, at.f_y.len(), &tableau.a_f, &tableau.a_v, s),
            r_y: Curvature::new(s, at.r_y.len(), &tableau.a_hat, &tableau.a_bar, k),
            mass: Mass::new(model),
            r_lam: Matrix::zeros(k, at.r_lam.len()),
            unknowns: vec![0.0; s * n + k * m],
            d_v: Matrix::zeros(s, n),
        }
    }

    /// The equations of one step, its blocks still to be frozen.
    pub(super) fn start<'a>(
        &'a mut self,
        stages: &'a mut Stages,
        model: &'a mut Model,
        step: Step<'a>,
    ) -> Solve<'a> {
        Solve {
            solver: self,
            stages,
            model,
            step,
            is_frozen: false,
        }
    }
}

impl Solve<'_> {
    fn freeze(&mut self) -> Result<(), StepError> {
        self.solver.coupling.clear();
        self.solver.newton.matrix_mut().clear();
        self.add_stage_blocks()?;
        if self.model.problem.m > 0 {
            self.add_node_blocks()?;
        }
        if !self.model.problem.is_linear {
            let (stages, middle) = (&*self.stages, self.stages.tableau.stages / 2);
            let t = stages.stage_time(self.step, middle);
            let (y, z) = (stages.y.row(middle), stages.unknowns.z.row(middle));
            self.solver.mass.update(self.model, t, y, z)?;
        }
        self.close()
    }

    /// Everything that comes from p, f and v.
    fn add_stage_blocks(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (n, s, h) = (model.problem.n, stages.tableau.stages, step.h);
        let problem = model.problem.clone();
        let (a_v, a_f) = (&stages.tableau.a_v, &stages.tableau.a_f);
        let at = &problem.patterns;
        if let Some(lu) = &mut solver.elimination {
            lu.matrix_mut().clear();
            (0..s * n).for_each(|k| lu.matrix_mut()[(k, k)] = 1.0);
        }
        let times = stages.stage_times(*step);
        let mut blocks = model.stages_blocks(times, &stages.y, &stages.unknowns.z);
        for l in 0..s {
            let t = times.at(l);
            let [p_z, v_z] = blocks.at(l);
            finite(p_z, Quantity::Derivative, t)?;
            finite(v_z, Quantity::Derivative, t)?;
            at.p_z
                .add_to(p_z, 1.0, solver.newton.matrix_mut(), l * n, l * n);
            if let Some(pattern) = &at.v_z {
                solver.v_z[l].clear();
                pattern.add_to(v_z, 1.0, &mut solver.v_z[l], 0, 0);
            }
        }
        let mut jacobian = model.stages_jacobian(times, &stages.y, &stages.unknowns.z);
        for l in 0..s {
            let t = times.at(l);
            let [p_y, f_y, f_z, v_y] = jacobian.at(l);
            for values in [p_y, f_y, f_z, v_y] {
                finite(values, Quantity::Derivative, t)?;
            }
            for j in 0..s {
                at.p_y
                    .add_to(p_y, h * a_v[(l, j)], &mut solver.coupling, l * n, j * n);
                if let Some(lu) = &mut solver.elimination {
                    at.v_y
                        .add_to(v_y, -h * a_v[(l, j)], lu.matrix_mut(), l * n, j * n);
                }
            }
            copy(solver.f_y.values.row_mut(l), f_y);
            for i in 0..s {
                at.f_z.add_to(
                    f_z,
                    -h * a_f[(i, l)],
                    solver.newton.matrix_mut(),
                    i * n,
                    l * n,
                );
            }
        }
        solver.f_y.add_to(&at.f_y, h, n, &mut solver.coupling);
        match &mut solver.elimination {
            Some(lu) => lu.factor().map_err(|_| StepError::SingularNewton),
            None => Ok(()),
        }
    }

    /// Everything that comes from g and r.
    fn add_node_blocks(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (n, m, s, h) = (
            model.problem.n,
            model.problem.m,
            stages.tableau.stages,
            step.h,
        );
        let problem = model.problem.clone();
        let (at, a_bar, a_hat) = (
            &problem.patterns,
            &stages.tableau.a_bar,
            &stages.tableau.a_hat,
        );
        let nodes = stages.tableau.intervals;
        let times = stages.node_times(*step);
        let mut blocks = model.nodes_blocks(times, &stages.node_y, &stages.unknowns.lam);
        for k in 0..=nodes {
            let t = times.at(k);
            let [g_y, r_lam] = blocks.at(k);
            finite(g_y, Quantity::Derivative, t)?;
            finite(r_lam, Quantity::Derivative, t)?;
            if k > 0 {
                for j in 0..s {
                    at.g_y.add_to(
                        g_y,
                        a_bar[(k, j)],
                        &mut solver.coupling,
                        s * n + (k - 1) * m,
                        j * n,
                    );
                }
            }
            if k < nodes {
                copy(solver.r_lam.row_mut(k), r_lam);
                for i in 0..s {
                    at.r_lam.add_to(
                        r_lam,
                        -a_hat[(i, k)],
                        solver.newton.matrix_mut(),
                        i * n,
                        s * n + k * m,
                    );
                }
            }
        }
        let mut jacobian = model.nodes_jacobian(times, &stages.node_y, &stages.unknowns.lam);
        for k in 0..nodes {
            let [r_y] = jacobian.at(k);
            finite(r_y, Quantity::Derivative, times.at(k))?;
            copy(solver.r_y.values.row_mut(k), r_y);
        }
        solver.r_y.add_to(&at.r_y, h, n, &mut solver.coupling);
        Ok(())
    }

    /// Eliminates dV and factors.
    fn close(&mut self) -> Result<(), StepError> {
        let Self {
            solver,
            stages,
            model,
            step,
            ..
        } = self;
        let (n, s) = (model.problem.n, stages.tableau.stages);
        let FullNewton {
            coupling,
            elimination,
            v_z,
            newton,
            ..
        } = &mut **solver;
        for row in 0..coupling.rows() {
            if let Some(lu) = elimination {
                lu.solve_transposed(coupling.row_mut(row));
            }
            if v_z.is_empty() {
                add_scaled(newton.matrix_mut().row_mut(row), 1.0, coupling.row(row));
                continue;
            }
            for j in 0..s {
                for k in 0..n {
                    let factor = coupling[(row, j * n + k)];
                    if factor != 0.0 {
                        add_scaled(
                            &mut newton.matrix_mut().row_mut(row)[j * n..(j + 1) * n],
                            factor,
                            v_z[j].row(k),
                        );
                    }
                }
            }
        }
        newton.factor().map_err(|_| {
            let k = stages.tableau.intervals;
            let t = stages.node_time(*step, k);
            let pattern = model.problem.patterns.g_y.clone();
            let [g_y, _] = model.node_blocks(t, stages.node_y.row(k), stages.unknowns.lam.row(k));
            diagnose_rank(&pattern, g_y, StepError::SingularNewton)
        })
    }
}

impl Solve<'_> {
    /// The right-hand sides, then the solution: dZ and dΛ.
    fn solve_unknowns(&mut self) {
        let (solver, stages) = (&mut *self.solver, &*self.stages);
        let (m, h) = (self.model.problem.m, self.step.h);
        let momentum = stages.momentum_residual.flat().iter().map(|r| -r);
        let constraint = stages.g.flat()[m..].iter().map(|g| -g / h);
        for (out, value) in solver.unknowns.iter_mut().zip(momentum.chain(constraint)) {
            *out = value;
        }
        if self.model.problem.patterns.v_z.is_some() {
            let residual = stages.velocity_residual.flat();
            for (row, out) in solver.unknowns.iter_mut().enumerate() {
                *out += dot(solver.coupling.row(row), residual);
            }
        }
        solver.newton.solve(&mut solver.unknowns);
    }

    /// dV = E⁻¹ (v_z dZ − R1), and everything corrected; returns the largest velocity.
    fn correct_stages(&mut self) -> f64 {
        let (solver, stages) = (&mut *self.solver, &mut *self.stages);
        let problem = &self.model.problem;
        let (d_z, d_lam) = solver.unknowns.split_at(solver.d_v.flat().len());
        let d_v = solver.d_v.flat_mut();
        if solver.v_z.is_empty() {
            copy(d_v, d_z);
        } else {
            for (i, out) in d_v.iter_mut().enumerate() {
                let (stage, k) = (i / problem.n, i % problem.n);
                *out = dot(solver.v_z[stage].row(k), &d_z[stage * problem.n..]);
            }
        }
        add_scaled(d_v, -1.0, stages.velocity_residual.flat());
        if let Some(elimination) = &solver.elimination {
            elimination.solve(solver.d_v.flat_mut());
        }
        add_scaled(stages.unknowns.z.flat_mut(), 1.0, d_z);
        add_scaled(stages.unknowns.v.flat_mut(), 1.0, solver.d_v.flat());
        add_scaled(stages.unknowns.lam.flat_mut(), 1.0 / self.step.h, d_lam);
        let mut size = max_norm(solver.d_v.flat());
        if !problem.is_linear && problem.m > 0 {
            for (l, d_lam) in d_lam.chunks_exact(problem.m).enumerate() {
                size = size.max(solver.mass.velocity_of(solver.r_lam.row(l), d_lam));
            }
        }
        size
    }
}

impl Equations for Solve<'_> {
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    fn correct(&mut self) -> Result<f64, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        if !self.is_frozen {
            self.freeze()?;
            self.is_frozen = true;
        }
        self.solve_unknowns();
        let size = self.correct_stages();
        Ok(self.stages.relative(size, self.step))
    }
}
