//! Start values of the stages: from the polynomials of the step before, or cold.
//!
//! Warm: the polynomial of degree s + 1 through {z0, Z_1..Z_s, z1} at {0, c, 1}, and that of degree s
//! through λ_0..λ_s at the Lobatto nodes, both evaluated one step on. Cold: z0' and λ from the
//! acceleration-level solve, Z_i = z0 + c_i h z0'.

use super::stages::{Stages, Step};
use crate::linalg::{Matrix, add_scaled};
use crate::problem::mechanical::{Acceleration, Model};
use crate::trouble::Trouble;

/// What the next step starts from.
#[derive(Clone, Debug)]
pub(super) struct Predictor {
    acceleration: Acceleration,
    /// The step size of the polynomials held, and the ratio their weights were made for.
    h: Option<f64>,
    ratio: f64,
    stage_weights: Matrix,
    node_weights: Matrix,
    /// z0, Z_1..Z_s, z1; and the same of v, whose v0 a cold start writes.
    z: Matrix,
    v: Matrix,
    lam: Matrix,
}

impl Predictor {
    pub(super) fn new(model: &Model, s: usize) -> Self {
        let (n, m) = (model.problem.n, model.problem.m);
        Self {
            acceleration: Acceleration::new(model),
            h: None,
            ratio: f64::NAN,
            stage_weights: Matrix::zeros(s + 1, s + 2),
            node_weights: Matrix::zeros(s + 1, s + 1),
            z: Matrix::zeros(s + 2, n),
            v: Matrix::zeros(s + 2, n),
            lam: Matrix::zeros(s + 1, m),
        }
    }

    /// Writes the extrapolated unknowns and `z1`; says whether there was a step to extrapolate.
    pub(super) fn extrapolate(&mut self, stages: &mut Stages, z1: &mut [f64], h: f64) -> bool {
        let Some(last) = self.h else { return false };
        let s = stages.tableau.stages;
        let ratio = h / last;
        if ratio.to_bits() != self.ratio.to_bits() {
            self.ratio = ratio;
            let nodes: Vec<f64> = std::iter::once(0.0)
                .chain(stages.tableau.c.iter().copied())
                .chain(std::iter::once(1.0))
                .collect();
            let targets = |x: &[f64]| x.iter().map(|x| 1.0 + ratio * x).collect::<Vec<_>>();
            lagrange(&nodes, &targets(&nodes[1..]), &mut self.stage_weights);
            let nodes = &stages.tableau.c_hat;
            lagrange(nodes, &targets(nodes), &mut self.node_weights);
        }
        for i in 0..s {
            combine(stages.z.row_mut(i), self.stage_weights.row(i), &self.z);
            combine(stages.v.row_mut(i), self.stage_weights.row(i), &self.v);
        }
        combine(z1, self.stage_weights.row(s), &self.z);
        for j in 0..=s {
            combine(stages.lam.row_mut(j), self.node_weights.row(j), &self.lam);
        }
        true
    }

    /// Writes the cold start.
    pub(super) fn start_cold(
        &mut self,
        model: &mut Model,
        stages: &mut Stages,
        z1: &mut [f64],
        step: Step,
    ) -> Result<(), Trouble> {
        let Step { t, h, state } = step;
        self.acceleration.solve(model, t, &state.y, &state.z)?;
        let z_dot = &self.acceleration.z_dot;
        let [_, _, v] = model.end(t, &state.y, &state.z);
        self.v
            .row_mut(0)
            .copy_from_slice(if v.is_empty() { &state.z } else { v });
        for i in 0..stages.tableau.stages {
            let (c, t) = (stages.tableau.c[i], stages.stage_time(step, i));
            let z = stages.z.row_mut(i);
            z.copy_from_slice(&state.z);
            add_scaled(z, c * h, z_dot);
            let y = stages.y.row_mut(i);
            y.copy_from_slice(&state.y);
            add_scaled(y, c * h, self.v.row(0));
            let [_, _, v] = model.stage(t, y, z);
            let v = if v.is_empty() { &*z } else { v };
            stages.v.row_mut(i).copy_from_slice(v);
        }
        z1.copy_from_slice(&state.z);
        add_scaled(z1, h, z_dot);
        for j in 0..=stages.tableau.stages {
            stages
                .lam
                .row_mut(j)
                .copy_from_slice(&self.acceleration.lam);
        }
        Ok(())
    }

    /// Keeps the polynomials of a finished step from `z0` to `z1`, where v is `v1`.
    pub(super) fn keep(&mut self, stages: &Stages, h: f64, z0: &[f64], z1: &[f64], v1: &[f64]) {
        let s = stages.tableau.stages;
        if self.h.is_some() {
            let (head, tail) = self.v.flat_mut().split_at_mut((s + 1) * v1.len());
            head[..v1.len()].copy_from_slice(tail);
        }
        self.z.row_mut(0).copy_from_slice(z0);
        for i in 0..s {
            self.z.row_mut(i + 1).copy_from_slice(stages.z.row(i));
            self.v.row_mut(i + 1).copy_from_slice(stages.v.row(i));
        }
        self.z.row_mut(s + 1).copy_from_slice(z1);
        self.v.row_mut(s + 1).copy_from_slice(v1);
        self.lam.flat_mut().copy_from_slice(stages.lam.flat());
        self.h = Some(h);
    }
}

fn combine(out: &mut [f64], weights: &[f64], rows: &Matrix) {
    out.fill(0.0);
    for (k, weight) in weights.iter().enumerate() {
        add_scaled(out, *weight, rows.row(k));
    }
}

/// Values of the Lagrange basis on `nodes` at each target, one row a target.
fn lagrange(nodes: &[f64], targets: &[f64], weights: &mut Matrix) {
    for (i, x) in targets.iter().enumerate() {
        for (k, node) in nodes.iter().enumerate() {
            let others = nodes.iter().enumerate().filter(|(l, _)| *l != k);
            weights[(i, k)] = others
                .map(|(_, other)| (x - other) / (node - other))
                .product();
        }
    }
}
