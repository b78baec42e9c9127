//! Tangents of the rates of a motion and of its multipliers at a point.

use super::{Acceleration, AccelerationTangents, Directions, Model, SensitivityModel, TangentView};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy};
use std::fmt::Debug;

/// A point of a motion: t, y and z.
pub type MotionPoint<'a> = (f64, &'a [f64], &'a [f64]);

/// Tangents of rates and multipliers at a point, from those of y, z and time there.
pub trait RateTangents: Debug + Send + Sync {
    /// Writes y' and z'.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn flow(&mut self, at: MotionPoint<'_>, out: [&mut [f64]; 2]) -> Result<(), StepError>;

    /// Writes the tangents of y', y'' and z' in one direction after another.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    fn rates(
        &mut self,
        at: MotionPoint<'_>,
        along: (TangentView<'_>, &mut Directions),
        out: [&mut [f64]; 3],
    ) -> Result<(), StepError>;

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

    /// Adds the tangents of y' and y'' where v is not z.
    fn add_velocities(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        (of, directions): (TangentView<'_>, &mut Directions),
        [velocities, accelerations, rates]: [&mut [f64]; 3],
    ) {
        let (n, count) = (y.len(), directions.count());
        let own = |k: usize| k * n..(k + 1) * n;
        let AccelerationTangents {
            model, sensitivity, ..
        } = &mut self.tangents;
        let problem = sensitivity.problem.clone();
        let (at, by_tau) = (&problem.mechanical.patterns, &problem.patterns);
        let [_, v_z] = model.stage_blocks(t, y, z);
        if let Some(pattern) = &at.v_z {
            for k in 0..count {
                pattern.multiply_add(v_z, 1.0, of.z.row(k), &mut velocities[own(k)]);
                pattern.multiply_add(v_z, 1.0, &rates[own(k)], &mut accelerations[own(k)]);
            }
        }
        let [_, _, _, v_y] = model.stage_jacobian(t, y, z);
        for k in 0..count {
            at.v_y
                .multiply_add(v_y, 1.0, of.y.row(k), &mut velocities[own(k)]);
        }
        let [_, _, v_tau] = sensitivity.stage(t, y, z);
        if let Some(pattern) = &by_tau.v_tau {
            for k in 0..count {
                let tau = directions.tau(k, of.t[k]);
                pattern.multiply_add(v_tau, 1.0, tau, &mut velocities[own(k)]);
            }
        }
        let slopes = sensitivity.velocity(t, [y, z, &self.solver.z_dot]);
        if let (Some(slopes), Some(patterns)) = (slopes, &by_tau.velocity) {
            for k in 0..count {
                let tau = directions.tau(k, of.t[k]);
                let along = [of.y.row(k), of.z.row(k), tau];
                for ((pattern, values), x) in patterns.iter().zip(slopes).zip(along) {
                    pattern.multiply_add(values, 1.0, x, &mut accelerations[own(k)]);
                }
            }
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

    fn rates(
        &mut self,
        (t, y, z): MotionPoint<'_>,
        (of, directions): (TangentView<'_>, &mut Directions),
        [velocities, accelerations, rates]: [&mut [f64]; 3],
    ) -> Result<(), StepError> {
        let (n, solver) = (y.len(), &mut self.solver);
        solver.solve(&mut self.tangents.model, t, y, z)?;
        let (point, along) = ([y, z, &solver.z_dot, &solver.lam], (of, &mut *directions));
        self.tangents
            .solve((t, point), along, |direction, rate, _| {
                copy(&mut rates[direction * n..(direction + 1) * n], rate);
            })?;
        if self.tangents.sensitivity.problem.velocity.is_some() {
            velocities.fill(0.0);
            accelerations.fill(0.0);
            let out = [velocities, accelerations, rates];
            self.add_velocities((t, y, z), (of, directions), out);
        } else {
            copy(velocities, &of.z.flat()[..rates.len()]);
            copy(accelerations, rates);
        }
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
