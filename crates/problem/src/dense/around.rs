//! A motion shortly before and after a state, of which nothing is known but the state itself.

use super::super::{Carried, Dynamics};
use super::Path;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;

/// A point on the parabola which a motion touches in a state, and λ there.
#[derive(Clone, Debug)]
pub struct Nearby {
    /// When.
    pub t: f64,
    /// Coordinates.
    pub y: Vec<f64>,
    /// Velocities or momenta, as the system has them.
    pub z: Vec<f64>,
    /// λ, or that of the path where it is not wanted.
    pub lam: Vec<f64>,
}

impl<M: Dynamics> Path<M> {
    /// Finds points at so many times from `t`, around a state there, and y' and z' in it.
    ///
    /// Later solutions of the path do not depend on them.
    ///
    /// # Errors
    /// A value that is not finite, or a singular matrix.
    pub fn around<const K: usize>(
        &mut self,
        (t, state): (f64, &impl Carried),
        times: [f64; K],
        needs_lam: bool,
    ) -> Result<([Nearby; K], [Vec<f64>; 2]), StepError> {
        let kept = self.solver.clone();
        let found = self.touch((t, state.y(), state.z()), times, needs_lam);
        self.solver = kept;
        found
    }

    fn touch<const K: usize>(
        &mut self,
        (t, y, z): (f64, &[f64], &[f64]),
        times: [f64; K],
        needs_lam: bool,
    ) -> Result<([Nearby; K], [Vec<f64>; 2]), StepError> {
        let Self { model, solver, .. } = self;
        model.solve(solver, t, y, z)?;
        let mut rates = [vec![0.0; y.len()], vec![0.0; y.len()]];
        let [y_dot, y_ddot] = &mut rates;
        model.derivatives(solver, t, (y, z), [y_dot, y_ddot])?;
        let [y_dot, y_ddot] = rates;
        let z_dot = M::z_dot(solver).to_vec();
        let mut points = times.map(|by| {
            let (mut y, mut z) = (y.to_vec(), z.to_vec());
            add_scaled(&mut y, by, &y_dot);
            add_scaled(&mut y, by * by / 2.0, &y_ddot);
            add_scaled(&mut z, by, &z_dot);
            let (t, lam) = (t + by, M::lam(solver).to_vec());
            Nearby { t, y, z, lam }
        });
        for point in points.iter_mut().filter(|_| needs_lam) {
            model.solve_lam(solver, point.t, &point.y, &point.z)?;
            point.lam.copy_from_slice(M::lam(solver));
        }
        Ok((points, [y_dot, z_dot]))
    }
}
