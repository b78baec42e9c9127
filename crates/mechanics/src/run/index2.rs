//! Runs of the index-2 methods.

use super::member::Member;
use super::{Begun, Control, MethodStart, Starter};
use liouville_base::error::StepError;
use liouville_base::tableau;
use liouville_index2::Index2;
use liouville_index2::semi_explicit::{
    SemiExplicit, SemiExplicitModel, SemiExplicitRestart, SemiExplicitState,
};
use std::sync::Arc;

impl Starter {
    pub(super) fn index2_at(
        &self,
        (problem, tableau): (&Arc<SemiExplicit>, &tableau::Spark),
        member: usize,
    ) -> Result<MethodStart<Index2, SemiExplicitState>, StepError> {
        let span = self.job.span;
        let mut model = SemiExplicitModel::new(problem.clone(), self.params(member));
        let (y, z) = (self.part(0, member), self.part(1, member));
        let state = model.state(span.t0, y, z, span.h())?;
        let stepper = Index2::of(model, tableau);
        let Control::Adaptive {
            tolerance,
            h_first,
            h_min,
        } = &self.job.control
        else {
            return Ok((stepper, state, None));
        };
        let mut stepper = stepper.estimating(tableau, tolerance.clone());
        let h_first = match h_first {
            Some(h_first) => *h_first,
            None => stepper.first_step(span.t0, &state)?,
        };
        Ok((stepper, state, Some((h_first, *h_min))))
    }

    /// A member of a semi-explicit system.
    pub(super) fn semi_explicit_member(
        &self,
        problem: &Arc<SemiExplicit>,
        number: usize,
    ) -> Member<SemiExplicitState, SemiExplicitModel> {
        let model = SemiExplicitModel::new(problem.clone(), self.params(number));
        let restart = self.has_resets();
        let restart = restart.then(|| Box::new(SemiExplicitRestart::new(model.clone())) as _);
        Member {
            number,
            model,
            restart,
        }
    }

    pub(super) fn index2(
        &self,
        (problem, tableau): (&Arc<SemiExplicit>, &tableau::Spark),
        stages: Option<&[f64]>,
        member: usize,
    ) -> Begun {
        let start = self.index2_at((problem, tableau), member)?;
        let of = self.semi_explicit_member(problem, member);
        if let Some(tangents) = &self.job.tangents {
            return self.index2_tangents((start, stages), tangents, of);
        }
        let (stepper, state, sizes) = start;
        match sizes {
            None => {
                let monitor = self.traced(member, || of.model.clone());
                self.symmetric((stepper, stages), monitor, of, state)
            }
            Some(sizes) => self.adaptive(stepper, sizes, of, state),
        }
    }
}
