//! A point of a motion: the rates there, and the cotangents of its z.

use super::{RateSolver, SemiExplicitModel, SemiExplicitSensitivityModel};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, copy, dot};
use liouville_problem::{
    Carried, Cotangents, Directions, Dynamics, MotionPoint, ObservePoint, RateTangents, Side,
    TangentView, rates_beside,
};

/// The derivatives at a point, with the memory to find them.
#[derive(Clone, Debug)]
pub struct SemiExplicitPoint {
    /// The model.
    pub model: SemiExplicitModel,
    /// Its derivatives by time and parameters.
    pub sensitivity: SemiExplicitSensitivityModel,
    solver: RateSolver,
}

impl SemiExplicitPoint {
    /// Memory for this model.
    pub fn new(model: SemiExplicitModel, sensitivity: SemiExplicitSensitivityModel) -> Self {
        Self {
            solver: model.solver(),
            model,
            sensitivity,
        }
    }

    /// Adds the cotangents of y and τ by those of z, which follows from them.
    fn leave_z(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        of_z: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        if of_z.iter().all(|x| *x == 0.0) {
            return Ok(());
        }
        self.sensitivity.linearize(&mut self.model, t, (y, z))?;
        self.sensitivity.pull(of_z, &mut of.y, &mut of.tau);
        Ok(())
    }
}

impl ObservePoint for SemiExplicitPoint {
    type Model = SemiExplicitModel;

    fn observe(
        &mut self,
        (t, point): (f64, &impl Carried),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (of_y, of_z) = row.split_at(of.y.len());
        add_scaled(&mut of.y, 1.0, of_y);
        self.leave_z((t, point.y(), point.z()), of_z, of)
    }

    fn rate(
        &mut self,
        (t, point): (f64, &impl Carried),
        side: Side,
        of: &Cotangents,
    ) -> Result<f64, StepError> {
        let by = (&mut self.model, &mut self.solver);
        let [y_dot, _] = rates_beside(by, (t, point.y(), point.z()), side)?;
        Ok(of.tau[0] + dot(&of.y, &y_dot))
    }
}

impl RateTangents for SemiExplicitPoint {
    fn flow(
        &mut self,
        at: MotionPoint<'_>,
        side: Side,
        [y_dot, z_dot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let by = (&mut self.model, &mut self.solver);
        let [found, rate] = rates_beside(by, at, side)?;
        copy(y_dot, &found);
        copy(z_dot, &rate);
        Ok(())
    }

    /// None: z takes their place.
    fn multipliers(
        &mut self,
        _: MotionPoint<'_>,
        _: (TangentView<'_>, &mut Directions),
        _: &mut Matrix,
    ) -> Result<(), StepError> {
        Ok(())
    }
}
