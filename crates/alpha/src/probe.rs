//! Roundoff of the equations of a step, measured by perturbing the unknowns by a few ε.

use super::solve::AlphaEquations;
use super::unknowns::AlphaStep;
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, max_norm};
use liouville_base::newton::{PERTURBATION, RESIDUAL_MARGIN, random_signs};

impl AlphaEquations<'_> {
    /// Whether the residuals are no larger than their changes by a few ε in the unknowns.
    pub(super) fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.evaluate()?;
        self.hold_residuals();
        let perturbed = self.perturbed(PERTURBATION, 1, Self::evaluate);
        perturbed.map(|()| self.is_roundoff())
    }

    /// The largest relative correction that one ε in the unknowns makes, of two tries.
    pub(super) fn largest_by_roundoff(&mut self) -> Result<f64, StepError> {
        let n = self.solver.y.len();
        let mut largest = 0.0_f64;
        for seed in [2, 3] {
            self.evaluate()?;
            self.solve();
            let at = &mut *self.solver;
            at.delta[..n].copy_from_slice(&at.x[..n]);
            at.delta[n..2 * n].copy_from_slice(&at.zeta);
            self.perturbed(1.0, seed, |moved| {
                moved.evaluate()?;
                moved.solve();
                Ok(())
            })?;
            let at = &mut *self.solver;
            add_scaled(&mut at.x[..n], -1.0, &at.delta[..n]);
            add_scaled(&mut at.zeta, -1.0, &at.delta[n..2 * n]);
            largest = largest.max(self.size());
        }
        Ok(largest)
    }

    /// Calls `act` with the unknowns perturbed by `units` ε of their sizes, then restores them.
    fn perturbed(
        &mut self,
        units: f64,
        seed: u64,
        mut act: impl FnMut(&mut Self) -> Result<(), StepError>,
    ) -> Result<(), StepError> {
        let mut probe = self.solver.probe.take().unwrap_or_default();
        probe.copy_from(self.solver);
        self.perturb(units, seed);
        let acted = act(self);
        probe.put_back(self.solver);
        self.solver.probe = Some(probe);
        acted
    }

    /// Keeps all residuals in `delta`.
    fn hold_residuals(&mut self) {
        let at = &mut *self.solver;
        let n = at.force.len();
        let first = if at.is_paired() { 2 * n } else { n };
        let all = at
            .force
            .iter()
            .chain(&at.reaction_residuals[0])
            .chain(&at.reaction_residuals[1])
            .chain(&at.x[first..]);
        for (out, x) in at.delta.iter_mut().zip(all) {
            *out = *x;
        }
    }

    /// Moves the unknowns by so many ε of their sizes, and y1 by as much of its own.
    fn perturb(&mut self, units: f64, seed: u64) {
        let AlphaStep { h, state, .. } = self.step;
        let unit = max_norm(&state.y).max(self.borne.length) + h.abs() * max_norm(&state.z);
        let at = &mut *self.solver;
        let of_phi = max_norm(&at.phi) + unit / (h * h * at.coupling.phi[0]);
        let mut sign = random_signs(seed);
        let mut perturb = |x: &mut [f64], size: f64| {
            for x in x {
                *x += units * f64::EPSILON * size * sign();
            }
        };
        perturb(&mut at.phi, of_phi);
        for reaction in &mut at.reactions {
            let (a, lam) = (max_norm(&reaction.a), max_norm(&reaction.lam));
            perturb(&mut reaction.a, a);
            perturb(&mut reaction.lam, lam);
        }
    }

    /// Whether the residuals kept are what the unknowns' move has changed in each kind of them, and, of constraints,
    /// two roundings of the coordinates.
    fn is_roundoff(&self) -> bool {
        let AlphaStep { h, state, .. } = self.step;
        let at = &*self.solver;
        let unit =
            (max_norm(&state.y) / (h * h) + max_norm(&state.z) / h.abs()).max(self.borne.rate(h));
        let n = at.force.len();
        let (force, rest) = at.delta.split_at(n);
        let (pulls, constraints) = rest.split_at(2 * n);
        let margin = RESIDUAL_MARGIN * (at.stop().tolerance / f64::EPSILON).max(1.0);
        let first = if at.is_paired() { 2 * n } else { n };
        let (first_pull, last_pull) = pulls.split_at(n);
        let blocks = [
            (force, &at.force[..], 0.0),
            (first_pull, &at.reaction_residuals[0], 0.0),
            (last_pull, &at.reaction_residuals[1], 0.0),
            (constraints, &at.x[first..], 2.0 * f64::EPSILON * unit),
        ];
        blocks.into_iter().all(|(kept, moved, least)| {
            let pairs = kept.iter().zip(moved);
            let (mut size, mut apart) = (0.0_f64, 0.0_f64);
            for (kept, moved) in pairs {
                size = size.max(kept.abs());
                apart = apart.max((kept - moved).abs());
            }
            size <= margin * (apart + least)
        })
    }
}
