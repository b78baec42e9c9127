//! The modified-Newton matrix of (I1)–(I3).
//!
//! Corrections dV_j and dZ_j solve
//!
//!     [ δ_ij − h a_ij f_y(i)                      −δ_ij f_z(i) ] [ dV ]     [ residual of (I1)     ]
//!     [ Σ_m b_m P_{i−1}(c_m) a_mj k_y(m), i < s        0       ] [ dZ ] = − [ that of (I2), (I3) / h ]
//!     [ b_j k_y(t1),                      i = s        0       ]
//!
//! each stage with its own derivatives. No entry grows as h → 0, where the Schur complement is a constant
//! matrix times k_y f_z.

use super::stages::{CollocationStages, CollocationStep};
use crate::semi_explicit::SemiExplicitModel;
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, Pattern, add_scaled, copy, max_norm};
use liouville_base::newton::{BlockGrid, BlockLayout, BlockMatrix, Renewal, Reuse};
use liouville_problem::finite;

/// The matrix, factored, and where it was made.
#[derive(Clone, Debug)]
pub(super) struct CollocationMatrix {
    pub(super) reuse: Reuse,
    matrix: BlockMatrix,
    f_y_at: BlockGrid,
    k_y_at: BlockGrid,
    one: BlockGrid,
    f_z_at: BlockGrid,
    /// f_y and f_z of each stage; k_y of each and of the end.
    pub(super) f_y: Matrix,
    f_z: Vec<Vec<f64>>,
    pub(super) k_y: Matrix,
    /// dZ is solved for in this unit.
    unit: f64,
    /// The point of linearisation: the start of the step, and y and z of the stages.
    t: f64,
    y: Matrix,
    z: Matrix,
    unknowns: Vec<f64>,
    effect: Vec<f64>,
}

impl CollocationMatrix {
    pub(super) fn new(model: &SemiExplicitModel, stages: &CollocationStages) -> Self {
        let (n, l, s) = (model.problem.n, model.problem.l, stages.count());
        let (at, identity) = (&model.problem.patterns, Pattern::diagonal(n));
        let mut layout = BlockLayout::default();
        let f_y_at = layout.grid(&at.f_y, (s, s), (0, 0));
        let k_y_at = layout.grid(&at.k_y, (s, s), (s * n, 0));
        let one = layout.diagonal(&identity, s, (0, 0));
        let f_z_at = layout.diagonal(&at.f_z, s, (0, s * n));
        let matrix = layout.build(s * (n + l), 0);
        Self {
            reuse: Reuse::new(&matrix, Renewal::AboveAverage),
            unknowns: vec![0.0; matrix.order()],
            matrix,
            f_y_at,
            k_y_at,
            one,
            f_z_at,
            f_y: Matrix::zeros(s, at.f_y.len()),
            f_z: vec![vec![0.0; at.f_z.len()]; s],
            k_y: Matrix::zeros(s + 1, at.k_y.len()),
            unit: 1.0,
            t: 0.0,
            y: stages.y.clone(),
            z: stages.z.clone(),
            effect: vec![0.0; n],
        }
    }

    /// Factors the matrix at the present unknowns.
    pub(super) fn update(
        &mut self,
        model: &mut SemiExplicitModel,
        stages: &CollocationStages,
        step: CollocationStep,
    ) -> Result<(), StepError> {
        self.t = step.t;
        copy(self.y.flat_mut(), stages.y.flat());
        copy(self.z.flat_mut(), stages.z.flat());
        self.refactor(model, stages, step.h)
    }

    /// Factors the matrix at its point of linearisation, for steps of `h`.
    fn refactor(
        &mut self,
        model: &mut SemiExplicitModel,
        stages: &CollocationStages,
        h: f64,
    ) -> Result<(), StepError> {
        self.reuse.discard();
        self.matrix.clear();
        self.add_fields(model, stages, h)?;
        self.add_constraints(model, stages, h)?;
        let factored = self.matrix.factor();
        factored.map_err(|_| StepError::SingularNewton)?;
        self.reuse.renew(h);
        Ok(())
    }

    /// Makes the factors again that were there when a run was saved.
    pub(super) fn restore_factors(
        &mut self,
        model: &mut SemiExplicitModel,
        stages: &CollocationStages,
    ) -> Result<(), CheckpointMismatch> {
        let reuse = self.reuse.clone();
        if reuse.h() != 0.0 {
            let factored = self.refactor(model, stages, reuse.h());
            factored.map_err(|_| CheckpointMismatch)?;
            self.reuse = reuse;
        }
        Ok(())
    }

    fn add_fields(
        &mut self,
        model: &mut SemiExplicitModel,
        stages: &CollocationStages,
        h: f64,
    ) -> Result<(), StepError> {
        let s = stages.count();
        for i in 0..s {
            let t = stages.time(self.t, h, i);
            let (f_y, f_z) = model.field_jacobian(t, self.y.row(i), self.z.row(i));
            finite(f_y, Quantity::Derivative, t)?;
            finite(f_z, Quantity::Derivative, t)?;
            for j in 0..s {
                self.matrix
                    .add(self.f_y_at.at(i, j), f_y, -h * stages.a[(i, j)]);
            }
            copy(self.f_y.row_mut(i), f_y);
            copy(&mut self.f_z[i], f_z);
        }
        let largest = self.f_z.iter().map(|x| max_norm(x)).fold(0.0, f64::max);
        let unit = 1.0 / largest;
        self.unit = if unit.is_normal() { unit } else { 1.0 };
        self.effect.fill(1.0);
        for (i, f_z) in self.f_z.iter().enumerate() {
            self.matrix.add(self.f_z_at.at(i, 0), f_z, -self.unit);
            self.matrix.add(self.one.at(i, 0), &self.effect, 1.0);
        }
        Ok(())
    }

    fn add_constraints(
        &mut self,
        model: &mut SemiExplicitModel,
        stages: &CollocationStages,
        h: f64,
    ) -> Result<(), StepError> {
        let s = stages.count();
        for m in 0..=s {
            let t = stages.time(self.t, h, m);
            let k_y = model.constraint_jacobian(t, self.y.row(m));
            finite(k_y, Quantity::Derivative, t)?;
            copy(self.k_y.row_mut(m), k_y);
            for j in 0..s {
                if m == s {
                    self.matrix.add(self.k_y_at.at(s - 1, j), k_y, stages.b[j]);
                    continue;
                }
                for i in 0..s - 1 {
                    let weight = stages.moments[(i, m)] * stages.a[(m, j)];
                    self.matrix.add(self.k_y_at.at(i, j), k_y, weight);
                }
            }
        }
        Ok(())
    }

    /// Solves in place, Z in its unit.
    pub(super) fn solve(&mut self, x: &mut [f64]) {
        self.matrix.solve(x);
    }

    /// Solves with the transposed matrix in place, Z in its unit.
    pub(super) fn solve_transposed(&mut self, x: &mut [f64]) {
        self.matrix.solve_transposed(x);
    }

    /// Corrects the unknowns; returns the largest change of V, directly or by Z.
    pub(super) fn correct(
        &mut self,
        model: &SemiExplicitModel,
        stages: &mut CollocationStages,
        h: f64,
    ) -> f64 {
        let at = &model.problem.patterns;
        let (head, tail) = self.unknowns.split_at_mut(stages.v.flat().len());
        copy(head, stages.residual.flat());
        for (out, defect) in tail.iter_mut().zip(stages.defect.flat()) {
            *out = defect / h;
        }
        self.matrix.solve(&mut self.unknowns);
        let (d_v, d_z) = self.unknowns.split_at_mut(stages.v.flat().len());
        add_scaled(stages.v.flat_mut(), -1.0, d_v);
        add_scaled(stages.z.flat_mut(), -self.unit, d_z);
        let mut size = max_norm(d_v);
        for (f_z, d_z) in self.f_z.iter().zip(d_z.chunks_exact(model.problem.l)) {
            self.effect.fill(0.0);
            at.f_z.multiply_add(f_z, self.unit, d_z, &mut self.effect);
            size = size.max(max_norm(&self.effect));
        }
        size
    }
}

liouville_base::checkpoint!(CollocationMatrix { reuse, t, y, z });
