//! Pullbacks of the index-2 methods: a run made again from checkpoints, each piece followed back.

use super::pullback::Follow;
use super::{Job, Method, Problem, Starter, System};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::recorder::{Recorder, SharedRecords};
use liouville_base::run::{Advance, StartError, Status};
use liouville_index2::Index2Adjoint;
use liouville_index2::semi_explicit::{
    SemiExplicitSensitivity, SemiExplicitSensitivityModel, SemiExplicitState,
};
use liouville_problem::Cotangents;
use std::sync::Arc;
use std::time::Duration;

/// The pullback of a run of an index-2 method, its steps held.
pub struct Index2Pullback {
    run: Box<dyn Advance>,
    records: SharedRecords<SemiExplicitState>,
    adjoint: Index2Adjoint,
    start: (f64, SemiExplicitState),
    /// How many times the method is at work in a step.
    parts: usize,
    cotangents: Cotangents,
}

impl Index2Pullback {
    /// The pullback of a job's run, whose derivatives by τ are `sensitivity`.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn new(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<SemiExplicitSensitivity>,
    ) -> Result<Self, StartError> {
        let system = System::new(problem, method)?;
        job.check(&system)?;
        let starter = Starter { system, job };
        let invalid = || {
            let sentence = "a pullback of an index-2 method is that of a single run of its system without events, \
                            given times and newton_tol";
            StartError::Invalid(sentence.into())
        };
        let System::Index2(problem, spark, stages) = &starter.system else {
            return Err(invalid());
        };
        let job = &starter.job;
        let is_plain = job.detection.is_none() && job.tangents.is_none() && job.members.is_none();
        let fits = Arc::ptr_eq(&sensitivity.system, problem) && spark.newton_tol.is_none();
        if !(is_plain && fits) {
            return Err(invalid());
        }
        let (stepper, state, sizes) = starter.index2_at((problem, &spark.tableau), 0)?;
        let stages = stages.as_deref();
        let derivatives = SemiExplicitSensitivityModel::new(sensitivity.clone(), starter.params(0));
        let (adjoint, records) = (
            Index2Adjoint::new(&stepper, derivatives),
            SharedRecords::default(),
        );
        let recorder = Recorder::new(stepper, records.clone());
        let of = starter.semi_explicit_member(problem, 0);
        let monitor = starter.traced(0, || of.model.clone());
        let control = match sizes {
            None => starter.symmetric_control((recorder, stages), monitor, &state),
            Some(sizes) => starter.adaptive_control(recorder, sizes),
        };
        let run = starter.launch(control, None, of, state.clone())?;
        Ok(Self {
            run,
            records,
            adjoint,
            parts: stages.map_or(1, <[f64]>::len),
            cotangents: Cotangents::zeros([problem.n, 0, 0], sensitivity.width()),
            start: (starter.job.span.t0, state),
        })
    }
}

impl Follow for Index2Pullback {
    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.run.restore(saved)
    }

    fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError> {
        self.records.lock().clear();
        let first = self.run.done();
        if let Status::Failed { error, .. } = self.run.advance_to(last, Duration::MAX) {
            return Err(error);
        }
        let (of, parts) = (&mut self.cotangents, self.parts);
        for (k, record) in self.records.lock().steps().iter().enumerate().rev() {
            let number = first + (k + 1) / parts;
            if (k + 1) % parts == 0
                && let Ok(row) = kept.binary_search(&number)
            {
                let at = (record.time(), &record.end);
                self.adjoint.observe(at, rows.row(row), of)?;
            }
            self.adjoint.follow(record, of)?;
        }
        Ok(())
    }

    fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError> {
        let (t, state) = &self.start;
        self.adjoint
            .observe((*t, state), row, &mut self.cotangents)?;
        Ok(&self.cotangents)
    }
}
