//! The knots of a trajectory, at the ends of steps, and its values between them.

use super::super::{Carried, Dynamics, TangentView};
use super::Path;
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::linalg::{Matrix, copy};

/// A point of a trajectory between steps.
#[derive(Clone, Debug)]
pub struct Point {
    /// Coordinates.
    pub y: Vec<f64>,
    /// Velocities or momenta, as the system has them.
    pub z: Vec<f64>,
    /// The method's accelerations and the work done so far, of methods that carry them.
    pub(super) carried: Option<(Vec<f64>, f64)>,
    /// Tangents at a time that is held, of motions that carry them.
    pub(super) tangents: Option<PointTangents>,
}

/// Tangents of a point, a row for each direction.
#[derive(Clone, Debug)]
pub(super) struct PointTangents {
    pub(super) y: Matrix,
    pub(super) z: Matrix,
    /// None.
    pub(super) t: Vec<f64>,
}

impl KnotTangents {
    /// Into the memory there is.
    pub(super) fn copy_from(&mut self, other: &Self) {
        let own = self.y.iter_mut().chain(&mut self.z);
        for (own, other) in own.zip(other.y.iter().chain(&other.z)) {
            copy(own, other);
        }
        copy(&mut self.t, &other.t);
    }
}

impl Carried for Point {
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn z(&self) -> &[f64] {
        &self.z
    }

    fn accelerations(&self) -> Option<(&[f64], f64)> {
        self.carried.as_ref().map(|(a, work)| (&a[..], *work))
    }

    fn tangents(&self) -> Option<TangentView<'_>> {
        let PointTangents { y, z, t } = self.tangents.as_ref()?;
        Some(TangentView { y, z, t })
    }
}

/// The end of a step: y, y', y'', and z and z' where z is not y'.
#[derive(Clone, Debug)]
pub(super) struct Knot {
    pub(super) t: f64,
    pub(super) y: [Vec<f64>; 3],
    pub(super) z: [Vec<f64>; 2],
    pub(super) carried: Option<(Vec<f64>, f64)>,
    pub(super) tangents: Option<KnotTangents>,
}

/// Tangents of all this, in one direction after another.
#[derive(Clone, Debug)]
pub(super) struct KnotTangents {
    pub(super) y: [Vec<f64>; 3],
    pub(super) z: [Vec<f64>; 2],
    pub(super) t: Vec<f64>,
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

impl Checkpoint for Knot {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.t.save(member, out);
        self.y.save(member, out);
        self.z.save(member, out);
        self.carried.save(member, out);
        if let Some(tangents) = &self.tangents {
            tangents.save(member, out);
        }
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.t.restore(member, saved)?;
        self.y.restore(member, saved)?;
        self.z.restore(member, saved)?;
        let none = || (vec![0.0; self.y[0].len()], 0.0);
        // sizes that are missing are taken as that of y
        self.carried.get_or_insert_with(none);
        self.carried.restore(member, saved)?;
        match &mut self.tangents {
            Some(tangents) => tangents.restore(member, saved),
            None => Ok(()),
        }
    }
}

liouville_base::checkpoint!(KnotTangents { y, z, t });
