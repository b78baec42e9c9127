//! Pullbacks: a run made again from checkpoints, one piece after another from the last, each followed back.

use super::{Job, Method, Problem, Starter, System};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::run::{Advance, StartError, Status};
use liouville_problem::{Cotangents, PointAdjoint, Sensitivity, SensitivityModel, State};
use liouville_spark::{SharedRecords, SparkAdjoint, SparkRecorder};
use std::sync::Arc;
use std::time::Duration;

/// The pullback of a run of a SPARK method, its steps held.
pub struct Pullback {
    run: Box<dyn Advance>,
    records: SharedRecords,
    adjoint: SparkAdjoint,
    point: PointAdjoint,
    start: (f64, State),
    /// How many times the method is at work in a step.
    parts: usize,
    cotangents: Cotangents,
}

impl Pullback {
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
        let system = System::new(problem, method)?;
        job.check(&system)?;
        let starter = Starter { system, job };
        let System::Spark(problem, spark, stages) = &starter.system else {
            return Err(StartError::Invalid(
                "a pullback is that of a SPARK method".into(),
            ));
        };
        if !starter.has_pullback(sensitivity, spark) {
            let sentence = "a pullback is that of a single run without events, whose stages are solved to roundoff";
            return Err(StartError::Invalid(sentence.into()));
        }
        let (stepper, state, sizes) = starter.spark_at((problem, spark), 0)?;
        let (model, stages) = (starter.model(0), stages.as_deref());
        let derivatives = SensitivityModel::new(sensitivity.clone(), starter.params(0));
        let adjoint = SparkAdjoint::new(&stepper, derivatives.clone());
        let records = SharedRecords::default();
        let (of, start) = (starter.member(0), state.clone());
        let recorder = SparkRecorder::new(stepper, records.clone());
        let run = match sizes {
            None => starter.symmetric((recorder, stages), starter.monitor(0), of, start)?,
            Some(sizes) => starter.adaptive(recorder, sizes, of, start)?,
        };
        Ok(Self {
            cotangents: Cotangents::zeros(problem.n, sensitivity.width()),
            point: PointAdjoint::new(model, derivatives),
            parts: stages.map_or(1, <[f64]>::len),
            start: (starter.job.span.t0, state),
            run,
            records,
            adjoint,
        })
    }

    /// Goes to a checkpoint of the run.
    ///
    /// # Errors
    /// It is one of another run.
    pub fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.run.restore(saved)
    }

    /// Makes the steps up to the step `last` again, and follows them back. `rows` are cotangents of
    /// (y, z, λ) at the ends of the steps `kept`, both in their order.
    ///
    /// # Errors
    /// A step cannot be made again, or not followed back.
    pub fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError> {
        self.records.lock().clear();
        let first = self.run.done();
        if let Status::Failed { error, .. } = self.run.advance_to(last, Duration::MAX) {
            return Err(error);
        }
        let records = self.records.lock();
        for (k, record) in records.steps().iter().enumerate().rev() {
            let is_end = (k + 1) % self.parts == 0;
            let step = first + (k + 1) / self.parts;
            if is_end && let Ok(row) = kept.binary_search(&step) {
                let at = (record.time(), &record.end);
                self.point
                    .observe(at, rows.row(row), &mut self.cotangents)?;
            }
            self.adjoint.follow(record, &mut self.cotangents)?;
        }
        Ok(())
    }

    /// Ends at the start, whose cotangents are `row`.
    ///
    /// # Errors
    /// A derivative that is not finite.
    pub fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError> {
        let at = (self.start.0, &self.start.1);
        self.point.observe(at, row, &mut self.cotangents)?;
        self.point.leave(at, &mut self.cotangents)?;
        Ok(&self.cotangents)
    }
}
