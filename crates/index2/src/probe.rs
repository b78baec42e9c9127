//! Roundoff of the stage equations, measured by perturbing the unknowns by a few ε.

use super::CollocationEquations;
use super::stages::{CollocationStages, CollocationStep, KeptCollocation};
use liouville_base::error::StepError;
use liouville_base::linalg::{copy, furthest, max_norm};
use liouville_base::newton::{PERTURBATION, RESIDUAL_MARGIN, random_signs};

impl CollocationStages {
    /// Moves the unknowns by so many ε of their sizes.
    fn perturb(&mut self, step: CollocationStep, units: f64, seed: u64) {
        let mut sign = random_signs(seed);
        let of_v = max_norm(self.v.flat()) + max_norm(&step.state.y) / step.h.abs();
        let of_z = max_norm(self.z.flat());
        for (x, size) in [(&mut self.v, of_v), (&mut self.z, of_z)] {
            for x in x.flat_mut() {
                *x += units * f64::EPSILON * size * sign();
            }
        }
    }

    fn take_probe(&mut self) -> Box<(KeptCollocation, KeptCollocation)> {
        let taken = self.probe.take();
        taken.unwrap_or_else(|| Box::new((KeptCollocation::new(self), KeptCollocation::new(self))))
    }
}

impl CollocationEquations<'_> {
    /// Whether the residuals of (I1)–(I3) are no larger than their changes by a few ε in the unknowns.
    pub(super) fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        let (stages, step) = (&mut *self.stages, self.step);
        let mut probe = stages.take_probe();
        let (before, residuals) = &mut *probe;
        stages.evaluate(self.model, step)?;
        before.copy_from(stages);
        copy(residuals.v.flat_mut(), stages.residual.flat());
        copy(residuals.z.flat_mut(), stages.defect.flat());
        stages.perturb(step, PERTURBATION, 1);
        let perturbed = stages.evaluate(self.model, step);
        before.put_back(stages);
        let unit = max_norm(stages.v.flat()) + max_norm(&step.state.y) / step.h.abs();
        let terms = 2.0 * f64::EPSILON * unit;
        let blocks = [
            (&residuals.v, &stages.residual, terms),
            (&residuals.z, &stages.defect, terms * step.h.abs()),
        ];
        let is_solved = blocks.into_iter().all(|(kept, moved, terms)| {
            let (apart, _) = furthest(kept.flat(), moved.flat(), 1.0);
            max_norm(kept.flat()) <= RESIDUAL_MARGIN * (apart + terms)
        });
        stages.probe = Some(probe);
        perturbed.map(|()| is_solved)
    }

    /// The largest relative correction that one ε in the unknowns makes, of two tries.
    pub(super) fn largest_by_roundoff(&mut self) -> Result<f64, StepError> {
        let mut largest = 0.0_f64;
        for seed in [2, 3] {
            let mut probe = self.stages.take_probe();
            let (before, corrected) = &mut *probe;
            before.copy_from(self.stages);
            self.evaluate_and_correct()?;
            corrected.copy_from(self.stages);
            before.put_back(self.stages);
            self.stages.perturb(self.step, 1.0, seed);
            // the part of the perturbation that is left after both corrections
            let moved = self.stages.v.clone();
            self.evaluate_and_correct()?;
            let mut left = 0.0_f64;
            let ends = self.stages.v.flat().iter().zip(moved.flat());
            let others = corrected.v.flat().iter().zip(before.v.flat());
            for ((end, moved), (corrected, before)) in ends.zip(others) {
                left = left.max(((end - moved) - (corrected - before)).abs());
            }
            largest = largest.max(self.stages.relative(left, self.step));
            corrected.put_back(self.stages);
            self.stages.probe = Some(probe);
        }
        Ok(largest)
    }

    /// One correction with the matrix there is.
    fn evaluate_and_correct(&mut self) -> Result<(), StepError> {
        self.stages.evaluate(self.model, self.step)?;
        self.matrix.correct(self.model, self.stages, self.step.h);
        Ok(())
    }
}
