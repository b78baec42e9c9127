//! Roundoff of the stage equations: in the residual, and in the corrections.
//!
//! Both are measured: the unknowns are perturbed by a few ε of their size with pseudo-random signs, and the change of
//! the residual, or of the correction, is that by roundoff of the data. A bound by norms would be far too large for
//! stiff forces, whose noise lies in directions that the inverse of the Newton matrix damps.

use super::stages::{Probe, Stages, Unknowns};
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy, max_norm};
use liouville_base::newton::{PERTURBATION, RESIDUAL_MARGIN, random_signs};
use liouville_base::real::Real;
use liouville_problem::{Model, Step};

impl<R: Real> Probe<R> {
    fn new(stages: &Stages<R>) -> Self {
        Self {
            unknowns: stages.unknowns.clone(),
            corrected: stages.unknowns.clone(),
            momentum: stages.momentum_residual.clone(),
            velocity: stages.velocity_residual.clone(),
            g: stages.g.clone(),
        }
    }
}

/// `x += size ξ`, with signs ξ.
fn perturb<R: Real>(x: &mut [R], size: R, sign: &mut impl FnMut() -> f64) {
    for x in x {
        *x += size * sign();
    }
}

/// The largest difference.
fn apart<R: Real>(a: &Matrix<R>, b: &Matrix<R>) -> R {
    let pairs = a.flat().iter().zip(b.flat());
    pairs.fold(R::splat(0.0), |largest, (a, b)| {
        largest.zip((*a - *b).map(f64::abs), f64::max)
    })
}

impl<R: Real> Stages<R> {
    /// Moves the unknowns by this many ε of their sizes.
    pub(super) fn perturb(&mut self, step: Step<R>, units: f64, seed: u64) {
        let mut sign = random_signs(seed);
        let size = R::splat(units * f64::EPSILON);
        let length = max_norm(&step.state.y).zip(self.borne.length, f64::max);
        let rest = length * (1.0 / step.h.abs());
        let Unknowns { z, v, lam, nu } = &mut self.unknowns;
        let of_v = max_norm(v.flat()) + rest;
        if self.velocity_is_z {
            perturb(z.flat_mut(), of_v * size, &mut sign);
            copy(v.flat_mut(), z.flat());
        } else {
            let of_z = max_norm(z.flat());
            perturb(z.flat_mut(), of_z * size, &mut sign);
            perturb(v.flat_mut(), of_v * size, &mut sign);
        }
        for multipliers in [lam, nu] {
            let own = max_norm(multipliers.flat());
            perturb(multipliers.flat_mut(), own * size, &mut sign);
        }
    }

    /// Whether the residuals of (S1)–(S4) are no larger than their changes by a few ε in the unknowns.
    pub(super) fn is_residual_roundoff(
        &mut self,
        model: &mut Model<R>,
        step: Step<R>,
    ) -> Result<bool, StepError> {
        let mut probe = self.take_probe();
        self.evaluate(model, step)?;
        copy(probe.momentum.flat_mut(), self.momentum_residual.flat());
        copy(probe.velocity.flat_mut(), self.velocity_residual.flat());
        copy(probe.g.flat_mut(), self.g.flat());
        probe.unknowns.copy_from(&self.unknowns);
        self.perturb(step, PERTURBATION, 1);
        let perturbed = self.evaluate(model, step);
        self.unknowns.copy_from(&probe.unknowns);
        let units = (self.stop.tolerance / f64::EPSILON).max(1.0);
        let unit = self.unit(step);
        let least = [0.0, 2.0 * f64::EPSILON, 2.0 * f64::EPSILON * step.h.abs()];
        let blocks = [
            (&probe.momentum, &self.momentum_residual),
            (&probe.velocity, &self.velocity_residual),
            (&probe.g, &self.g),
        ];
        let mut is_solved = true;
        for ((kept, moved), least) in blocks.into_iter().zip(least) {
            let bound = (apart(kept, moved) + unit * least) * (RESIDUAL_MARGIN * units);
            let first = if moved.rows() > self.y.rows() {
                kept.cols()
            } else {
                0
            };
            let size = max_norm(&kept.flat()[first.min(kept.flat().len())..]);
            is_solved &= size
                .zip(bound, |size, bound| f64::from(u8::from(size <= bound)))
                .all(|x| x != 0.0);
        }
        self.probe = Some(probe);
        perturbed.map(|()| is_solved)
    }

    pub(super) fn take_probe(&mut self) -> Box<Probe<R>> {
        self.probe
            .take()
            .unwrap_or_else(|| Box::new(Probe::new(self)))
    }
}
