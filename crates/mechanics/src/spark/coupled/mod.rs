//! Nonholonomic constraints, alone or beside holonomic ones: everything in one simplified Newton
//! iteration, since z1 meets the stages through k. To (S1)–(S4) and (U1)–(U3) come reactions at the stages and
//!
//!     0 = Σ_j b_j P_{i−1}(c_j) k(T_j, Y_j, Z_j)    i = 1..s−1        0 = k(t1, y1, z1)
//!
//! with P the shifted Legendre polynomials. Unknowns are dZ_i, dΛ_0..dΛ_{k−1}, dN_i, dz1 and dΛ_k with Λ = h λ
//! and N = h ν; rows of g are divided by h: the matrix is O(1) as h → 0. dV_i is eliminated as in full
//! Newton. All blocks are frozen at the start of the iteration. Source: jay2009lagrange.

mod blocks;

use super::stages::{Stages, Step};
use crate::problem::{Mass, Model, finite, finite_k};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Lu, Matrix, add_scaled, copy, copy_scaled, dot, max_norm};
use liouville_base::newton::{Equations, Stop};
use liouville_base::tableau;

/// The factored Newton matrix and what the right-hand sides need.
#[derive(Clone, Debug)]
pub(super) struct Coupled {
    places: Places,
    /// b_j P_{i−1}(c_j), s − 1 by s.
    moments: Matrix,
    /// What multiplies dV in each row, then the same times E⁻¹.
    coupling: Matrix,
    /// E, where v depends on y.
    elimination: Option<Lu>,
    /// v_z of each stage and of the end, dense; the identity where v = z.
    v_z: Vec<Matrix>,
    newton: Lu,
    unknowns: Vec<f64>,
    d_v: Matrix,
    /// Residuals at the end: of momentum, of w and of k.
    momentum: Vec<f64>,
    hidden: Vec<f64>,
    rolling: Vec<f64>,
    /// What tells the size of a multiplier, where reactions are not linear.
    mass: Mass,
    r_lam: Matrix,
    r_nu: Matrix,
}

/// Where the rows of each equation and the columns of each unknown begin.
#[derive(Clone, Copy, Debug)]
struct Places {
    /// Rows of g, of the moments, of k, p and w at the end; the stages' momenta come first.
    g: usize,
    moments: usize,
    k: usize,
    p: usize,
    w: usize,
    /// Columns of Λ_0.., N, z1 and Λ_k; the stages' Z come first.
    lam: usize,
    nu: usize,
    z1: usize,
    last_lam: usize,
    /// Number of either.
    order: usize,
}

impl Places {
    fn new(model: &Model, tableau: &tableau::Spark) -> Self {
        let (n, m, l) = (model.problem.n, model.problem.m, model.problem.l());
        let (s, k) = (tableau.stages, tableau.intervals);
        let g = s * n;
        let moments = g + k * m;
        let end = moments + (s - 1) * l;
        let nu = g + k * m;
        let z1 = nu + s * l;
        Self {
            g,
            moments,
            k: end,
            p: end + l,
            w: end + l + n,
            lam: g,
            nu,
            z1,
            last_lam: z1 + n,
            order: z1 + n + m,
        }
    }
}

/// The equations of one step, to be solved together.
pub(super) struct Solve<'a> {
    solver: &'a mut Coupled,
    stages: &'a mut Stages,
    model: &'a mut Model,
    z1: &'a mut [f64],
    step: Step<'a>,
    is_frozen: bool,
}

impl Coupled {
    pub(super) fn new(model: &Model, stages: &Stages) -> Self {
        let (problem, tableau) = (&model.problem, &stages.tableau);
        let (n, s, k) = (problem.n, tableau.stages, tableau.intervals);
        let places = Places::new(model, tableau);
        let own = problem.nonholonomic.as_ref();
        Self {
            places,
            moments: tableau::moments(&tableau.b, &tableau.c),
            coupling: Matrix::zeros(places.order, s * n),
            elimination: (!problem.patterns.v_y.is_empty()).then(|| Lu::new(s * n)),
            v_z: vec![Matrix::from_fn(n, n, |i, j| f64::from(u8::from(i == j))); s + 1],
            newton: Lu::new(places.order),
            unknowns: vec![0.0; places.order],
            d_v: Matrix::zeros(s, n),
            momentum: vec![0.0; n],
            hidden: vec![0.0; problem.m],
            rolling: vec![0.0; problem.l()],
            mass: Mass::new(model),
            r_lam: Matrix::zeros(k + 1, problem.patterns.r_lam.len()),
            r_nu: Matrix::zeros(s, own.map_or(0, |own| own.patterns.r_nu.len())),
        }
    }

    /// The equations of one step, its blocks still to be frozen; `z1` is a guess of its end.
    pub(super) fn start<'a>(
        &'a mut self,
        stages: &'a mut Stages,
        model: &'a mut Model,
        z1: &'a mut [f64],
        step: Step<'a>,
    ) -> Solve<'a> {
        Solve {
            solver: self,
            stages,
            model,
            z1,
            step,
            is_frozen: false,
        }
    }
}

impl Solve<'_> {
    /// Residuals of (U2), (U3) and of k at the end.
    fn evaluate_end(&mut self) -> Result<(), StepError> {
        let (solver, stages, z1) = (&mut *self.solver, &*self.stages, &*self.z1);
        let (k, m) = (stages.tableau.intervals, self.model.problem.m);
        let (t, y1) = (stages.node_time(self.step, k), stages.node_y.row(k));
        let state = self.step.state;
        let [p, w, _] = self.model.end(t, y1, z1);
        finite(p, Quantity::Momentum, t)?;
        finite(w, Quantity::Hidden, t)?;
        copy_scaled(&mut solver.momentum, -1.0, &state.p_low);
        for impulse in stages.impulses.flat().chunks_exact(p.len()) {
            add_scaled(&mut solver.momentum, -1.0, impulse);
        }
        for ((out, p), p0) in solver.momentum.iter_mut().zip(p).zip(&state.p) {
            *out += p - p0;
        }
        copy(&mut solver.hidden, w);
        let nu = stages.unknowns.nu.row(stages.tableau.stages - 1);
        let [value, _] = self.model.nonholonomic(t, y1, z1, nu);
        finite_k(value, m, t)?;
        copy(&mut solver.rolling, value);
        Ok(())
    }

    /// The right-hand sides, then the solution.
    fn solve_unknowns(&mut self) {
        let (solver, stages) = (&mut *self.solver, &*self.stages);
        let (m, l) = (solver.hidden.len(), solver.rolling.len());
        let (places, h) = (solver.places, self.step.h);
        let out = &mut solver.unknowns;
        copy_scaled(out, -1.0, stages.momentum_residual.flat());
        copy_scaled(&mut out[places.g..], -1.0 / h, &stages.g.flat()[m..]);
        out[places.moments..places.k].fill(0.0);
        for i in 0..solver.moments.rows() {
            let row = &mut out[places.moments + i * l..places.moments + (i + 1) * l];
            for (weight, k) in solver
                .moments
                .row(i)
                .iter()
                .zip(stages.k.flat().chunks_exact(l))
            {
                add_scaled(row, -weight, k);
            }
        }
        copy_scaled(&mut out[places.k..], -1.0, &solver.rolling);
        copy_scaled(&mut out[places.p..], -1.0, &solver.momentum);
        copy_scaled(&mut out[places.w..], -1.0, &solver.hidden);
        if self.model.problem.patterns.v_z.is_some() {
            let residual = stages.velocity_residual.flat();
            for (row, out) in out.iter_mut().enumerate() {
                *out += dot(solver.coupling.row(row), residual);
            }
        }
        solver.newton.solve(&mut solver.unknowns);
    }

    /// dV = E⁻¹ (v_z dZ − R1), and everything corrected; returns the largest velocity.
    fn correct_unknowns(&mut self) -> f64 {
        let (solver, stages) = (&mut *self.solver, &mut *self.stages);
        let (places, h) = (solver.places, self.step.h);
        let (n, s, k) = (
            self.z1.len(),
            stages.tableau.stages,
            stages.tableau.intervals,
        );
        let d = &solver.unknowns;
        for i in 0..s {
            let residual = stages.velocity_residual.row(i);
            for (j, out) in solver.d_v.row_mut(i).iter_mut().enumerate() {
                *out = dot(solver.v_z[i].row(j), &d[i * n..]) - residual[j];
            }
        }
        if let Some(elimination) = &solver.elimination {
            elimination.solve(solver.d_v.flat_mut());
        }
        let unknowns = &mut stages.unknowns;
        add_scaled(unknowns.z.flat_mut(), 1.0, &d[..places.g]);
        add_scaled(unknowns.v.flat_mut(), 1.0, solver.d_v.flat());
        add_scaled(unknowns.lam.flat_mut(), 1.0 / h, &d[places.lam..places.nu]);
        add_scaled(unknowns.nu.flat_mut(), 1.0 / h, &d[places.nu..places.z1]);
        add_scaled(self.z1, 1.0, &d[places.z1..]);
        add_scaled(unknowns.lam.row_mut(k), 1.0 / h, &d[places.last_lam..]);
        let end = (0..n).map(|j| dot(solver.v_z[s].row(j), &d[places.z1..]).abs());
        end.fold(max_norm(solver.d_v.flat()), f64::max)
    }

    /// What is corrected in the multipliers need not show in the velocities where reactions are not
    /// linear.
    fn multiplier_size(&mut self) -> f64 {
        let (solver, problem) = (&mut *self.solver, &self.model.problem);
        let (Some(own), false) = (&problem.nonholonomic, problem.is_linear) else {
            return 0.0;
        };
        let (places, d, mut size) = (solver.places, &solver.unknowns, 0.0_f64);
        for (j, d_nu) in d[places.nu..places.z1].chunks_exact(own.l).enumerate() {
            let r_nu = solver.r_nu.row(j);
            size = size.max(solver.mass.velocity_by(&own.patterns.r_nu, r_nu, d_nu));
        }
        if problem.m > 0 {
            let (first, last) = (&d[places.lam..places.nu], &d[places.last_lam..]);
            let all = first.chunks_exact(problem.m).chain([last]);
            for (j, d_lam) in all.enumerate() {
                size = size.max(solver.mass.velocity_of(solver.r_lam.row(j), d_lam));
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
        self.evaluate_end()?;
        if !self.is_frozen {
            self.freeze()?;
            self.is_frozen = true;
        }
        self.solve_unknowns();
        let size = self.correct_unknowns().max(self.multiplier_size());
        Ok(self.stages.relative(size, self.step))
    }
}
