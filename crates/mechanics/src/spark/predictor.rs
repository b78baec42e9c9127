//! Start values of the stages: from the polynomials of the step before, or cold.
//!
//! Warm: the polynomial through {z0, Z_1..Z_s, z1} at {0, c, 1}, and that through λ_0..λ_k at the
//! nodes, both evaluated one step on. A stage at 0 or 1 is not on the polynomial, for there it has z0
//! and z1; what it is off them scales as h to the degree. Cold: z0' and λ from the acceleration-level
//! solve, Z_i = z0 + c_i h z0'. Still, where stiff damping makes that a leap away: Z_i = z0.
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::stages::{Stages, Step, Unknowns};
use crate::problem::{Acceleration, Model, State};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, as_is, combine, copy};
use liouville_base::real::Real;
use liouville_base::simd::{dispatch_simd, dispatch_simd_long};
use liouville_base::tableau;

/// What the next step starts from.
#[derive(Clone, Debug)]
pub(super) struct Predictor<R = f64> {
    acceleration: Acceleration<R>,
    velocity_is_z: bool,
    /// The step size of the polynomials held, and the ratio their weights were made for.
    h: Option<f64>,
    ratio: f64,
    /// Where the next step begins on what is held: at its end, 1, or once more at its start, 0.
    begin: f64,
    /// 0, c_1..c_s, 1, and which of them the polynomial goes through.
    nodes: Vec<f64>,
    knots: Vec<usize>,
    /// All of the nodes 0..k.
    node_knots: Vec<usize>,
    stage_weights: Matrix,
    end_weights: Matrix,
    node_weights: Matrix,
    /// z0, Z_1..Z_s, z1; and the same of v where v is not z, whose v0 a cold start writes.
    z: Matrix<R>,
    v: Matrix<R>,
    lam: Matrix<R>,
    rolling_weights: Matrix,
    rolling_knots: Vec<usize>,
    nu: Matrix<R>,
}

impl<R: Real> Predictor<R> {
    pub(super) fn new(model: &Model<R>, tableau: &tableau::Spark) -> Self {
        let (s, k) = (tableau.stages, tableau.intervals);
        let (n, m, l) = (model.problem.n, model.problem.m, model.problem.l());
        let nodes = [&[0.0], &tableau.c[..], &[1.0]].concat();
        let velocity_is_z = model.problem.patterns.v_z.is_none();
        let is_inside = |k: &usize| 0.0 < nodes[*k] && nodes[*k] < 1.0;
        Self {
            knots: std::iter::once(0)
                .chain((1..=s).filter(is_inside))
                .chain(std::iter::once(s + 1))
                .collect(),
            nodes,
            node_knots: (0..=k).collect(),
            acceleration: Acceleration::new(model),
            velocity_is_z,
            h: None,
            ratio: f64::NAN,
            begin: 1.0,
            stage_weights: Matrix::zeros(s, s + 2),
            end_weights: Matrix::zeros(1, s + 2),
            node_weights: Matrix::zeros(k + 1, k + 1),
            z: Matrix::zeros(s + 2, n),
            v: Matrix::zeros(if velocity_is_z { 0 } else { s + 2 }, n),
            lam: Matrix::zeros(k + 1, m),
            rolling_weights: Matrix::zeros(if l > 0 { s } else { 0 }, s),
            rolling_knots: (0..s).collect(),
            nu: Matrix::zeros(s, l),
        }
    }

    /// Forgets the polynomials: the next start is cold.
    pub(super) fn forget(&mut self) {
        self.h = None;
    }

    /// Writes the extrapolated unknowns and `z1`; says whether there was a step to extrapolate.
    pub(super) fn extrapolate(&mut self, stages: &mut Stages<R>, z1: &mut [R], h: f64) -> bool {
        let Some(last) = self.h else { return false };
        let ratio = h / last;
        if ratio.to_bits() != self.ratio.to_bits() {
            self.ratio = ratio;
            self.weigh(&stages.tableau, ratio);
        }
        dispatch_simd_long::<R, _>(
            self.z.cols(),
            #[inline(always)]
            || self.write_start(&mut stages.unknowns, z1),
        );
        true
    }

    #[inline(always)]
    fn write_start(&self, unknowns: &mut Unknowns<R>, z1: &mut [R]) {
        let Unknowns { z, v, lam, nu } = unknowns;
        combine(z.flat_mut(), &self.stage_weights, &self.z, as_is);
        if self.velocity_is_z {
            // nothing but equal starts keeps them equal: their difference is no residual
            copy(v.flat_mut(), z.flat());
        } else {
            combine(v.flat_mut(), &self.stage_weights, &self.v, as_is);
        }
        combine(z1, &self.end_weights, &self.z, as_is);
        if !lam.flat().is_empty() {
            combine(lam.flat_mut(), &self.node_weights, &self.lam, as_is);
        }
        if !nu.flat().is_empty() {
            combine(nu.flat_mut(), &self.rolling_weights, &self.nu, as_is);
        }
    }

    /// The weights of what is held, for steps that are `ratio` times as long.
    fn weigh(&mut self, tableau: &tableau::Spark, ratio: f64) {
        let (knots, nodes, begin) = (&self.knots, &self.nodes, self.begin);
        let weights = &mut self.stage_weights;
        lagrange(nodes, knots, &tableau.c, (begin, ratio), weights);
        let degree = i32::try_from(knots.len() - 1).expect("a small degree");
        for (i, c) in tableau.c.iter().enumerate() {
            if knots.contains(&(i + 1)) {
                continue;
            }
            let (end, shift) = (
                if *c < 0.5 { 0 } else { tableau.stages + 1 },
                ratio.powi(degree),
            );
            weights[(i, i + 1)] = shift;
            weights[(i, end)] -= shift;
        }
        lagrange(nodes, knots, &[1.0], (begin, ratio), &mut self.end_weights);
        let (nodes, all) = (&tableau.c_hat, &self.node_knots);
        lagrange(nodes, all, nodes, (begin, ratio), &mut self.node_weights);
        if self.rolling_weights.rows() > 0 {
            let (nodes, all) = (&tableau.c, &self.rolling_knots);
            lagrange(nodes, all, nodes, (begin, ratio), &mut self.rolling_weights);
        }
    }

    /// Writes the cold start; one that is `still` leaves z' out.
    pub(super) fn start_cold(
        &mut self,
        model: &mut Model<R>,
        stages: &mut Stages<R>,
        z1: &mut [R],
        step: Step<R>,
        still: bool,
    ) -> Result<(), StepError> {
        let Step { t, h, state } = step;
        let reach = if still { 0.0 } else { h };
        self.acceleration.solve(model, t, &state.y, &state.z)?;
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
        for i in 0..stages.tableau.stages {
            let (c, t) = (stages.tableau.c[i], stages.stage_time(step, i));
            let z = stages.unknowns.z.row_mut(i);
            z.copy_from_slice(&state.z);
            add_scaled(z, c * reach, z_dot);
            let y = stages.y.row_mut(i);
            y.copy_from_slice(&state.y);
            add_scaled(y, c * h, velocity);
            let [_, _, v] = model.stage(t, y, z);
            let v = if v.is_empty() { &*z } else { v };
            copy(stages.unknowns.v.row_mut(i), v);
        }
        z1.copy_from_slice(&state.z);
        add_scaled(z1, reach, z_dot);
        let (lam, nu) = self.acceleration.lam.split_at(model.problem.m);
        for j in 0..=stages.tableau.intervals {
            stages.unknowns.lam.row_mut(j).copy_from_slice(lam);
        }
        for i in 0..stages.tableau.stages {
            stages.unknowns.nu.row_mut(i).copy_from_slice(nu);
        }
        Ok(())
    }

    /// Keeps the polynomials of a finished step from `z0` to `z1`, where v is `v1`.
    pub(super) fn keep(&mut self, stages: &Stages<R>, h: f64, z0: &[R], z1: &[R], v1: &[R]) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.keep_points(stages, z0, z1, v1),
        );
        self.h = Some(h);
        if self.begin == 0.0 {
            (self.begin, self.ratio) = (1.0, f64::NAN);
        }
    }

    #[inline(always)]
    fn keep_points(&mut self, stages: &Stages<R>, z0: &[R], z1: &[R], v1: &[R]) {
        let s = stages.tableau.stages;
        if !self.velocity_is_z && self.h.is_some() && self.begin > 0.0 {
            let (head, tail) = self.v.flat_mut().split_at_mut((s + 1) * v1.len());
            head[..v1.len()].copy_from_slice(tail);
        }
        copy(self.z.row_mut(0), z0);
        for i in 0..s {
            copy(self.z.row_mut(i + 1), stages.unknowns.z.row(i));
        }
        copy(self.z.row_mut(s + 1), z1);
        if !self.velocity_is_z {
            for i in 0..s {
                copy(self.v.row_mut(i + 1), stages.unknowns.v.row(i));
            }
            copy(self.v.row_mut(s + 1), v1);
        }
        copy(self.lam.flat_mut(), stages.unknowns.lam.flat());
        copy(self.nu.flat_mut(), stages.unknowns.nu.flat());
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
        if self.velocity_is_z { &self.z } else { &self.v }
    }

    /// The next step begins where the one held began, which says where it goes.
    pub(super) fn undo(&mut self) {
        (self.begin, self.ratio) = (0.0, f64::NAN);
    }
}

/// Values of the Lagrange basis on those `nodes` that are `knots`, at begin + ratio x for each x of
/// `targets`, one row a target.
fn lagrange(
    nodes: &[f64],
    knots: &[usize],
    targets: &[f64],
    (begin, ratio): (f64, f64),
    weights: &mut Matrix,
) {
    for (i, x) in targets.iter().map(|x| begin + ratio * x).enumerate() {
        for k in knots {
            let others = knots.iter().filter(|l| *l != k);
            weights[(i, *k)] = others
                .map(|l| (x - nodes[*l]) / (nodes[*k] - nodes[*l]))
                .product();
        }
    }
}

/// The polynomials; their weights are made again, to the same bits.
impl<R: Real> Checkpoint for Predictor<R> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.acceleration.save(member, out);
        (self.h, self.begin).save(member, out);
        for held in [&self.z, &self.v, &self.lam, &self.nu] {
            held.flat().save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.acceleration.restore(member, saved)?;
        let begin = self.begin;
        self.h.restore(member, saved)?;
        self.begin.restore(member, saved)?;
        for held in [&mut self.z, &mut self.v, &mut self.lam, &mut self.nu] {
            held.flat_mut().restore(member, saved)?;
        }
        if begin.to_bits() != self.begin.to_bits() {
            self.ratio = f64::NAN;
        }
        Ok(())
    }
}
