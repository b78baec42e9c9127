//! Errors of tangents in random directions, where errors control the steps: each is that of a motion with the velocities
//! of the tangent, by a tolerance of its own, see [`liouville_problem::TangentSizes`].

use super::super::Index2;
use super::linear_step::LinearCollocation;
use super::start::SemiExplicitStart;
use crate::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::checkpoint;
use liouville_base::linalg::{Matrix, copy};
use liouville_problem::{Estimate, RandomTangents, StepVelocities, TangentStep};

/// Random tangents, and what their errors are found by.
#[derive(Clone, Debug)]
pub(super) struct TangentErrors {
    pub(super) tangents: RandomTangents<SemiExplicitStart, SemiExplicitState>,
    estimate: Estimate<SemiExplicitState>,
    model: SemiExplicitModel,
    /// δf at the start of the step, δV_1..δV_s, and δf at its end; f_τ τ there.
    velocities: Matrix,
    forced: Vec<f64>,
}

impl TangentErrors {
    /// The errors of a method that estimates its own, for a motion with these parameters.
    pub(super) fn new(
        index2: &Index2,
        sensitivity: &SemiExplicitSensitivityModel,
        (motion, params): (&SemiExplicitState, &[f64]),
    ) -> Option<Self> {
        let (at, model) = (index2.estimate.as_ref()?, &index2.model);
        let (n, l) = (model.problem.n, model.problem.l);
        let starts = SemiExplicitStart::new(model.clone(), sensitivity.clone());
        Some(Self {
            tangents: RandomTangents::new(
                starts,
                (motion, params),
                [n, l, 0],
                &at.estimate.tolerance,
            ),
            estimate: at.estimate.clone(),
            model: index2.model.clone(),
            velocities: Matrix::zeros(index2.stages.count() + 2, n),
            forced: vec![0.0; n],
        })
    }

    /// Follows a step to its end, where it was linearised, and measures the errors.
    pub(super) fn follow(
        &mut self,
        linear: &mut LinearCollocation,
        (t, h): (f64, f64),
        end: &SemiExplicitState,
    ) {
        self.tangents.after.motion.clone_from(end);
        for direction in 0..self.tangents.directions.count() {
            let RandomTangents {
                directions,
                before,
                after,
                ..
            } = &mut self.tangents;
            let LinearCollocation { map, solvers, .. } = &mut *linear;
            let Ok(()) = map.push(solvers, (&*directions, direction), (&*before, after));
            self.measure(linear, direction, (t, h));
        }
    }

    /// Measures the step in a direction in which it was followed.
    fn measure(&mut self, linear: &mut LinearCollocation, direction: usize, (t, h): (f64, f64)) {
        let (n, last) = (self.forced.len(), self.velocities.rows() - 1);
        let inner = &mut self.velocities.flat_mut()[n..last * n];
        copy(inner, linear.field_moves());
        let by = &mut linear.solvers.sensitivity;
        self.write_end(0, by, t, direction);
        self.write_end(last, by, t + h, direction);
        let RandomTangents {
            before,
            after,
            sizes,
            ..
        } = &mut self.tangents;
        let ends = [&*before, &*after];
        let y = ends.map(|state| state.y.row(direction));
        let step = TangentStep {
            h,
            y,
            v: [0, last].map(|row| self.velocities.row(row)),
            parts: [sizes.norm(&self.forced), 0.0],
        };
        if sizes.measure(step, &mut self.estimate.tolerance) > 0.0 {
            let rows = StepVelocities {
                rows: &self.velocities,
                noise: &[],
            };
            self.estimate.measure_between(rows, h, y);
            let estimate = &self.estimate;
            self.tangents
                .largest
                .raise(estimate.error(), estimate.order());
        }
    }

    /// Writes δf at an end of the step.
    fn write_end(
        &mut self,
        row: usize,
        sensitivity: &mut SemiExplicitSensitivityModel,
        t: f64,
        direction: usize,
    ) {
        let RandomTangents {
            directions,
            before,
            after,
            ..
        } = &mut self.tangents;
        let state = if row == 0 { before } else { after };
        let tau = directions.tau(direction, 0.0);
        let SemiExplicitState { y, z, .. } = &state.motion;
        let by_tau = sensitivity.problem.clone();
        self.forced.fill(0.0);
        let f_tau = sensitivity.field(t, y, z);
        (by_tau.patterns.f_tau).multiply_add(f_tau, 1.0, tau, &mut self.forced);
        let out = self.velocities.row_mut(row);
        copy(out, &self.forced);
        let problem = self.model.problem.clone();
        let (f_y, f_z) = self.model.field_jacobian(t, y, z);
        let at = &problem.patterns;
        at.f_y.multiply_add(f_y, 1.0, state.y.row(direction), out);
        at.f_z.multiply_add(f_z, 1.0, state.z.row(direction), out);
    }
}

checkpoint!(TangentErrors { tangents });
