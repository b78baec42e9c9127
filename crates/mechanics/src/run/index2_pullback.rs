//! Pullbacks of the index-2 methods.

use super::pullback::Pullback;
use super::recording::{Recording, StepAdjoint, no_directions};
use super::{Job, Method, Problem, Starter, System};
use crate::events::HiddenMoves;
use liouville_base::error::StepError;
use liouville_base::recorder::StepRecord;
use liouville_base::run::StartError;
use liouville_index2::semi_explicit::{
    SemiExplicitPoint, SemiExplicitSensitivity, SemiExplicitSensitivityModel, SemiExplicitState,
};
use liouville_index2::{Index2Adjoint, Index2Tangents};
use liouville_problem::{Cotangents, TangentLed};
use std::sync::Arc;

impl StepAdjoint for Index2Adjoint {
    type State = SemiExplicitState;
    type Point = SemiExplicitPoint;

    /// Cotangents of z go to y at once.
    fn sizes(n: usize) -> [usize; 3] {
        [n, 0, 0]
    }

    fn follow(
        &mut self,
        record: &StepRecord<SemiExplicitState>,
        _: &mut SemiExplicitPoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.follow(record, of)
    }

    fn leave(
        &mut self,
        _: (f64, &SemiExplicitState),
        _: bool,
        _: &mut SemiExplicitPoint,
        _: &mut Cotangents,
    ) -> Result<(), StepError> {
        Ok(())
    }
}

impl Pullback<Index2Adjoint> {
    /// The pullback of a job's run, whose derivatives by τ are `sensitivity`.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn of_index2(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<SemiExplicitSensitivity>,
    ) -> Result<Self, StartError> {
        let starter = Starter::new(problem, method, job)?;
        let invalid = || {
            let sentence = "a pullback of an index-2 method is that of a single run of its system, of events with \
                            derivatives, without newton_tol";
            StartError::Invalid(sentence.into())
        };
        let System::Index2(problem, spark, stages) = &starter.system else {
            return Err(invalid());
        };
        let job = &starter.job;
        let is_single = job.tangents.is_none() && job.members.is_none();
        let fits = Arc::ptr_eq(&sensitivity.system, problem) && spark.newton_tol.is_none();
        if !(is_single && fits && job.has_slopes()) {
            return Err(invalid());
        }
        let (stepper, start, sizes) = starter.index2_at((problem, &spark.tableau), 0)?;
        let derivatives = SemiExplicitSensitivityModel::new(sensitivity.clone(), starter.params(0));
        let adjoint = Index2Adjoint::new(&stepper, derivatives.clone());
        let member = starter.semi_explicit_member(problem, 0);
        let model = member.model.clone();
        let monitor = starter.traced(0, || model.clone());
        let stages = stages.as_deref();
        let steps = if sizes.is_some() {
            let at = (starter.job.span.t0, start.clone(), starter.params(0));
            let (directions, [y, _]) = no_directions(problem.n, sensitivity.width());
            let part = stepper.clone();
            let of = Index2Tangents::new(stepper, derivatives.clone(), directions, at, y)?;
            let led = TangentLed::new(of);
            starter.recorded_steps((led, part, stages), sizes, monitor, &start)
        } else {
            let part = stepper.clone();
            starter.recorded_steps((stepper, part, stages), sizes, monitor, &start)
        };
        let method = Recording {
            point: SemiExplicitPoint::new(model.clone(), derivatives.clone()),
            reset: Box::new(HiddenMoves::listed(model, derivatives)),
            sizes: [problem.n, problem.l, 0],
            adjoint,
            steps,
            member,
            start,
            is_given: false,
        };
        Ok(Self::of(&starter, sensitivity.width(), method)?)
    }
}
