//! The end of a step: (U1), then z1 and λ_k from (U2) and (U3).
//!
//! Nonholonomic constraints hold at that point up to roundoff; impulses of their reactions at t1, of the size of
//! roundoff, remove the rest.
//!
//! Where the stage equations are solved to a tolerance, y1 is off the constraints by as much, and is projected first.
//!
//! Increments are summed first and added last, and the rounding errors of both are carried in the low part: those of
//! sums in a fixed order are not random, and would make the energy drift.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::stages::Stages;
use liouville_base::compensated::Compensated;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{
    add_compensated, add_scaled, copy, copy_scaled, max_norm, sum_compensated,
};
use liouville_base::newton::{Damped, Projection, solve_damped};
use liouville_base::real::Real;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_problem::{Model, Saddle, State, Step, finite, finite_k};

/// The state at the end of a step, while it is solved for.
#[derive(Clone, Debug)]
pub(super) struct Update<R = f64> {
    pub(super) z: Vec<R>,
    pub(super) v: Vec<R>,
    y: Vec<R>,
    y_low: Vec<R>,
    p: Vec<R>,
    p_low: Vec<R>,
    /// Rounding errors of the sums of increments.
    y_lost: Vec<R>,
    p_lost: Vec<R>,
    saddle: Saddle<R>,
    /// r at t1, as (U2) has it.
    reaction: Vec<R>,
    momentum: Vec<R>,
    /// Corrections of w = 0, then of k = 0.
    hidden: Vec<R>,
    /// λ_k and ν_s.
    multipliers: Vec<R>,
    /// Where the last matrix was made, and the correction there.
    from: EndPoint<R>,
    taken: EndPoint<R>,
}

/// The unknowns of the end: z1, λ_k times its weight, and the impulses of ν.
#[derive(Clone, Debug)]
struct EndPoint<R> {
    z: Vec<R>,
    lam: Vec<R>,
    impulse: Vec<R>,
}

struct EndEquations<'a, R> {
    update: &'a mut Update<R>,
    model: &'a mut Model<R>,
    stages: &'a mut Stages<R>,
    step: Step<'a, R>,
}

impl<R: Real> Update<R> {
    pub(super) fn new(model: &Model<R>) -> Self {
        let zeros = vec![R::splat(0.0); model.problem.n];
        let end = EndPoint {
            z: zeros.clone(),
            lam: vec![R::splat(0.0); model.problem.m],
            impulse: zeros.clone(),
        };
        Self {
            from: end.clone(),
            taken: end,
            z: zeros.clone(),
            v: zeros.clone(),
            y: zeros.clone(),
            y_low: zeros.clone(),
            p: zeros.clone(),
            p_low: zeros.clone(),
            y_lost: zeros.clone(),
            p_lost: zeros.clone(),
            saddle: Saddle::new(model),
            reaction: zeros.clone(),
            momentum: zeros,
            hidden: vec![R::splat(0.0); model.problem.multipliers()],
            multipliers: vec![R::splat(0.0); model.problem.multipliers()],
        }
    }

    /// y1, and the increment of p without the last reaction.
    #[inline(always)]
    fn accumulate(&mut self, stages: &Stages<R>, state: &State<R>) {
        let (s, k) = (stages.tableau.stages, stages.tableau.intervals);
        copy(&mut self.y_low, &state.y_low);
        copy(&mut self.p_low, &state.p_low);
        self.y_lost.fill(R::splat(0.0));
        self.p_lost.fill(R::splat(0.0));
        for j in 0..s {
            add_compensated(
                &mut self.y_low,
                &mut self.y_lost,
                stages.displacements.row(j),
            );
            add_scaled(&mut self.y_lost, 1.0, stages.lost_displacements.row(j));
        }
        for j in 0..s + k {
            add_compensated(&mut self.p_low, &mut self.p_lost, stages.impulses.row(j));
        }
        for j in s + k + 1..stages.impulses.rows() {
            add_compensated(&mut self.p_low, &mut self.p_lost, stages.impulses.row(j));
        }
        sum_compensated(&state.y, &mut self.y_low, &mut self.y);
        add_scaled(&mut self.y_low, 1.0, &self.y_lost);
    }

    /// Finds the end of the step; `z` holds a guess before and z1 afterwards.
    pub(super) fn solve(
        &mut self,
        model: &mut Model<R>,
        stages: &mut Stages<R>,
        step: Step<R>,
    ) -> Result<(), StepError> {
        dispatch_simd_long::<R, _>(
            step.state.y.len(),
            #[inline(always)]
            || self.find(model, stages, step),
        )
    }

    #[inline(always)]
    fn find(
        &mut self,
        model: &mut Model<R>,
        stages: &mut Stages<R>,
        step: Step<R>,
    ) -> Result<(), StepError> {
        let k = stages.tableau.intervals;
        let (h, state) = (step.h, step.state);
        self.accumulate(stages, state);
        if model.problem.m > 0 {
            self.project(model, stages, stages.node_time(step, k))?;
        }
        let is_linear = model.problem.is_linear;
        let mut solve = EndEquations {
            update: self,
            model,
            stages,
            step,
        };
        if is_linear {
            solve.find(true)?;
        } else {
            solve_damped(&mut solve)?;
        }
        solve.finish();

        let impulse = &mut self.momentum;
        copy_scaled(impulse, h * stages.tableau.b_hat[k], &self.reaction);
        add_compensated(&mut self.p_low, &mut self.p_lost, impulse);
        sum_compensated(&state.p, &mut self.p_low, &mut self.p);
        add_scaled(&mut self.p_low, 1.0, &self.p_lost);
        if model.problem.patterns.v_z.is_some() {
            let t = stages.node_time(step, k);
            copy(&mut self.v, model.end(t, &self.y, &self.z)[2]);
        } else {
            copy(&mut self.v, &self.z);
        }
        Ok(())
    }

    /// Moves y1 onto the constraints at t1, along v_z p_z⁻¹ r_λ.
    #[inline(always)]
    fn project(
        &mut self,
        model: &mut Model<R>,
        stages: &Stages<R>,
        t: f64,
    ) -> Result<(), StepError> {
        let mut projection = Projection::new(stages.stop);
        if !projection.is_wanted() {
            return Ok(());
        }
        self.take_multipliers(stages);
        (self.saddle).update(model, t, &self.y, &self.z, &self.multipliers)?;
        let m = model.problem.m;
        while projection.is_wanted() {
            let [g, _] = model.node(t, &self.y, &self.multipliers[..m]);
            finite(g, Quantity::Constraint, t)?;
            self.hidden.fill(R::splat(0.0));
            copy_scaled(&mut self.hidden[..m], -1.0, g);
            self.momentum.fill(R::splat(0.0));
            self.saddle
                .solve(model, &mut self.momentum, &mut self.hidden);
            self.v.fill(R::splat(0.0));
            self.saddle.mass.add_velocity(&self.momentum, &mut self.v);
            let taken = projection.take(max_norm(&self.v), max_norm(&self.y));
            for ((y, low), moved) in self.y.iter_mut().zip(&mut self.y_low).zip(&self.v) {
                let sum = Compensated::sum(*y, *low + *moved);
                (*y, *low) = (taken.choose(sum.high, *y), taken.choose(sum.low, *low));
            }
        }
        Ok(())
    }

    /// λ_k and ν_s, one after the other.
    #[inline(always)]
    fn take_multipliers(&mut self, stages: &Stages<R>) {
        let lam = stages.unknowns.lam.row(stages.tableau.intervals);
        let nu = stages.unknowns.nu.row(stages.tableau.stages - 1);
        copy(&mut self.multipliers[..lam.len()], lam);
        copy(&mut self.multipliers[lam.len()..], nu);
    }

    /// Keeps where the matrix was made, and the correction there.
    fn keep(&mut self, model: &Model<R>, lam: &[R]) {
        let (from, taken) = (&mut self.from, &mut self.taken);
        copy(&mut from.z, &self.z);
        copy(&mut from.lam, lam);
        copy(&mut from.impulse, &self.p_low);
        let (d_lam, d_nu) = self.hidden.split_at(lam.len());
        copy(&mut taken.z, &self.momentum);
        copy(&mut taken.lam, d_lam);
        taken.impulse.fill(R::splat(0.0));
        (self.saddle).add_nonholonomic(model, d_nu, &mut taken.impulse);
    }

    /// The end becomes the state.
    pub(super) fn commit(&self, state: &mut State<R>) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                copy(&mut state.y, &self.y);
                copy(&mut state.z, &self.z);
                copy(&mut state.p, &self.p);
                copy(&mut state.y_low, &self.y_low);
                copy(&mut state.p_low, &self.p_low);
            },
        );
    }
}

impl<R: Real> Damped<R> for EndEquations<'_, R> {
    fn find(&mut self, is_new: bool) -> Result<R, StepError> {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.find_correction(is_new),
        )
    }

    fn take(&mut self, part: f64) {
        let update = &mut *self.update;
        let weight = self.step.h * self.stages.tableau.b_hat[self.stages.tableau.intervals];
        let lam = self
            .stages
            .unknowns
            .lam
            .row_mut(self.stages.tableau.intervals);
        let (from, taken) = (&update.from, &update.taken);
        for (out, from, taken, factor) in [
            (&mut update.z[..], &from.z, &taken.z, part),
            (lam, &from.lam, &taken.lam, part / weight),
            (&mut update.p_low[..], &from.impulse, &taken.impulse, part),
        ] {
            copy(out, from);
            add_scaled(out, factor, taken);
        }
    }
}

impl<R: Real> EndEquations<'_, R> {
    /// The corrections of z1 and Λ_k in `momentum` and `hidden`; its size is that of both in velocities.
    #[inline(always)]
    fn find_correction(&mut self, is_new: bool) -> Result<R, StepError> {
        let (update, model) = (&mut *self.update, &mut *self.model);
        let (stages, step) = (&mut *self.stages, self.step);
        let k = stages.tableau.intervals;
        let t = stages.node_time(step, k);
        let weight = step.h * stages.tableau.b_hat[k];
        let m = model.problem.m;
        let nu = stages.unknowns.nu.row(stages.tableau.stages - 1);
        if is_new {
            update.take_multipliers(stages);
            let (y, z) = (&update.y, &update.z);
            update.saddle.update(model, t, y, z, &update.multipliers)?;
        }
        copy(&mut update.momentum, &update.p_low);
        if model.problem.m > 0 {
            let [_, r] = model.node(t, &update.y, stages.unknowns.lam.row(k));
            finite(r, Quantity::Reaction, t)?;
            copy(&mut update.reaction, r);
            add_scaled(&mut update.momentum, weight, r);
        }
        let [p, w, _] = model.end(t, &update.y, &update.z);
        finite(p, Quantity::Momentum, t)?;
        finite(w, Quantity::Hidden, t)?;
        for ((out, p), p0) in update.momentum.iter_mut().zip(p).zip(&step.state.p) {
            *out -= *p - *p0;
        }
        copy_scaled(&mut update.hidden, -1.0, w);
        if !nu.is_empty() {
            let [k, _] = model.nonholonomic(t, &update.y, &update.z, nu);
            finite_k(k, m, t)?;
            copy_scaled(&mut update.hidden[m..], -1.0, k);
        }
        let (momentum, hidden) = (&mut update.momentum, &mut update.hidden);
        update.saddle.solve(model, momentum, hidden);
        if model.problem.is_linear {
            return Ok(R::splat(0.0));
        }
        if is_new {
            update.keep(model, stages.unknowns.lam.row(k));
        }
        update.v.fill(R::splat(0.0));
        let mass = &update.saddle.mass;
        mass.add_velocity(&update.momentum, &mut update.v);
        let of_multipliers = update.saddle.velocity_of(model, &update.hidden);
        Ok(stages.relative_to_speed(max_norm(&update.v) + of_multipliers, step))
    }

    /// Takes the last correction.
    #[inline(always)]
    fn finish(&mut self) {
        let (update, model) = (&mut *self.update, &*self.model);
        let k = self.stages.tableau.intervals;
        let weight = self.step.h * self.stages.tableau.b_hat[k];
        add_scaled(&mut update.z, 1.0, &update.momentum);
        let (d_lam, d_nu) = update.hidden.split_at_mut(model.problem.m);
        for x in d_lam.iter_mut() {
            *x *= R::splat(1.0 / weight);
        }
        add_scaled(self.stages.unknowns.lam.row_mut(k), 1.0, d_lam);
        (update.saddle).add_reaction(model, d_lam, &mut update.reaction);
        (update.saddle).add_nonholonomic(model, d_nu, &mut update.p_low);
    }
}
