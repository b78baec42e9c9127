//! Tangents of one step. With e(F) the change of F by y0, τ and h at fixed V_i, Z_i and λ_j, and Λ = h λ:
//!
//!     J (dZ, dΛ, dV) = (dp0 − e(p_i) + Σ_j d(h aᶠ_ij f_j) + Σ_{j<k} d(h â_ij r_j),  −e(g_j)/h,  e(v_i))
//!
//! J being the matrix of full Newton, in the order of its equations. Then dY_i = e(Y_i) + h Σ_j aᵛ_ij dV_j, the nodes
//! alike, dy1 = dŶ_k, and
//!
//!     dp1 = dp0 + Σ_j d(h b_j f_j) + Σ_j d(h b̂_j r_j),     p_z dz1 = dp1 − e(p1),   w_z dz1 = −e(w1)
//!
//! give dz1 and dΛ_k. It is λ that stays where h changes, not Λ. Source: sanzserna2016.
//!
//! With nonholonomic constraints the matrix has the end in it, and with it come the right-hand sides −e(k) by their
//! moments, dp0 + Σ .. − e(p1), −e(w1) and −e(k1), the reactions r_n being further impulses.

use super::super::stages::Stages;
use super::equations::LinearEquations;
use super::linear_step::{LinearNonholonomic, LinearStep};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, as_is, combine, copy, copy_scaled};
use liouville_base::tableau;
use liouville_problem::{Directions, Mechanical, Model, Step, TangentState};

/// The memory of a direction.
#[derive(Clone, Debug)]
pub(super) struct Forward {
    /// e(Y_i) and e(Ŷ_j), then the parts by dV_j.
    stages: Matrix,
    nodes: Matrix,
    /// h b_j dV_j
    displacements: Matrix,
    /// d(h b_j f_j), then d(h b̂_j r_j), then d(h b_j r_n).
    impulses: Matrix,
    right: Vec<f64>,
    /// dy1, then right-hand sides of the end.
    y: Vec<f64>,
    momentum: Vec<f64>,
    hidden: Vec<f64>,
    /// The derivative of k at a stage.
    nonholonomic: Vec<f64>,
}

/// A direction through a step from a state.
#[derive(Clone, Copy)]
pub(super) struct StepAlong<'a> {
    pub(super) step: Step<'a>,
    pub(super) direction: usize,
    pub(super) before: &'a TangentState,
    /// The relative change of the step size.
    pub(super) stretch: f64,
}

impl StepAlong<'_> {
    /// The change of time at a fraction of the step.
    fn time(&self, c: f64) -> f64 {
        self.before.t[self.direction] + c * self.step.h * self.stretch
    }

    /// The change of τ at a fraction of the step.
    fn tau<'d>(&self, directions: &'d mut Directions, c: f64) -> &'d [f64] {
        directions.tau(self.direction, self.time(c))
    }
}

impl Forward {
    pub(super) fn new(problem: &Mechanical, tableau: &tableau::Spark, order: usize) -> Self {
        let (n, s, k) = (problem.n, tableau.stages, tableau.intervals);
        Self {
            stages: Matrix::zeros(s, n),
            nodes: Matrix::zeros(k + 1, n),
            displacements: Matrix::zeros(s, n),
            impulses: Matrix::zeros(s + k + 1 + if problem.l() > 0 { s } else { 0 }, n),
            right: vec![0.0; order],
            y: vec![0.0; n],
            momentum: vec![0.0; n],
            hidden: vec![0.0; problem.m],
            nonholonomic: vec![0.0; problem.l()],
        }
    }

    /// Writes the tangent at the end of a linearised step.
    ///
    /// # Errors
    /// A singular matrix.
    pub(super) fn follow(
        &mut self,
        (linear, equations): (&mut LinearStep, &mut LinearEquations),
        (model, stages): (&Model, &Stages),
        directions: &mut Directions,
        along: StepAlong,
        state: &mut TangentState,
    ) -> Result<(), StepError> {
        self.vary(linear, stages, directions, along);
        self.set_right(linear, stages, directions, along);
        self.set_right_nonholonomic(linear, stages, directions, along);
        equations.solve::<false>((model, stages), &linear.derivatives, &mut self.right)?;
        self.move_points(linear, stages, along.step);
        self.add_impulses(linear, stages, along.step);
        self.finish((linear, model), directions, along, state);
        Ok(())
    }

    /// δZ_i and δV_i of the last direction, and what is behind them.
    pub(super) fn unknowns(&self, linear: &LinearStep) -> [&[f64]; 2] {
        [&self.right, &self.right[linear.places().0.v..]]
    }

    /// Writes e(Y_i), e(Ŷ_j), and e(h b_j f_j), e(h b̂_j r_j).
    fn vary(
        &mut self,
        linear: &LinearStep,
        stages: &Stages,
        directions: &mut Directions,
        along: StepAlong,
    ) {
        let StepAlong { step, stretch, .. } = along;
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (tableau, dy0) = (&stages.tableau, along.before.y.row(along.direction));
        // not the difference of the point and y0, which is roundoff in a very short step
        let moved = |out: &mut [f64], weights: &[f64]| {
            copy(out, dy0);
            let moves = stages.displacements.flat().chunks_exact(dy0.len());
            for (weight, led) in weights.iter().zip(moves).filter(|_| stretch != 0.0) {
                add_scaled(out, stretch * weight, led);
            }
        };
        copy_scaled(self.impulses.flat_mut(), stretch, stages.impulses.flat());
        for i in 0..tableau.stages {
            let (weight, out) = (step.h * tableau.b[i], self.impulses.row_mut(i));
            let dy = self.stages.row_mut(i);
            moved(dy, tableau.mu_v.row(i));
            let tau = along.tau(directions, tableau.c[i]);
            at.f_y
                .multiply_add(linear.derivatives.f_y.row(i), weight, dy, out);
            by_tau
                .f_tau
                .multiply_add(linear.f_tau.row(i), weight, tau, out);
        }
        for j in 0..self.nodes.rows() {
            let out = self.impulses.row_mut(tableau.stages + j);
            let (weight, dy) = (step.h * tableau.b_hat[j], self.nodes.row_mut(j));
            moved(dy, tableau.mu_bar.row(j));
            let tau = along.tau(directions, tableau.c_hat[j]);
            at.r_y
                .multiply_add(linear.derivatives.r_y.row(j), weight, dy, out);
            by_tau
                .r_tau
                .multiply_add(linear.r_tau.row(j), weight, tau, out);
        }
        let first = tableau.stages + self.nodes.rows();
        let Some(own) = linear.nonholonomic() else {
            return;
        };
        for (i, (b, c)) in tableau.b.iter().zip(&tableau.c).enumerate() {
            let (dy, out) = (self.stages.row(i), self.impulses.row_mut(first + i));
            let (weight, tau) = (step.h * b, along.tau(directions, *c));
            own.at.r_y.multiply_add(own.of.r_y.row(i), weight, dy, out);
            own.by_tau[1].multiply_add(own.rn_tau.row(i), weight, tau, out);
        }
    }

    /// Writes the right-hand sides, in the order of full Newton.
    fn set_right(
        &mut self,
        linear: &LinearStep,
        stages: &Stages,
        directions: &mut Directions,
        along: StepAlong,
    ) {
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (n, m, tableau) = (linear.problem.n, linear.problem.m, &stages.tableau);
        let (offsets, slopes, right) = (linear.places().0, &linear.derivatives, &mut self.right);
        right.fill(0.0);
        let momenta = &mut right[..tableau.stages * n];
        combine(momenta, &stages.force_weights, &self.impulses, as_is);
        for i in 0..tableau.stages {
            let (dy, tau) = (self.stages.row(i), along.tau(directions, tableau.c[i]));
            let out = &mut right[i * n..(i + 1) * n];
            add_scaled(out, 1.0, along.before.carried.row(along.direction));
            at.p_y.multiply_add(slopes.p_y.row(i), -1.0, dy, out);
            by_tau
                .p_tau
                .multiply_add(linear.p_tau.row(i), -1.0, tau, out);
            if let Some(v_tau) = &by_tau.v_tau {
                let out = &mut right[offsets.v + i * n..offsets.v + (i + 1) * n];
                at.v_y.multiply_add(slopes.v_y.row(i), 1.0, dy, out);
                v_tau.multiply_add(linear.v_tau.row(i), 1.0, tau, out);
            }
        }
        let weight = -1.0 / along.step.h;
        let rows = right[offsets.lam..offsets.nu].chunks_exact_mut(m.max(1));
        for (out, j) in rows.zip(1..self.nodes.rows()) {
            let tau = along.tau(directions, tableau.c_hat[j]);
            at.g_y
                .multiply_add(slopes.g_y.row(j), weight, self.nodes.row(j), out);
            by_tau
                .g_tau
                .multiply_add(linear.g_tau.row(j), weight, tau, out);
        }
    }

    /// The same of nonholonomic constraints and of the end, which is among the unknowns with them.
    fn set_right_nonholonomic(
        &mut self,
        linear: &LinearStep,
        stages: &Stages,
        directions: &mut Directions,
        along: StepAlong,
    ) {
        let Some(LinearNonholonomic {
            at: own,
            by_tau: of_own,
            of,
            moments,
            k_tau,
            end_k_tau,
            ..
        }) = linear.nonholonomic()
        else {
            return;
        };
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (tableau, offsets) = (&stages.tableau, linear.places().0);
        let (s, n, l) = (tableau.stages, linear.problem.n, linear.problem.l());
        let (right, end) = (&mut self.right, &linear.end);
        let (moved, value) = (self.nodes.row(tableau.intervals), &mut self.nonholonomic);
        for j in 0..s {
            let tau = along.tau(directions, tableau.c[j]);
            value.fill(0.0);
            own.k_y
                .multiply_add(of.k_y.row(j), 1.0, self.stages.row(j), value);
            of_own[0].multiply_add(k_tau.row(j), 1.0, tau, value);
            for (i, out) in right[offsets.nu..offsets.order - l]
                .chunks_exact_mut(l)
                .enumerate()
            {
                add_scaled(out, -moments[(i, j)], value);
            }
        }
        let tau = along.tau(directions, 1.0);
        let out = &mut right[s * n..(s + 1) * n];
        add_scaled(out, 1.0, along.before.carried.row(along.direction));
        for impulse in self.impulses.flat().chunks_exact(n) {
            add_scaled(out, 1.0, impulse);
        }
        at.p_y.multiply_add(&end.p_y, -1.0, moved, out);
        by_tau.p_tau.multiply_add(&end.p_tau, -1.0, tau, out);
        let out = &mut right[offsets.lam + tableau.intervals * linear.problem.m..offsets.nu];
        by_tau.w_y.multiply_add(&end.w_y, -1.0, moved, out);
        by_tau.w_tau.multiply_add(&end.w_tau, -1.0, tau, out);
        let out = &mut right[offsets.order - l..offsets.order];
        own.k_y.multiply_add(&of.end.k_y, -1.0, moved, out);
        of_own[0].multiply_add(end_k_tau, -1.0, tau, out);
    }

    /// The changes of the points by dV_i, and dy1.
    fn move_points(&mut self, linear: &LinearStep, stages: &Stages, step: Step) {
        let (tableau, offsets) = (&stages.tableau, linear.places().0);
        let d_v = self.right[offsets.v..].chunks_exact(linear.problem.n);
        for (j, d_v) in (0..tableau.stages).zip(d_v) {
            copy_scaled(self.displacements.row_mut(j), step.h * tableau.b[j], d_v);
        }
        combine(
            self.stages.flat_mut(),
            &tableau.mu_v,
            &self.displacements,
            as_is,
        );
        copy(&mut self.y, self.nodes.row(tableau.intervals));
        combine(
            self.nodes.flat_mut(),
            &tableau.mu_bar,
            &self.displacements,
            as_is,
        );
        add_scaled(&mut self.y, 1.0, self.nodes.row(tableau.intervals));
    }

    /// Adds to the impulses their changes by the points, dZ_i and dΛ_j.
    fn add_impulses(&mut self, linear: &LinearStep, stages: &Stages, step: Step) {
        let (at, tableau) = (&linear.problem.patterns, &stages.tableau);
        let (n, m, offsets) = (linear.problem.n, linear.problem.m, linear.places().0);
        let d_z = self.right[..offsets.lam].chunks_exact(n);
        for (j, d_z) in (0..tableau.stages).zip(d_z) {
            let (weight, out) = (step.h * tableau.b[j], self.impulses.row_mut(j));
            at.f_y.multiply_add(
                linear.derivatives.f_y.row(j),
                weight,
                self.stages.row(j),
                out,
            );
            at.f_z
                .multiply_add(linear.derivatives.f_z.row(j), weight, d_z, out);
        }
        for j in 0..self.nodes.rows() {
            let (weight, out) = (tableau.b_hat[j], self.impulses.row_mut(tableau.stages + j));
            at.r_y.multiply_add(
                linear.derivatives.r_y.row(j),
                step.h * weight,
                self.nodes.row(j),
                out,
            );
        }
        let d_lam = self.right[offsets.lam..offsets.nu].chunks_exact(m.max(1));
        for (j, d_lam) in d_lam.enumerate() {
            let (weight, out) = (tableau.b_hat[j], self.impulses.row_mut(tableau.stages + j));
            at.r_lam
                .multiply_add(linear.derivatives.r_lam.row(j), weight, d_lam, out);
        }
        if let Some(LinearNonholonomic { at, of, .. }) = linear.nonholonomic() {
            let (first, l) = (tableau.stages + self.nodes.rows(), linear.problem.l());
            for (j, b) in tableau.b.iter().enumerate() {
                let (d_y, d_z) = (self.stages.row(j), &self.right[j * n..(j + 1) * n]);
                let d_nu = &self.right[offsets.nu + j * l..offsets.nu + (j + 1) * l];
                let out = self.impulses.row_mut(first + j);
                at.r_y.multiply_add(of.r_y.row(j), step.h * b, d_y, out);
                at.r_z.multiply_add(of.r_z.row(j), step.h * b, d_z, out);
                at.r_nu.multiply_add(of.r_nu.row(j), *b, d_nu, out);
            }
        }
    }

    /// Writes the tangent at the end of the step.
    fn finish(
        &mut self,
        (linear, model): (&mut LinearStep, &Model),
        directions: &mut Directions,
        along: StepAlong,
        state: &mut TangentState,
    ) {
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (end, direction) = (&mut linear.end, along.direction);
        let is_together = linear.problem.l() > 0;
        let tau = along.tau(directions, 1.0);
        let (dp, momentum, hidden) = (
            state.carried.row_mut(direction),
            &mut self.momentum,
            &mut self.hidden,
        );
        for impulse in self.impulses.flat().chunks_exact(dp.len()) {
            add_scaled(dp, 1.0, impulse);
        }
        if is_together {
            let first = self.stages.flat().len();
            copy(momentum, &self.right[first..first + dp.len()]);
        } else {
            copy(momentum, dp);
            at.p_y.multiply_add(&end.p_y, -1.0, &self.y, momentum);
            by_tau.p_tau.multiply_add(&end.p_tau, -1.0, tau, momentum);
            hidden.fill(0.0);
            by_tau.w_y.multiply_add(&end.w_y, -1.0, &self.y, hidden);
            by_tau.w_tau.multiply_add(&end.w_tau, -1.0, tau, hidden);
            end.matrix.solve(model, momentum, hidden);
            at.r_lam.multiply_add(end.matrix.r_lam(), 1.0, hidden, dp);
        }
        copy(state.y.row_mut(direction), &self.y);
        copy(state.z.row_mut(direction), momentum);
        state.t[direction] = along.time(1.0);
    }
}
