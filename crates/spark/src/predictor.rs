//! Start values of the stages: from the polynomials of the step before, or cold.
//!
//! Extrapolated: the polynomial through {z0, Z_1..Z_s, z1} at {0, c, 1}, and that through λ_0..λ_k at
//! the nodes, both evaluated one step on. Cold: z0' and λ from the acceleration-level solve,
//! Z_i = z0 + c_i h z0'. Uniform, where stiff forces would move that start far away: Z_i = z0.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::stages::{Stages, Unknowns};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, copy};
use liouville_base::newton::{self, Polynomial};
use liouville_base::real::Real;
use liouville_base::recorder;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_base::tableau;
use liouville_problem::{Acceleration, Dynamics, Model, State, Step};
use liouville_small::{LAM, Z};

/// Start values of the next step.
#[derive(Clone, Debug)]
pub(super) struct Predictor<R = f64> {
    acceleration: Acceleration<R>,
    velocity_is_z: bool,
    /// z0, Z_1..Z_s, z1; λ at the nodes; ν at the stages.
    pub(super) held: newton::Predictor<R>,
    /// v0, V_1..V_s, v1 where v is not z; a cold start writes v0.
    v: Matrix<R>,
}

/// The curve of ν, after those of Z and λ.
const NU: usize = 2;

impl<R: Real> Predictor<R> {
    pub(super) fn new(model: &Model<R>, tableau: &tableau::Spark) -> Self {
        let (n, m, l) = (model.problem.n, model.problem.m, model.problem.l());
        let nodes = [&[0.0], &tableau.c[..], &[1.0]].concat();
        let velocity_is_z = model.problem.patterns.v_z.is_none();
        let (c, c_hat) = (&tableau.c[..], &tableau.c_hat[..]);
        let (rows, width) = (nodes.len(), if velocity_is_z { 0 } else { n });
        Self {
            acceleration: Acceleration::new(model),
            velocity_is_z,
            held: newton::Predictor::new(vec![
                Polynomial::new(&nodes, c, n),
                Polynomial::new(c_hat, c_hat, m),
                Polynomial::new(c, c, l),
            ]),
            v: Matrix::zeros(rows, width),
        }
    }

    /// The sources of start values: the step before, and the accelerations.
    pub(super) fn start(&mut self) -> (&mut newton::Predictor<R>, &mut Acceleration<R>) {
        (&mut self.held, &mut self.acceleration)
    }

    /// Forgets the polynomials: the next start is cold.
    pub(super) fn forget(&mut self) {
        self.held.forget();
    }

    /// Forgets all of a run.
    pub(super) fn reset(&mut self) {
        self.held.reset();
        self.acceleration.reset();
    }

    /// Writes the extrapolated unknowns and `z1`; says whether there was a step to extrapolate.
    pub(super) fn extrapolate(
        &mut self,
        stages: &mut Stages<R>,
        z1: &mut [R],
        step: Step<R>,
    ) -> bool {
        if !self.held.update_weights(step.h) {
            return false;
        }
        let held = self.velocities();
        let start = if self.held.is_undone() {
            0
        } else {
            held.rows() - 1
        };
        stages.begin(step, held.row(start), self.acceleration.borne);
        dispatch_simd_long::<R, _>(
            z1.len(),
            #[inline(always)]
            || self.write_start(&mut stages.unknowns, z1),
        );
        true
    }

    #[inline(always)]
    fn write_start(&self, unknowns: &mut Unknowns<R>, z1: &mut [R]) {
        let Unknowns { z, v, lam, nu } = unknowns;
        let curves = &self.held.curves;
        curves[Z].extrapolate(z.flat_mut());
        if self.velocity_is_z {
            // their difference is no residual, so equal starts must keep them equal
            copy(v.flat_mut(), z.flat());
        } else {
            curves[Z].extrapolate_other(&self.v, v.flat_mut());
        }
        curves[Z].extrapolate_end(z1);
        curves[LAM].extrapolate(lam.flat_mut());
        curves[NU].extrapolate(nu.flat_mut());
    }

    /// Writes the cold start, or the uniform one, without z'.
    pub(super) fn start_cold(
        &mut self,
        model: &mut Model<R>,
        stages: &mut Stages<R>,
        z1: &mut [R],
        step: Step<R>,
        is_uniform: bool,
    ) -> Result<(), StepError> {
        let Step { t, h, state } = step;
        let lag = if is_uniform { 0.0 } else { h };
        self.acceleration.begin(model, (t, h), &state.y, &state.z)?;
        let z_dot = &self.acceleration.z_dot;
        let [_, _, v] = model.end(t, &state.y, &state.z);
        if !self.velocity_is_z {
            self.v.row_mut(0).copy_from_slice(v);
        }
        let velocity = if self.velocity_is_z {
            &state.z
        } else {
            self.v.row(0)
        };
        stages.begin(step, velocity, self.acceleration.borne);
        for i in 0..stages.tableau.stages {
            let (c, t) = (stages.tableau.c[i], stages.stage_time(step, i));
            let z = stages.unknowns.z.row_mut(i);
            z.copy_from_slice(&state.z);
            add_scaled(z, c * lag, z_dot);
            let y = stages.y.row_mut(i);
            y.copy_from_slice(&state.y);
            add_scaled(y, c * h, velocity);
            let [_, _, v] = model.stage(t, y, z);
            let v = if v.is_empty() { &*z } else { v };
            copy(stages.unknowns.v.row_mut(i), v);
        }
        z1.copy_from_slice(&state.z);
        add_scaled(z1, lag, z_dot);
        let (lam, nu) = self.acceleration.lam.split_at(model.problem.m);
        for j in 0..=stages.tableau.intervals {
            stages.unknowns.lam.row_mut(j).copy_from_slice(lam);
        }
        for i in 0..stages.tableau.stages {
            stages.unknowns.nu.row_mut(i).copy_from_slice(nu);
        }
        if !model.problem.is_linear && model.problem.m > 0 {
            self.find_node_multipliers(model, stages, step);
        }
        Ok(())
    }

    /// Writes λ of each node on from the start of the step, by the accelerations there: reactions that are not linear in it
    /// may be far from those at the start.
    #[cold]
    fn find_node_multipliers(
        &mut self,
        model: &mut Model<R>,
        stages: &mut Stages<R>,
        step: Step<R>,
    ) {
        let Step { h, state, .. } = step;
        for j in 1..=stages.tableau.intervals {
            let t = stages.node_time(step, j);
            let y = stages.node_y.row_mut(j);
            y.copy_from_slice(&state.y);
            add_scaled(y, stages.tableau.c_hat[j] * h, &stages.v0);
            if self.acceleration.solve(model, t, y, &state.z).is_err() {
                break;
            }
            let lam = &self.acceleration.lam[..model.problem.m];
            stages.unknowns.lam.row_mut(j).copy_from_slice(lam);
        }
    }

    /// Keeps the polynomials of a finished step from `z0` to `z1`, where v is `v1`.
    pub(super) fn keep(&mut self, stages: &Stages<R>, h: f64, z0: &[R], z1: &[R], v1: &[R]) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.keep_points(stages, z0, z1, v1),
        );
        self.held.hold(h);
    }

    #[inline(always)]
    fn keep_points(&mut self, stages: &Stages<R>, z0: &[R], z1: &[R], v1: &[R]) {
        let s = stages.tableau.stages;
        if !self.velocity_is_z && self.held.h().is_some() && !self.held.is_undone() {
            let (head, tail) = self.v.flat_mut().split_at_mut((s + 1) * v1.len());
            head[..v1.len()].copy_from_slice(tail);
        }
        let [z, lam, nu] = &mut self.held.curves[..] else {
            return;
        };
        let z = &mut z.values;
        copy(z.row_mut(0), z0);
        for i in 0..s {
            copy(z.row_mut(i + 1), stages.unknowns.z.row(i));
        }
        copy(z.row_mut(s + 1), z1);
        if !self.velocity_is_z {
            for i in 0..s {
                copy(self.v.row_mut(i + 1), stages.unknowns.v.row(i));
            }
            copy(self.v.row_mut(s + 1), v1);
        }
        copy(lam.values.flat_mut(), stages.unknowns.lam.flat());
        copy(nu.values.flat_mut(), stages.unknowns.nu.flat());
    }

    /// Writes the unknowns of the finished step that is held.
    pub(super) fn write_solution(&self, Unknowns { z, v, lam, nu }: &mut Unknowns<R>) {
        let (curves, velocities) = (&self.held.curves, self.velocities());
        for i in 0..z.rows() {
            copy(z.row_mut(i), curves[Z].values.row(i + 1));
            copy(v.row_mut(i), velocities.row(i + 1));
        }
        copy(lam.flat_mut(), curves[LAM].values.flat());
        copy(nu.flat_mut(), curves[NU].values.flat());
    }

    /// Writes them one after another, z, v, λ and ν.
    pub(super) fn append_solution(&self, out: &mut Vec<f64>) {
        let (curves, velocities) = (&self.held.curves, self.velocities());
        out.clear();
        for of_stages in [&curves[Z].values, velocities] {
            // values at both ends of the step are no unknowns
            let all = of_stages.flat();
            recorder::append(&all[of_stages.cols()..all.len() - of_stages.cols()], out);
        }
        recorder::append(curves[LAM].values.flat(), out);
        recorder::append(curves[NU].values.flat(), out);
    }

    /// v' at a state, or z' where v is not z: how fast the velocities begin to change.
    pub(super) fn acceleration(
        &mut self,
        model: &mut Model<R>,
        t: f64,
        state: &State<R>,
    ) -> Result<&[R], StepError> {
        self.acceleration.solve(model, t, &state.y, &state.z)?;
        Ok(&self.acceleration.z_dot)
    }

    /// v at the start of the step held, V_1..V_s, and v at its end.
    pub(super) fn velocities(&self) -> &Matrix<R> {
        if self.velocity_is_z {
            &self.held.curves[Z].values
        } else {
            &self.v
        }
    }

    /// Lets the next step begin where the one held began, which was rejected.
    pub(super) fn undo(&mut self) {
        self.held.undo();
    }
}

impl Predictor {
    /// Writes v' at a state, with memory of its own for the multipliers and for v.
    pub(super) fn rate(
        &mut self,
        model: &mut Model,
        (t, State { y, z, .. }): (f64, &State),
        (lam, v): (&mut Vec<f64>, &mut [f64]),
        out: &mut [f64],
    ) -> Result<(), StepError> {
        let solver = &mut self.acceleration;
        std::mem::swap(lam, &mut solver.lam);
        let solved = solver.solve(model, t, y, z);
        let found = solved.and_then(|()| model.derivatives(solver, t, (y, z), [v, out]));
        if found.is_err() {
            solver.lam.fill(0.0);
        }
        std::mem::swap(lam, &mut solver.lam);
        found
    }
}

impl<R: Real> Checkpoint for Predictor<R> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.acceleration.save(member, out);
        self.held.save(member, out);
        self.v.flat().save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.acceleration.restore(member, saved)?;
        self.held.restore(member, saved)?;
        self.v.flat_mut().restore(member, saved)
    }
}
