//! Adjoint of one step: the transpose of its tangent, from cotangents of the end to those of the start, of τ and of h.
//!
//! The steps are those of the tangent in reverse order. With π the cotangent of p1 before the last reaction,
//!
//!     Jᵀ (η_i, ν_j, σ_i) = (h b_i f_zᵀ π,  b̂_j r_λᵀ π,  h b_i (Σ_l μᵛ_li χ_l + Σ_l μ̄_li ξ_l))
//!     χ_l = h b_l f_yᵀ π,   ξ_l = h b̂_l r_yᵀ π, and ȳ1 too where l = k
//!
//! and then f_y, r_y, p_y, v_y and g_y transposed take η, ν and σ to cotangents of y0, as derivatives by τ do to those of τ.
//! By the symplecticity of the coefficients this is the same method on the adjoint equations. Source: sanzserna2016.
//!
//! With nonholonomic constraints the end is solved for with the stages, and its cotangents come of Jᵀ too: z̄1 is on the
//! right, π that of its momenta. There the adjoint is another method, whose multipliers and constraints change places.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::super::stages::Stages;
use super::equations::StepMatrix;
use super::linear_step::LinearStep;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, copy, dot};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use liouville_base::tableau;
use liouville_problem::{Cotangents, Mechanical, Model, Step};

/// The memory of an adjoint step.
#[derive(Clone, Debug)]
pub(super) struct Backward<R = f64> {
    /// Cotangents of Y_i and Ŷ_j, first those of the parts by V_j, then of e(Y_i) and e(Ŷ_j).
    stages: Matrix<R>,
    nodes: Matrix<R>,
    right: Vec<R>,
    /// Cotangent of an impulse.
    impulse: Vec<R>,
    y: Vec<R>,
    momentum: Vec<R>,
    hidden: Vec<R>,
    /// Of k at a stage.
    nonholonomic: Vec<R>,
}

impl<R: Real> Backward<R> {
    pub(super) fn new(problem: &Mechanical, tableau: &tableau::Spark, order: usize) -> Self {
        let (n, s, k) = (problem.n, tableau.stages, tableau.intervals);
        Self {
            stages: Matrix::zeros(s, n),
            nodes: Matrix::zeros(k + 1, n),
            right: vec![R::splat(0.0); order],
            impulse: vec![R::splat(0.0); n],
            y: vec![R::splat(0.0); n],
            momentum: vec![R::splat(0.0); n],
            hidden: vec![R::splat(0.0); problem.m],
            nonholonomic: vec![R::splat(0.0); problem.l()],
        }
    }

    /// Takes cotangents from the end of a linearised step to its start.
    ///
    /// # Errors
    /// A singular matrix.
    pub(super) fn follow(
        &mut self,
        (linear, matrix): (&mut LinearStep<R>, &mut impl StepMatrix<R>),
        (model, stages): (&Model<R>, &Stages<R>),
        step: Step<R>,
        cotangents: &mut Cotangents<R>,
    ) -> Result<(), StepError> {
        // dt1 = dt0 + h stretch
        cotangents.stretch += cotangents.tau[0] * step.h;
        copy(&mut self.y, &cotangents.y);
        let is_together = linear.problem.l() > 0;
        if !is_together {
            self.solve_end((linear, model), cotangents);
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                if !is_together {
                    self.leave_end(linear, step, cotangents);
                }
                self.set_right(linear, stages, step, cotangents);
            },
        );
        matrix.solve_transposed_at((model, stages), &linear.derivatives, &mut self.right)?;
        if is_together {
            self.take_end(linear, stages);
            self.leave_end(linear, step, cotangents);
        }
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.enter(linear, stages, step, cotangents),
        );
        Ok(())
    }

    /// Finds cotangents of the momenta and of the hidden constraints at the end, from those of z1.
    fn solve_end(
        &mut self,
        (linear, model): (&mut LinearStep<R>, &Model<R>),
        cotangents: &Cotangents<R>,
    ) {
        let (at, end) = (&linear.problem.patterns, &mut linear.end);
        copy(&mut self.momentum, &cotangents.z);
        self.hidden.fill(R::splat(0.0));
        at.r_lam.multiply_add_transposed(
            end.matrix.r_lam(),
            1.0,
            &cotangents.carried,
            &mut self.hidden,
        );
        end.matrix
            .solve_transposed(model, &mut self.momentum, &mut self.hidden);
    }

    /// Takes them from the solution, where the end is solved for with the stages, and those of k at the end.
    fn take_end(&mut self, linear: &LinearStep<R>, stages: &Stages<R>) {
        let (offsets, tableau) = (linear.places().0, &stages.tableau);
        let (n, m, l) = (linear.problem.n, linear.problem.m, linear.problem.l());
        let (momenta, hidden) = (tableau.stages * n, offsets.lam + tableau.intervals * m);
        copy(&mut self.momentum, &self.right[momenta..momenta + n]);
        copy(&mut self.hidden, &self.right[hidden..hidden + m]);
        copy(
            &mut self.nonholonomic,
            &self.right[offsets.order - l..offsets.order],
        );
    }

    /// Takes these to those of y1 and of all impulses, which `cotangents.carried` is then.
    #[inline(always)]
    fn leave_end(&mut self, linear: &LinearStep<R>, step: Step<R>, cotangents: &mut Cotangents<R>) {
        let (at, by_tau, end) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
            &linear.end,
        );
        add_scaled(&mut cotangents.carried, 1.0, &self.momentum);
        at.p_y
            .multiply_add_transposed(&end.p_y, -1.0, &self.momentum, &mut self.y);
        by_tau
            .w_y
            .multiply_add_transposed(&end.w_y, -1.0, &self.hidden, &mut self.y);
        let (before, tau) = (cotangents.tau[0], &mut cotangents.tau);
        by_tau
            .p_tau
            .multiply_add_transposed(&end.p_tau, -1.0, &self.momentum, tau);
        by_tau
            .w_tau
            .multiply_add_transposed(&end.w_tau, -1.0, &self.hidden, tau);
        if let Some(own) = linear.nonholonomic() {
            let (k_y, k_tau) = (&own.at.k_y, &own.by_tau[0]);
            k_y.multiply_add_transposed(&own.of.end.k_y, -1.0, &self.nonholonomic, &mut self.y);
            k_tau.multiply_add_transposed(own.end_k_tau, -1.0, &self.nonholonomic, tau);
        }
        cotangents.stretch += (cotangents.tau[0] - before) * step.h;
    }

    /// Writes the right-hand sides of the transposed stage equations.
    #[inline(always)]
    fn set_right(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        step: Step<R>,
        of: &Cotangents<R>,
    ) {
        let (at, tableau) = (&linear.problem.patterns, &stages.tableau);
        let (n, m, offsets) = (linear.problem.n, linear.problem.m, linear.places().0);
        self.right.fill(R::splat(0.0));
        self.stages.clear();
        self.nodes.clear();
        let last = tableau.intervals;
        add_scaled(self.nodes.row_mut(last), 1.0, &self.y);
        for j in 0..tableau.stages {
            let weight = step.h * tableau.b[j];
            let f_z = linear.derivatives.f_z.row(j);
            let out = &mut self.right[j * n..(j + 1) * n];
            at.f_z
                .multiply_add_transposed(f_z, weight, &of.carried, out);
            let out = self.stages.row_mut(j);
            at.f_y
                .multiply_add_transposed(linear.derivatives.f_y.row(j), weight, &of.carried, out);
        }
        for j in 0..=last {
            let weight = step.h * tableau.b_hat[j];
            let out = self.nodes.row_mut(j);
            at.r_y
                .multiply_add_transposed(linear.derivatives.r_y.row(j), weight, &of.carried, out);
        }
        if let Some(own) = linear.nonholonomic() {
            let l = linear.problem.l();
            for (j, b) in tableau.b.iter().enumerate() {
                let (weight, out) = (step.h * b, &mut self.right[j * n..(j + 1) * n]);
                let (r_z, r_y, r_nu) = (own.of.r_z.row(j), own.of.r_y.row(j), own.of.r_nu.row(j));
                own.at
                    .r_z
                    .multiply_add_transposed(r_z, weight, &of.carried, out);
                let out = self.stages.row_mut(j);
                own.at
                    .r_y
                    .multiply_add_transposed(r_y, weight, &of.carried, out);
                let out = &mut self.right[offsets.nu + j * l..offsets.nu + (j + 1) * l];
                own.at
                    .r_nu
                    .multiply_add_transposed(r_nu, *b, &of.carried, out);
            }
            let first = tableau.stages * n;
            copy(&mut self.right[first..first + n], &of.z);
        }
        let rows = self.right[offsets.lam..offsets.nu].chunks_exact_mut(m.max(1));
        for (j, out) in rows.enumerate() {
            let weight = tableau.b_hat[j];
            at.r_lam.multiply_add_transposed(
                linear.derivatives.r_lam.row(j),
                weight,
                &of.carried,
                out,
            );
        }
        let rows = self.right[offsets.v..].chunks_exact_mut(n);
        for (j, out) in (0..tableau.stages).zip(rows) {
            let weight = step.h * tableau.b[j];
            for i in 0..tableau.stages {
                add_scaled(out, weight * tableau.mu_v[(i, j)], self.stages.row(i));
            }
            for i in 0..=last {
                add_scaled(out, weight * tableau.mu_bar[(i, j)], self.nodes.row(i));
            }
        }
    }

    /// From the solution to cotangents of the start.
    #[inline(always)]
    fn enter(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        step: Step<R>,
        of: &mut Cotangents<R>,
    ) {
        let (tableau, n) = (&stages.tableau, linear.problem.n);
        self.stages.clear();
        self.nodes.clear();
        add_scaled(self.nodes.row_mut(tableau.intervals), 1.0, &self.y);
        for i in 0..tableau.stages {
            self.enter_stage(linear, stages, step, i, of);
        }
        for j in 0..=tableau.intervals {
            self.enter_node(linear, stages, step, j, of);
        }
        for row in self.right[..tableau.stages * n].chunks_exact(n) {
            add_scaled(&mut of.carried, 1.0, row);
        }
        of.y.fill(R::splat(0.0));
        for (moved, weights) in [
            (&self.stages, &tableau.mu_v),
            (&self.nodes, &tableau.mu_bar),
        ] {
            for i in 0..moved.rows() {
                add_scaled(&mut of.y, 1.0, moved.row(i));
                for j in 0..tableau.stages {
                    let led = stages.displacements.row(j);
                    of.stretch += dot(led, moved.row(i)) * weights[(i, j)];
                }
            }
        }
        of.z.fill(R::splat(0.0));
    }

    /// The cotangent of the impulse in column `j` of the weights.
    #[inline(always)]
    fn weigh(&mut self, stages: &Stages<R>, n: usize, j: usize, of: &Cotangents<R>) {
        copy(&mut self.impulse, &of.carried);
        let weights = &stages.force_weights;
        if j < weights.cols() {
            for (i, row) in self.right.chunks_exact(n).take(weights.rows()).enumerate() {
                add_scaled(&mut self.impulse, weights[(i, j)], row);
            }
        }
    }

    #[inline(always)]
    fn enter_stage(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        step: Step<R>,
        i: usize,
        of: &mut Cotangents<R>,
    ) {
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (n, tableau, slopes) = (linear.problem.n, &stages.tableau, &linear.derivatives);
        self.weigh(stages, n, i, of);
        of.stretch += dot(stages.impulses.row(i), &self.impulse);
        let (weight, own) = (step.h * tableau.b[i], &self.right[i * n..(i + 1) * n]);
        let out = self.stages.row_mut(i);
        at.f_y
            .multiply_add_transposed(linear.derivatives.f_y.row(i), weight, &self.impulse, out);
        at.p_y
            .multiply_add_transposed(slopes.p_y.row(i), -1.0, own, out);
        let (before, tau) = (of.tau[0], &mut of.tau);
        by_tau
            .f_tau
            .multiply_add_transposed(linear.f_tau.row(i), weight, &self.impulse, tau);
        by_tau
            .p_tau
            .multiply_add_transposed(linear.p_tau.row(i), -1.0, own, tau);
        if let Some(v_tau) = &by_tau.v_tau {
            let first = linear.places().0.v + i * n;
            let own = &self.right[first..first + n];
            at.v_y
                .multiply_add_transposed(slopes.v_y.row(i), 1.0, own, out);
            v_tau.multiply_add_transposed(linear.v_tau.row(i), 1.0, own, tau);
        }
        self.enter_rolling(linear, stages, step, i, of);
        of.stretch += (of.tau[0] - before) * (tableau.c[i] * step.h);
    }

    /// Nonholonomic constraints at a stage, and their reactions.
    #[inline(always)]
    fn enter_rolling(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        step: Step<R>,
        i: usize,
        of: &mut Cotangents<R>,
    ) {
        let Some(own) = linear.nonholonomic() else {
            return;
        };
        let (n, l, tableau) = (linear.problem.n, linear.problem.l(), &stages.tableau);
        let (column, offsets) = (
            tableau.stages + tableau.intervals + 1 + i,
            linear.places().0,
        );
        self.weigh(stages, n, column, of);
        of.stretch += dot(stages.impulses.row(column), &self.impulse);
        self.nonholonomic.fill(R::splat(0.0));
        let moments = self.right[offsets.nu..offsets.order - l].chunks_exact(l);
        for (row, moment) in moments.enumerate() {
            add_scaled(&mut self.nonholonomic, own.moments[(row, i)], moment);
        }
        let (weight, dy, tau) = (step.h * tableau.b[i], self.stages.row_mut(i), &mut of.tau);
        let (at, [k_tau, rn_tau]) = (own.at, own.by_tau);
        at.r_y
            .multiply_add_transposed(own.of.r_y.row(i), weight, &self.impulse, dy);
        rn_tau.multiply_add_transposed(own.rn_tau.row(i), weight, &self.impulse, tau);
        at.k_y
            .multiply_add_transposed(own.of.k_y.row(i), -1.0, &self.nonholonomic, dy);
        k_tau.multiply_add_transposed(own.k_tau.row(i), -1.0, &self.nonholonomic, tau);
    }

    #[inline(always)]
    fn enter_node(
        &mut self,
        linear: &LinearStep<R>,
        stages: &Stages<R>,
        step: Step<R>,
        j: usize,
        of: &mut Cotangents<R>,
    ) {
        let (at, by_tau) = (
            &linear.problem.patterns,
            &linear.sensitivity.problem.patterns,
        );
        let (n, m, tableau) = (linear.problem.n, linear.problem.m, &stages.tableau);
        self.weigh(stages, n, tableau.stages + j, of);
        of.stretch += dot(stages.impulses.row(tableau.stages + j), &self.impulse);
        let weight = step.h * tableau.b_hat[j];
        let out = self.nodes.row_mut(j);
        at.r_y
            .multiply_add_transposed(linear.derivatives.r_y.row(j), weight, &self.impulse, out);
        let (before, tau) = (of.tau[0], &mut of.tau);
        by_tau
            .r_tau
            .multiply_add_transposed(linear.r_tau.row(j), weight, &self.impulse, tau);
        if let Some(row) = j.checked_sub(1) {
            let first = linear.places().0.lam + row * m;
            let (own, weight) = (&self.right[first..first + m], -1.0 / step.h);
            let g_y = linear.derivatives.g_y.row(j);
            at.g_y.multiply_add_transposed(g_y, weight, own, out);
            by_tau
                .g_tau
                .multiply_add_transposed(linear.g_tau.row(j), weight, own, tau);
        }
        of.stretch += (of.tau[0] - before) * (tableau.c_hat[j] * step.h);
    }
}
