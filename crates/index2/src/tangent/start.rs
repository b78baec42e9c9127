//! Random tangents of a semi-explicit motion, where it begins.

use crate::semi_explicit::{SemiExplicitModel, SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_problem::{BeginTangents, Directions, TangentState, random_numbers};

/// A random change of y, and what parameters move at once: y is moved by f_z μ until dk = 0, and z follows.
#[derive(Clone, Debug)]
pub(super) struct SemiExplicitStart {
    model: SemiExplicitModel,
    sensitivity: SemiExplicitSensitivityModel,
}

impl SemiExplicitStart {
    /// The start of tangents of a system with these derivatives.
    pub(super) fn new(model: SemiExplicitModel, sensitivity: SemiExplicitSensitivityModel) -> Self {
        Self { model, sensitivity }
    }
}

impl BeginTangents<SemiExplicitState> for SemiExplicitStart {
    fn begin(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState<SemiExplicitState>,
    ) -> Result<(), StepError> {
        let SemiExplicitState { y, z, .. } = &state.motion;
        let problem = self.sensitivity.problem.clone();
        let (at, by_tau) = (&problem.system.patterns, &problem.patterns);
        state.t.fill(0.0);
        (self.sensitivity).linearize(&mut self.model, t, (y, z))?;
        let mut random = random_numbers();
        for direction in 0..directions.count() {
            let tau = directions.tau(direction, 0.0);
            let dy = state.y.row_mut(direction);
            dy.fill(0.0);
            if direction == 0 {
                dy.fill_with(&mut random);
            }
            let mut moves = vec![0.0; problem.system.l];
            let k_y = self.model.constraint_jacobian(t, y);
            at.k_y.multiply_add(k_y, -1.0, dy, &mut moves);
            let k_tau = self.sensitivity.constraint(t, y);
            by_tau.k_tau.multiply_add(k_tau, -1.0, tau, &mut moves);
            self.sensitivity.solve(&mut moves);
            let (_, f_z) = self.model.field_jacobian(t, y, z);
            at.f_z.multiply_add(f_z, 1.0, &moves, dy);
            let mut dz = vec![0.0; problem.system.l];
            self.sensitivity.push(dy, tau, &mut dz);
            copy(state.z.row_mut(direction), &dz);
        }
        Ok(())
    }
}
