//! The stage equations of one step: what all solvers of them share.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::stages::Stages;
use liouville_base::error::StepError;
use liouville_base::linalg::{copy, max_norm};
use liouville_base::newton::{Equations, Stop};
use liouville_base::real::Real;
use liouville_problem::{Model, Step};

/// The stage equations of one step, with a solver: node Schur, full Newton, or the small matrix of full Newton.
pub(super) struct StageEquations<'a, S, R = f64> {
    pub(super) solver: S,
    pub(super) stages: &'a mut Stages<R>,
    pub(super) model: &'a mut Model<R>,
    pub(super) step: Step<'a, R>,
    pub(super) is_linearized: bool,
}

impl<'a, S, R> StageEquations<'a, S, R> {
    /// The equations of one step, still to be linearised.
    pub(super) fn new(
        solver: S,
        stages: &'a mut Stages<R>,
        model: &'a mut Model<R>,
        step: Step<'a, R>,
    ) -> Self {
        Self {
            solver,
            stages,
            model,
            step,
            is_linearized: false,
        }
    }
}

/// One correction of the stage equations.
pub(super) trait CorrectStages<R: Real> {
    /// Corrects the unknowns, whose residuals are evaluated, and returns the relative size.
    ///
    /// # Errors
    /// A value is not finite, or a matrix is singular.
    fn correct_unknowns(&mut self) -> Result<R, StepError>;

    /// Whether the determinant of the last matrix has another sign than that of a small step, if that is known.
    fn has_reversed(&mut self, _is_doubtful: bool) -> bool {
        false
    }

    /// Whether the last correction does negative work, where that tells of a fold.
    fn corrects_against(&self) -> bool {
        false
    }

    /// Keeps the unknowns of members that take no further corrections.
    fn keep_members(&mut self, _members: R) {}

    /// Puts them back.
    fn put_members_back(&mut self, _members: R) {}
}

impl<S, R: Real> Equations<R> for StageEquations<'_, S, R>
where
    Self: CorrectStages<R>,
{
    fn stop(&self) -> Stop {
        self.stages.stop
    }

    #[inline(always)]
    fn scaled_size(&self, size: R) -> R {
        self.stages.scaled_size(size)
    }

    #[inline(always)]
    fn deviation(&self) -> R {
        self.stages.deviation(self.step)
    }

    fn is_reversed(&mut self, is_doubtful: bool) -> bool {
        self.stages.yardstick.member(0) != 0.0 && self.has_reversed(is_doubtful)
    }

    fn is_against(&self) -> bool {
        self.corrects_against()
    }

    fn refresh(&mut self) {
        self.is_linearized = false;
    }

    fn is_residual_roundoff(&mut self) -> Result<bool, StepError> {
        self.stages.is_residual_roundoff(self.model, self.step)
    }

    /// The largest change of a correction by one ε in the unknowns, relative, of two perturbations; leaves the unknowns
    /// corrected.
    fn roundoff_floor(&mut self) -> Result<f64, StepError> {
        let mut largest = 0.0_f64;
        for seed in [2, 3] {
            let stages = &mut *self.stages;
            let mut probe = stages.take_probe();
            probe.unknowns.copy_from(&stages.unknowns);
            self.correct()?;
            let (stages, step) = (&mut *self.stages, self.step);
            probe.corrected.copy_from(&stages.unknowns);
            stages.unknowns.copy_from(&probe.unknowns);
            stages.perturb(step, 1.0, seed);
            copy(probe.momentum.flat_mut(), stages.unknowns.v.flat());
            self.correct()?;
            let (stages, step) = (&mut *self.stages, self.step);
            // the part of the perturbation that is left after both corrections
            let moves = probe
                .momentum
                .flat_mut()
                .iter_mut()
                .zip(stages.unknowns.v.flat());
            let before = probe.unknowns.v.flat().iter().zip(probe.corrected.v.flat());
            for ((out, moved), (start, corrected)) in moves.zip(before) {
                *out = (*moved - *out) - (*corrected - *start);
            }
            let size = max_norm(probe.momentum.flat());
            largest = largest.max(stages.relative(size, step).member(0));
            stages.unknowns.copy_from(&probe.corrected);
            stages.probe = Some(probe);
        }
        Ok(largest)
    }

    fn correct(&mut self) -> Result<R, StepError> {
        self.stages.evaluate(self.model, self.step)?;
        self.correct_unknowns()
    }

    #[inline(always)]
    fn keep(&mut self, members: R) {
        self.keep_members(members);
    }

    #[inline(always)]
    fn put_back(&mut self, members: R) {
        self.put_members_back(members);
    }
}
