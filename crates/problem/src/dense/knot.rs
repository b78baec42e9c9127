//! The knots of a trajectory, at the ends of steps, and its values between them.

use super::super::Dynamics;
use super::Path;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};

/// A point of a trajectory between steps.
#[derive(Clone, Debug)]
pub struct Point {
    /// Coordinates.
    pub y: Vec<f64>,
    /// Velocities or momenta, as the system has them.
    pub z: Vec<f64>,
}

/// The end of a step: y, y', y'', and z and z' where z is not y'.
#[derive(Clone, Debug)]
pub(super) struct Knot {
    pub(super) t: f64,
    pub(super) y: [Vec<f64>; 3],
    pub(super) z: [Vec<f64>; 2],
}

/// The knots; polynomials are fitted again, to the same bits.
impl<M: Dynamics> Checkpoint for Path<M> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.knots.len().save(member, out);
        for knot in &self.knots {
            knot.save(member, out);
        }
        self.solver.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        let mut count = 0_usize;
        count.restore(member, saved)?;
        self.spare.append(&mut self.knots);
        for _ in 0..count {
            let mut knot = self.spare.pop().ok_or(CheckpointMismatch)?;
            knot.restore(member, saved)?;
            self.knots.push(knot);
        }
        self.is_fitted = false;
        self.solver.restore(member, saved)
    }
}

liouville_base::checkpoint!(Knot { t, y, z });
