//! Tangents of one step, and their transpose. With e(F) the change of F by y0, τ and h at fixed V_i and Z_i,
//!
//!     J (dV, dZ) = (e(f_i),  −Σ_j b_j P_{i−1}(c_j) e(k_j) / h,  −e(k1) / h),     dy1 = e(y1) + h Σ_j b_j dV_j
//!
//! J being the matrix of the step at its solution; dz1 is that of the hidden constraint. The transpose is
//!
//!     Jᵀ (η, ν) = (h b_j ȳ1, 0),     ȳ0 = ȳ1 + Σ_i f_yᵀ η_i − Σ_j k_yᵀ κ_j,     κ_j = Σ_i b_j P_{i−1}(c_j) ν_i / h
//!
//! with κ = ν_s / h at t1, and sums of the same products with F_τ for τ. z0 is nothing to a step.

use super::super::Index2;
use super::super::newton_matrix::CollocationMatrix;
use super::super::stages::{CollocationStages, CollocationStep};
use crate::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, copy, copy_scaled, dot};
use liouville_problem::{Cotangents, Directions, TangentState, finite};

/// Derivatives of one step, and the memory of a direction.
#[derive(Clone, Debug)]
pub(super) struct LinearCollocation {
    model: SemiExplicitModel,
    pub(super) sensitivity: SemiExplicitSensitivityModel,
    matrix: CollocationMatrix,
    /// A row a stage; those of k have the end of the step below.
    f_tau: Matrix,
    k_tau: Matrix,
    /// Changes of Y_i and y1, or their cotangents.
    points: Matrix,
    /// Of k at a point.
    constraint: Vec<f64>,
    right: Vec<f64>,
}

/// The direction that is followed, and through which step.
#[derive(Clone, Copy)]
pub(super) struct StepAlong<'a> {
    pub(super) step: CollocationStep<'a>,
    pub(super) direction: usize,
}

/// A state with its tangents.
type SemiExplicitTangents = TangentState<SemiExplicitState>;

/// Which part of the step leads to a stage, or to the end.
fn part(stages: &CollocationStages, i: usize) -> f64 {
    stages.time(0.0, 1.0, i)
}

impl LinearCollocation {
    pub(super) fn new(index2: &Index2, sensitivity: SemiExplicitSensitivityModel) -> Self {
        let (model, stages) = (index2.model.clone(), &index2.stages);
        let (s, n, l) = (stages.count(), model.problem.n, model.problem.l);
        let at = &sensitivity.problem.patterns;
        Self {
            matrix: CollocationMatrix::new(&model, stages),
            f_tau: Matrix::zeros(s, at.f_tau.len()),
            k_tau: Matrix::zeros(s + 1, at.k_tau.len()),
            points: Matrix::zeros(s + 1, n),
            constraint: vec![0.0; l],
            right: vec![0.0; s * (n + l)],
            model,
            sensitivity,
        }
    }

    /// Linearises a step where its stages are, which solve its equations.
    pub(super) fn make(
        &mut self,
        stages: &CollocationStages,
        step: CollocationStep,
    ) -> Result<(), StepError> {
        self.matrix.update(&mut self.model, stages, step)?;
        for i in 0..=stages.count() {
            let (t, y) = (stages.time(step.t, step.h, i), stages.y.row(i));
            let k_tau = self.sensitivity.constraint(t, y);
            finite(k_tau, Quantity::Derivative, t)?;
            copy(self.k_tau.row_mut(i), k_tau);
            if i < stages.count() {
                let f_tau = self.sensitivity.field(t, y, stages.z.row(i));
                finite(f_tau, Quantity::Derivative, t)?;
                copy(self.f_tau.row_mut(i), f_tau);
            }
        }
        Ok(())
    }

    /// Linearises the hidden constraint at a point.
    pub(super) fn linearize_hidden(
        &mut self,
        t: f64,
        SemiExplicitState { y, z, .. }: &SemiExplicitState,
    ) -> Result<(), StepError> {
        self.sensitivity.linearize(&mut self.model, t, (y, z))
    }

    /// Writes the tangent at the end of a step that is linearised, as the hidden constraint is there.
    pub(super) fn push(
        &mut self,
        stages: &CollocationStages,
        directions: &mut Directions,
        StepAlong { step, direction }: StepAlong,
        (before, state): (&SemiExplicitTangents, &mut SemiExplicitTangents),
    ) {
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns);
        let (s, n, l) = (stages.count(), problem.system.n, problem.system.l);
        let (stretch, dt0) = (directions.stretch[direction], before.t[direction]);
        self.right.fill(0.0);
        let (fields, constraints) = self.right.split_at_mut(s * n);
        for i in 0..=s {
            let tau = directions.tau(direction, dt0 + part(stages, i) * step.h * stretch);
            let dy = self.points.row_mut(i);
            copy(dy, before.y.row(direction));
            // not the difference of the point and y0, which is roundoff in a very short step
            for j in (0..s).filter(|_| stretch != 0.0) {
                let weight = stretch * stages.weights[(i, j)];
                add_scaled(dy, weight, stages.displacements.row(j));
            }
            let dk = &mut self.constraint;
            dk.fill(0.0);
            at.k_y.multiply_add(self.matrix.k_y.row(i), 1.0, dy, dk);
            by_tau.k_tau.multiply_add(self.k_tau.row(i), 1.0, tau, dk);
            if i == s {
                add_scaled(&mut constraints[(s - 1) * l..], -1.0 / step.h, dk);
                continue;
            }
            for (row, out) in constraints[..(s - 1) * l].chunks_exact_mut(l).enumerate() {
                add_scaled(out, -stages.moments[(row, i)] / step.h, dk);
            }
            let out = &mut fields[i * n..(i + 1) * n];
            at.f_y.multiply_add(self.matrix.f_y.row(i), 1.0, dy, out);
            by_tau.f_tau.multiply_add(self.f_tau.row(i), 1.0, tau, out);
        }
        self.matrix.solve(&mut self.right);
        let dy = state.y.row_mut(direction);
        copy(dy, self.points.row(s));
        for (b, d_v) in stages.b.iter().zip(self.right.chunks_exact(n)) {
            add_scaled(dy, step.h * b, d_v);
        }
        let dt = dt0 + step.h * stretch;
        let tau = directions.tau(direction, dt);
        self.sensitivity.push(dy, tau, state.z.row_mut(direction));
        state.t[direction] = dt;
    }

    /// Takes cotangents from the end of a step that is linearised to its start.
    pub(super) fn pull(
        &mut self,
        stages: &CollocationStages,
        step: CollocationStep,
        of: &mut Cotangents,
    ) {
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns);
        let (s, n, l) = (stages.count(), problem.system.n, problem.system.l);
        // dt1 = dt0 + h stretch
        of.stretch += step.h * of.tau[0];
        self.right.fill(0.0);
        for (b, out) in stages.b.iter().zip(self.right.chunks_exact_mut(n)) {
            copy_scaled(out, step.h * b, &of.y);
        }
        self.matrix.solve_transposed(&mut self.right);
        let (fields, constraints) = self.right.split_at(s * n);
        self.points.clear();
        copy(self.points.row_mut(s), &of.y);
        of.y.fill(0.0);
        for i in 0..=s {
            let (before, out) = (of.tau[0], self.points.row_mut(i));
            let back = &mut self.constraint;
            back.fill(0.0);
            for (row, nu) in constraints.chunks_exact(l).enumerate() {
                let is_end = row == s - 1;
                let weight = match i {
                    _ if is_end => f64::from(u8::from(i == s)),
                    _ if i == s => 0.0,
                    _ => stages.moments[(row, i)],
                };
                add_scaled(back, -weight / step.h, nu);
            }
            let k_y = self.matrix.k_y.row(i);
            at.k_y.multiply_add_transposed(k_y, 1.0, back, out);
            let k_tau = self.k_tau.row(i);
            let of_tau = &mut of.tau;
            (by_tau.k_tau).multiply_add_transposed(k_tau, 1.0, back, of_tau);
            if i < s {
                let own = &fields[i * n..(i + 1) * n];
                let (f_y, f_tau) = (self.matrix.f_y.row(i), self.f_tau.row(i));
                at.f_y.multiply_add_transposed(f_y, 1.0, own, out);
                (by_tau.f_tau).multiply_add_transposed(f_tau, 1.0, own, of_tau);
            }
            of.stretch += part(stages, i) * step.h * (of.tau[0] - before);
            for j in 0..s {
                of.stretch += stages.weights[(i, j)] * dot(stages.displacements.row(j), out);
            }
            add_scaled(&mut of.y, 1.0, out);
        }
    }
}
