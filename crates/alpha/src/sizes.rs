//! The sizes of corrections of the α family.

use super::Reactions;
use super::solve::AlphaEquations;
use liouville_base::linalg::max_norm;

impl AlphaEquations<'_> {
    /// The corrections h² η and h ζ, in units of the position and of the velocity; without A, the
    /// velocity goes with the position, whose roundoff it has in units of 1/h.
    pub(super) fn size(&mut self) -> f64 {
        let [eta, zeta] = self.moved_by();
        self.moved_y = eta;
        let (at, h) = (&*self.solver, self.step.h.abs());
        let (y, z) = (max_norm(&at.y), max_norm(&at.z));
        let phi = max_norm(&at.phi).max(self.borne);
        let of_y = relative(eta, y.max(h * z).max(h * h * phi));
        match at.reactions_by {
            Reactions::Position => of_y,
            Reactions::Extended { .. } => of_y.max(relative(zeta, z.max(h * phi))),
        }
    }

    /// How far the correction has moved y1 and z1.
    pub(super) fn moved_by(&self) -> [f64; 2] {
        let (at, h) = (&*self.solver, self.step.h.abs());
        let eta = &at.x[..at.y.len()];
        [h * h * max_norm(eta), h * max_norm(&at.zeta)]
    }

    /// Whether the correction just made was the only one needed: the equations are linear, the factors
    /// theirs, and its own roundoff is none of y1 and z1, since it was not larger than they are.
    pub(super) fn is_exact(&mut self) -> bool {
        let (at, h) = (&mut *self.solver, self.step.h);
        if !(at.is_affine && self.matrix.reuse.is_for(h)) {
            return false;
        }
        at.place(h);
        let (y, z) = (max_norm(&at.y), max_norm(&at.z));
        let [by_y, by_z] = self.moved_by();
        by_y <= y && by_z <= z
    }
}

/// `d` in units of `x`, at most 1.
fn relative(d: f64, x: f64) -> f64 {
    if d == 0.0 { 0.0 } else { d / x.max(d) }
}
