//! The sizes of corrections of the α family.

use super::Reactions;
use super::solve::{AlphaEquations, NOISE};
use liouville_base::error::StepError;
use liouville_base::linalg::max_norm;

impl AlphaEquations<'_> {
    /// The corrections h² η and h ζ, in units of the position and of the velocity; without A, the
    /// velocity goes with the position, whose roundoff it has in units of 1/h.
    pub(super) fn size(&mut self) -> f64 {
        let [eta, zeta] = self.moved_by();
        self.moved_y = eta;
        let (at, h) = (&*self.solver, self.step.h.abs());
        let [unit, z, phi] = self.units();
        let of_y = relative(eta, unit);
        match at.reactions_by {
            Reactions::Position => of_y,
            Reactions::Extended { .. } => of_y.max(relative(zeta, z.max(h * phi))),
        }
    }

    /// How far corrections of the multipliers alone move y1, in units of the position: where reactions are not linear in
    /// them, it need not show in η and ζ. Nothing below the noise, which roundings of y make in h² λ.
    pub(super) fn multiplier_size(&mut self) -> Result<f64, StepError> {
        let (at, h) = (&*self.solver, self.step.h);
        let (n, m) = (at.force.len(), at.reactions[1].lam.len());
        if m == 0 || self.model.problem.mechanical.is_linear {
            return Ok(0.0);
        }
        let (corrected, unit) = if at.is_paired() {
            (&at.x[2 * n..], 1.0)
        } else {
            (&at.x[n..], 1.0 / at.coupling.phi[0])
        };
        let (reactions, mut largest) = (at.reactions.iter().rev(), 0.0_f64);
        for (reaction, d_lam) in reactions.zip(corrected.rchunks_exact(m)) {
            let [_, r_lam] = (self.model).node_blocks(self.step.t + h, &at.y, &reaction.lam)?;
            largest = largest.max(self.matrix.mass.velocity_of(r_lam, d_lam));
        }
        let size = relative(h * h * unit * largest, self.units()[0]);
        Ok(if size < NOISE { 0.0 } else { size })
    }

    /// The position, or what velocities and accelerations make of it in a step; and these.
    fn units(&self) -> [f64; 3] {
        let (at, h) = (&*self.solver, self.step.h.abs());
        let (z, phi) = (max_norm(&at.z), max_norm(&at.phi).max(self.borne.rate(h)));
        [max_norm(&at.y).max(h * z).max(h * h * phi), z, phi]
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
