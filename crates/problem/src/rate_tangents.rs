//! The rates of a motion, and the tangents of its multipliers, at a point.
//!
//! A point may lie on an edge at which the equations jump: an event whose time is an end of a step. The rates there are those
//! on the side of the motion that is meant, whatever the expression of a force says at the edge: the parabola through
//! the rates at three points beside it, at its end.

use super::{
    Acceleration, AccelerationTangents, Directions, Dynamics, Model, SensitivityModel, TangentView,
};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, copy, max_norm};
use std::fmt::Debug;

/// Rates on one side are looked at so far from a point, as parts of a step, ...
const NEAR: f64 = 1.0 / (1 << 14) as f64;
/// ... or where it is more, in roundings of the time, ...
const ROUNDINGS: f64 = (1 << 12) as f64 * f64::EPSILON;
/// ... and are those at the point unless they differ by this part of the largest.
const SAME: f64 = 1e-9;

/// A point of a motion: t, y and z.
pub type MotionPoint<'a> = (f64, &'a [f64], &'a [f64]);

/// A side of a point of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Side {
    /// Before it, in a step of this length.
    Before(f64),
    /// Behind it, in a step of this length.
    After(f64),
}

impl Side {
    /// How far the nearest point is at which rates are looked at.
    fn distance(self, t: f64) -> f64 {
        let (h, sign) = match self {
            Self::Before(h) => (h, -1.0),
            Self::After(h) => (h, 1.0),
        };
        sign * (NEAR * h.abs()).max(ROUNDINGS * t.abs()).copysign(h)
    }
}

/// y' and z' on one side of a point of a motion.
///
/// # Errors
/// A value that is not finite at the point, or a singular matrix.
pub fn rates_beside<M: Dynamics>(
    (model, solver): (&mut M, &mut M::Solver),
    (t, y, z): MotionPoint<'_>,
    side: Side,
) -> Result<[Vec<f64>; 2], StepError> {
    let mut at = |t: f64, y: &[f64], z: &mut [f64], is_beside: bool| {
        if is_beside {
            model.settle(t, y, z)?;
        }
        let (mut y_dot, mut y_ddot) = (vec![0.0; y.len()], vec![0.0; y.len()]);
        model.solve(solver, t, y, z)?;
        model.derivatives(solver, t, (y, z), [&mut y_dot, &mut y_ddot])?;
        Ok(([y_dot, M::z_dot(solver).to_vec()], y_ddot))
    };
    let (own, y_ddot) = at(t, y, &mut z.to_vec(), false)?;
    let mut beside = [0.0; 3].map(|_| own.clone());
    for (k, rates) in beside.iter_mut().enumerate() {
        let by = (k + 1) as f64 * side.distance(t);
        let (mut y, mut z) = (y.to_vec(), z.to_vec());
        add_scaled(&mut y, by, &own[0]);
        add_scaled(&mut y, by * by / 2.0, &y_ddot);
        add_scaled(&mut z, by, &own[1]);
        // a model that ends at the edge has the rates of the point
        let Ok((found, _)) = at(t + by, &y, &mut z, true) else {
            return Ok(own);
        };
        *rates = found;
    }
    let [near, far, farther] = beside;
    let mut found = near;
    for ((found, far), farther) in found.iter_mut().zip(&far).zip(&farther) {
        for ((x, far), farther) in found.iter_mut().zip(far).zip(farther) {
            *x = 3.0 * (*x - far) + farther;
        }
    }
    let differs = |(found, own): (&Vec<f64>, &Vec<f64>)| {
        let most = SAME * max_norm(found).max(max_norm(own));
        found.iter().zip(own).any(|(a, b)| (a - b).abs() > most)
    };
    let is_edge = found.iter().zip(&own).any(differs);
    Ok(if is_edge { found } else { own })
}

/// Rates at a point, and tangents of multipliers from those of y, z and time there.
pub trait RateTangents: Debug + Send + Sync {
    /// Writes y' and z' on one side.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    fn flow(
        &mut self,
        at: MotionPoint<'_>,
        side: Side,
        out: [&mut [f64]; 2],
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

/// Tangents of the rates of a mechanical motion, by the equations of its accelerations.
#[derive(Clone, Debug)]
pub struct MotionTangents {
    solver: Acceleration,
    tangents: AccelerationTangents,
}

impl MotionTangents {
    /// Makes the tangents of this model.
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
        at: MotionPoint<'_>,
        side: Side,
        [y_dot, z_dot]: [&mut [f64]; 2],
    ) -> Result<(), StepError> {
        let by = (&mut self.tangents.model, &mut self.solver);
        let [found, rate] = rates_beside(by, at, side)?;
        copy(y_dot, &found);
        copy(z_dot, &rate);
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
