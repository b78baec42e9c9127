//! Pullbacks of SPARK methods.

use super::pullback::Pullback;
use super::recording::{Recording, StepAdjoint, no_directions};
use super::{Job, Method, Problem, Starter, System};
use crate::events::{Impulses, LinearReset};
use liouville_base::error::StepError;
use liouville_base::recorder::StepRecord;
use liouville_base::run::StartError;
use liouville_problem::{
    Cotangents, PointAdjoint, Sensitivity, SensitivityModel, State, TangentLed,
};
use liouville_spark::{SparkAdjoint, SparkTangents};
use std::sync::Arc;

impl StepAdjoint for SparkAdjoint {
    type State = State;
    type Point = PointAdjoint;

    fn sizes(n: usize) -> [usize; 3] {
        [n; 3]
    }

    fn follow(
        &mut self,
        record: &StepRecord<State>,
        _: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        self.follow(record, of)
    }

    fn leave(
        &mut self,
        at: (f64, &State),
        _: bool,
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (t, State { y, z, .. }) = at;
        point.leave_momenta((t, y, z), of)
    }
}

impl Starter {
    /// The adjoints of points and resets of a mechanical run, and the numbers of y, z and multipliers.
    pub(super) fn mechanical_adjoints(
        &self,
        sensitivity: &Arc<Sensitivity>,
    ) -> (PointAdjoint, Box<dyn LinearReset>, [usize; 3]) {
        let derivatives = SensitivityModel::new(sensitivity.clone(), self.params(0));
        let model = self.model(0);
        let sizes = [
            model.problem.n,
            model.problem.n,
            model.problem.multipliers(),
        ];
        let reset = Impulses::listed(model.clone(), derivatives.problem.width());
        let point = PointAdjoint::new(model, derivatives);
        (point, Box::new(reset), sizes)
    }
}

impl Pullback<SparkAdjoint> {
    /// The pullback of a job's run, whose derivatives by τ are `sensitivity`.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn new(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<Sensitivity>,
    ) -> Result<Self, StartError> {
        let starter = Starter::new(problem, method, job)?;
        let System::Spark((problem, pools), spark, stages) = &starter.system else {
            return Err(StartError::Invalid(
                "a pullback is that of a SPARK method".into(),
            ));
        };
        if !starter.has_pullback(sensitivity) || spark.newton_tol.is_some() {
            let sentence = "a pullback is that of a single run, of events with derivatives, whose stages are solved to \
                            roundoff";
            return Err(StartError::Invalid(sentence.into()));
        }
        let (stepper, start, sizes) = starter.spark_at((problem, pools, spark), 0)?;
        let stepper = stepper.keep();
        let derivatives = SensitivityModel::new(sensitivity.clone(), starter.params(0));
        let adjoint = SparkAdjoint::new(&stepper, derivatives.clone());
        let (monitor, stages) = (starter.monitor(0), stages.as_deref());
        let steps = if sizes.is_some() {
            let at = (starter.job.span.t0, start.clone(), starter.params(0));
            let (directions, [y, z]) = no_directions(problem.n, sensitivity.width());
            let rows = (y, z, Vec::new());
            let of = SparkTangents::new(stepper.clone(), derivatives, directions, at, rows)?;
            let led = TangentLed::new(of);
            starter.recorded_steps((led, stepper, stages), sizes, monitor, &start)
        } else {
            let part = stepper.clone();
            starter.recorded_steps((stepper, part, stages), sizes, monitor, &start)
        };
        let (point, reset, sizes) = starter.mechanical_adjoints(sensitivity);
        let method = Recording {
            point,
            reset,
            sizes,
            adjoint,
            steps,
            member: starter.member(0),
            start,
            is_given: false,
        };
        Ok(Self::of(&starter, sensitivity.width(), method)?)
    }
}
