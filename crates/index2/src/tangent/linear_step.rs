//! One step as a linear map of (dy0, dt0, dh/h, dθ). With e(F) the change of F by these at fixed V_i and Z_i,
//!
//!     J (dV, dZ) = (e(f_i),  −Σ_j b_j P_{i−1}(c_j) e(k_j) / h,  −e(k1) / h),     dy1 = e(y1) + h Σ_j b_j dV_j
//!
//! J being the matrix of the step at its solution, with unknowns in its units; dz1 is that of the hidden constraint. z0 is
//! nothing to a step.

use super::super::Index2;
use super::super::newton_matrix::CollocationMatrix;
use super::super::stages::{CollocationStages, CollocationStep};
use crate::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linear::{BlockPattern, Operators, Segment, Segments};
use liouville_problem::{StateSegments, StepMap, finite};
use std::convert::Infallible;

/// The derivatives of a step, listed.
#[derive(Clone, Debug)]
pub(super) struct LinearCollocation {
    pub(super) map: StepMap,
    pub(super) solvers: CollocationSolvers,
    model: SemiExplicitModel,
    f_y: BlockPattern,
    k_y: BlockPattern,
    w_y: BlockPattern,
    f_tau: [BlockPattern; 2],
    k_tau: [BlockPattern; 2],
    w_tau: [BlockPattern; 2],
    /// Of Y_i and y1, of T_i and t1, of k there; the right-hand sides.
    points: Segment,
    times: Segment,
    constraints: Segment,
    right: Segment,
}

/// Which matrix the list solves with.
const STEP: usize = 0;
const HIDDEN: usize = 1;

/// The matrices of a step and of the hidden constraint at its end.
#[derive(Clone, Debug)]
pub(super) struct CollocationSolvers {
    matrix: CollocationMatrix,
    pub(super) sensitivity: SemiExplicitSensitivityModel,
}

impl Operators for CollocationSolvers {
    type Error = Infallible;

    fn solve<const TRANSPOSED: bool>(
        &mut self,
        matrix: usize,
        x: &mut [f64],
    ) -> Result<(), Infallible> {
        match (matrix, TRANSPOSED) {
            (STEP, false) => self.matrix.solve(x),
            (STEP, true) => self.matrix.solve_transposed(x),
            (_, false) => self.sensitivity.solve(x),
            (_, true) => self.sensitivity.solve_transposed(x),
        }
        Ok(())
    }
}

impl LinearCollocation {
    pub(super) fn new(index2: &Index2, sensitivity: SemiExplicitSensitivityModel) -> Self {
        let (model, stages) = (index2.model.clone(), &index2.stages);
        let (s, n, l) = (stages.count(), model.problem.n, model.problem.l);
        let (at, by_tau) = (&model.problem.patterns, &sensitivity.problem.patterns);
        let mut segments = Segments::default();
        let before = StateSegments::new(&mut segments, [n, 0, 0]);
        let points = segments.take((s + 1) * n);
        let times = segments.take(s + 1);
        let constraints = segments.take((s + 1) * l);
        let right = segments.take(s * (n + l));
        let after = StateSegments {
            y: points.part(s, n),
            t: times.part(s, 1),
            ..StateSegments::new(&mut segments, [0, l, 0])
        };
        let mut map = StepMap::new(segments, [before, after], sensitivity.problem.width() - 1);
        let list = &mut map.map;
        Self {
            f_y: list.pattern(&at.f_y),
            k_y: list.pattern(&at.k_y),
            w_y: list.pattern(&by_tau.w_y),
            f_tau: list.split(&by_tau.f_tau),
            k_tau: list.split(&by_tau.k_tau),
            w_tau: list.split(&by_tau.w_tau),
            map,
            points,
            times,
            constraints,
            right,
            solvers: CollocationSolvers {
                matrix: CollocationMatrix::new(&model, stages),
                sensitivity,
            },
            model,
        }
    }

    /// dV_i, where the map was last applied.
    pub(super) fn field_moves(&self) -> &[f64] {
        let (s, n) = (
            self.points.range().len() / self.model.problem.n - 1,
            self.model.problem.n,
        );
        self.map.read(self.right.cut(0, s * n))
    }

    /// Lists a step at its stages, which solve its equations; with dz1 where its `end` is given.
    pub(super) fn make(
        &mut self,
        stages: &CollocationStages,
        step: CollocationStep,
        end: Option<&SemiExplicitState>,
    ) -> Result<(), StepError> {
        let CollocationSolvers {
            matrix,
            sensitivity,
        } = &mut self.solvers;
        matrix.update(&mut self.model, stages, step)?;
        let (s, n, l, h) = (
            stages.count(),
            self.model.problem.n,
            self.model.problem.l,
            step.h,
        );
        let StepMap {
            map,
            before,
            after,
            stretch,
            params,
            ..
        } = &mut self.map;
        map.clear();
        let (fields, constraints) = (self.right.cut(0, s * n), self.right.cut(s * n, s * l));
        for i in 0..=s {
            let (t, y) = (stages.time(step.t, h, i), stages.y.row(i));
            let (dt, dy) = (self.times.part(i, 1), self.points.part(i, n));
            let (dk, tau) = (self.constraints.part(i, l), [dt, *params]);
            map.add(dt, 1.0, before.t);
            map.add(dt, stages.time(0.0, 1.0, i) * h, *stretch);
            map.add(dy, 1.0, before.y);
            // not the difference of the point and y0, which is roundoff in a very short step
            for j in 0..s {
                let led = stages.displacements.row(j);
                map.add_column(dy, stages.weights[(i, j)], led, *stretch);
            }
            let k_tau = sensitivity.constraint(t, y);
            finite(k_tau, Quantity::Derivative, t)?;
            map.add_product(dk, (&self.k_y, matrix.k_y.row(i)), 1.0, dy);
            map.add_split(dk, (&self.k_tau, k_tau), 1.0, tau);
            if i == s {
                map.add(constraints.part(s - 1, l), -1.0 / h, dk);
                continue;
            }
            for row in 0..s - 1 {
                map.add(constraints.part(row, l), -stages.moments[(row, i)] / h, dk);
            }
            let f_tau = sensitivity.field(t, y, stages.z.row(i));
            finite(f_tau, Quantity::Derivative, t)?;
            map.add_product(fields.part(i, n), (&self.f_y, matrix.f_y.row(i)), 1.0, dy);
            map.add_split(fields.part(i, n), (&self.f_tau, f_tau), 1.0, tau);
        }
        map.solve(STEP, self.right);
        for (j, b) in stages.b.iter().enumerate() {
            map.add(after.y, h * b, fields.part(j, n));
        }
        if let Some(SemiExplicitState { y, z, .. }) = end {
            let [w_y, w_tau] = sensitivity.linearize(&mut self.model, step.t + h, (y, z))?;
            map.add_product(after.z, (&self.w_y, w_y), -1.0, after.y);
            map.add_split(after.z, (&self.w_tau, w_tau), -1.0, [after.t, *params]);
            map.solve(HIDDEN, after.z);
        }
        Ok(())
    }
}
