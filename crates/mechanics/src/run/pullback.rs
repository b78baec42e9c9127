//! Pullbacks: a run made again from checkpoints, one piece after another from the last, each followed back.

use super::at_times::{AtTimes, TimesObserver};
use super::member::Member;
use super::{Job, Method, Problem, Starter, System};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled};
use liouville_base::observe::Observe;
use liouville_base::run::{Advance, StartError, Status};
use liouville_problem::{Cotangents, Path, PointAdjoint, Sensitivity, SensitivityModel, State};
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
    /// Where states are given at times that are not those of the steps.
    times: Option<AtTimes>,
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
        let start = state.clone();
        let parts = stages.map_or(1, <[f64]>::len);
        let copy = starter.composed_copy((&stepper, stages));
        let recorder = SparkRecorder::new(stepper, records.clone());
        let control = match sizes {
            None => starter.symmetric_control((recorder, stages), starter.monitor(0), &start),
            Some(sizes) => starter.adaptive_control(recorder, sizes),
        };
        let point = PointAdjoint::new(model.clone(), derivatives);
        let detection = starter.job.detection.as_ref();
        let times = detection.and_then(|detection| detection.times.clone());
        let times = times.map(|times| {
            let sizes = ([problem.n, problem.m], sensitivity.width());
            let recorded = (records.clone(), parts);
            AtTimes::new(times, sizes, point.clone(), recorded)
        });
        let inner = starter.observer(model.clone(), 0);
        let at_times: Box<dyn Observe<Path>> = match times.clone() {
            None => Box::new(inner.clone()),
            Some(at_times) => Box::new(TimesObserver {
                inner: inner.clone(),
                at_times,
            }),
        };
        let of = Member {
            number: 0,
            model,
            restart: None,
        };
        let observed = (Box::new(inner) as _, at_times);
        let run = starter.launch_observed((control, copy), of, start, observed, |path| path)?;
        Ok(Self {
            cotangents: Cotangents::zeros(problem.n, sensitivity.width()),
            point,
            parts,
            start: (starter.job.span.t0, state),
            run,
            records,
            adjoint,
            times,
        })
    }

    /// Takes cotangents of (y, z, λ) at the given times, a row for each; says whether the run has so many.
    pub fn give(&mut self, rows: Matrix) -> bool {
        (self.times.as_ref()).is_some_and(|times| times.lock().give(rows))
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
        let pending = self.times.as_ref().map(|times| times.lock().pending());
        match self.run.advance_to(last, Duration::MAX) {
            Status::Failed { error, .. } => return Err(error),
            // what is due at the end only
            Status::Done if self.times.is_some() => drop(self.run.take()),
            _ => {}
        }
        let records = self.records.lock();
        if let Some((times, pending)) = self.times.as_ref().zip(pending) {
            times.lock().shift(pending, records.steps().len());
        }
        for (k, record) in records.steps().iter().enumerate().rev() {
            let is_end = (k + 1) % self.parts == 0;
            let step = first + (k + 1) / self.parts;
            if is_end && let Ok(row) = kept.binary_search(&step) {
                let at = (record.time(), &record.end);
                self.point
                    .observe(at, rows.row(row), &mut self.cotangents)?;
            }
            let knot = (self.times.as_ref()).and_then(|times| times.lock().take(k + 1));
            if let Some(knot) = knot {
                let at = (record.time(), &record.end);
                self.point.observe_knot(at, &knot, &mut self.cotangents)?;
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
        if let Some(times) = &self.times {
            let mut held = times.lock();
            if let Some(knot) = held.take(0) {
                self.point.observe_knot(at, &knot, &mut self.cotangents)?;
            }
            add_scaled(&mut self.cotangents.tau, 1.0, &held.tau);
        }
        self.point.observe(at, row, &mut self.cotangents)?;
        self.point.leave(at, &mut self.cotangents)?;
        Ok(&self.cotangents)
    }
}
