//! The state of the α family.

use liouville_problem::Carried;

/// The state that is carried from step to step.
#[derive(Debug, PartialEq)]
pub struct AlphaState {
    /// Coordinates.
    pub y: Vec<f64>,
    /// Velocities.
    pub z: Vec<f64>,
    /// The method's accelerations.
    pub a: Vec<f64>,
    /// φ at the present time.
    pub phi: Vec<f64>,
    /// The last step, 0 before there is one.
    pub h: f64,
    /// Work of the forces without a potential, by the trapezoidal rule.
    pub work: f64,
    pub(super) power: f64,
}

liouville_base::clone_in_place!(AlphaState {
    y,
    z,
    a,
    phi,
    h,
    work,
    power
});

impl Carried for AlphaState {
    fn y(&self) -> &[f64] {
        &self.y
    }

    fn z(&self) -> &[f64] {
        &self.z
    }

    fn accelerations(&self) -> Option<(&[f64], f64)> {
        Some((&self.a, self.work))
    }
}

liouville_base::checkpoint!(AlphaState {
    y,
    z,
    a,
    phi,
    h,
    work,
    power
});
liouville_base::recorded!([] AlphaState {
    y,
    z,
    a,
    phi,
    h,
    work,
    power
});
