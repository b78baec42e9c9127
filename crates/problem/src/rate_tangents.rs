//! The rates of a motion, and the tangents of its multipliers, at a point.

use super::{Acceleration, AccelerationTangents, Directions, Model, SensitivityModel, TangentView};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy};
use std::fmt::Debug;

/// A point of a motion: t, y and z.
pub type MotionPoint<'a> = (f64, &'a [f64], &'a [f64]);

/// Rates at a point, and tangents of multipliers from those of y, z and time there.
pub trait RateTangents: Debug + Send + Sync {
    /// Writes y' and z'.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn flow(&mut self, at: MotionPoint<'_>, out: [&mut [f64]; 2]) -> Result<(), StepError>;

    /// Writes those of the multipliers, a row for each direction.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn multipliers(
        &mut self,
        at: MotionPoint<'_>,
        along: (TangentView<'_>, &mut Directions),
        out: &mut Matrix,
    ) -> Result<(), StepError>;
}

/// Those of a mechanical motion, by the equations of its accelerations.
#[derive(Clone, Debug)]
pub struct MotionTangents {
    solver: Acceleration,
    tangents: AccelerationTangents,
}

impl MotionTangents {
    /// Those of this model.
    pub fn new(model: Model, sensitivity: SensitivityModel) -> Self {
        Self {
            solver: Acceleration::new(&model),
            tangents: AccelerationTangents::new(model, sensitivity),
        }
    }
}

impl RateTangents for MotionTangents {
    fn flow(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        [y_dot, z_dot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let model = &mut self.tangents.model;
        self.solver.solve(model, t, y, z)?;
        let v = model.end(t, y, z)[2];
        copy(y_dot, if v.is_empty() { z } else { v });
        copy(z_dot, &self.solver.z_dot);
        Ok(())
    }

    fn multipliers(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        along: (TangentView<'_>, &mut Directions),
        out: &mut Matrix,
    ) -> Result<(), StepError> {
        let solver = &mut self.solver;
        solver.solve(&mut self.tangents.model, t, y, z)?;
        let point = [y, z, &solver.z_dot, &solver.lam];
        self.tangents
            .solve((t, point), along, |direction, _, found| {
                copy(out.row_mut(direction), found);
            })
    }
}
