//! Pullbacks of the α family: a run made again from checkpoints, each piece followed back.

use super::pullback::Follow;
use super::{Job, Method, Problem, Starter, System};
use liouville_alpha::{
    AlphaAdjoint, AlphaCotangents, AlphaRecorder, AlphaRecords, AlphaSlopes, AlphaState,
    AlphaTransposed, Reactions,
};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::run::{Advance, StartError, Status};
use liouville_problem::{Cotangents, Model, PointAdjoint, Sensitivity, SensitivityModel};
use std::sync::Arc;
use std::time::Duration;

/// The pullback of a run of a method of the α family, its steps held.
pub struct AlphaPullback {
    run: Box<dyn Advance>,
    records: AlphaRecords,
    adjoint: AlphaAdjoint,
    point: PointAdjoint,
    model: Model,
    reactions: Reactions,
    /// The start, and whether its accelerations were given.
    start: (f64, AlphaState, bool),
    cotangents: AlphaCotangents,
}

impl AlphaPullback {
    /// The pullback of a job's run, whose derivatives by τ are `sensitivity`, and those of a step with their transposes.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn new(
        problem: Problem,
        method: Method,
        job: Job,
        sensitivity: &Arc<Sensitivity>,
        (slopes, transposed): (AlphaSlopes, AlphaTransposed),
    ) -> Result<Self, StartError> {
        let system = System::new(problem, method)?;
        job.check(&system)?;
        let starter = Starter { system, job };
        let System::Alpha(problem, weights, reactions) = &starter.system else {
            let sentence = "these are derivatives of a step of the α family";
            return Err(StartError::Invalid(sentence.into()));
        };
        let (n, m) = (problem.mechanical.n, problem.mechanical.m);
        let params = sensitivity.width() - 1;
        let fits = starter.has_alpha_pullback(sensitivity)
            && slopes.fit((n, m, params), *reactions)
            && transposed.fit(&slopes, n, params);
        if !fits {
            let sentence =
                "a pullback of the α family is that of a single run without events and given times";
            return Err(StartError::Invalid(sentence.into()));
        }
        let (stepper, state, sizes) = starter.alpha_at((problem, *weights, *reactions), 0)?;
        let (records, params) = (AlphaRecords::default(), starter.params(0));
        let of = starter.alpha_member(0, &stepper);
        let trial = Box::new(stepper.clone());
        let recorder = AlphaRecorder::new(stepper, records.clone());
        let control = starter.alpha_control((recorder, trial), sizes, 0, &state);
        let run = starter.launch(control, None, of, state.clone())?;
        let derivatives = SensitivityModel::new(sensitivity.clone(), params);
        Ok(Self {
            adjoint: AlphaAdjoint::new(slopes, transposed, params, n),
            point: PointAdjoint::new(starter.model(0), derivatives),
            model: starter.model(0),
            reactions: *reactions,
            start: (starter.job.span.t0, state, starter.has_accelerations()),
            cotangents: AlphaCotangents::zeros(n, sensitivity.width()),
            run,
            records,
        })
    }
}

impl Follow for AlphaPullback {
    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.run.restore(saved)
    }

    fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError> {
        self.records.lock().clear();
        let first = self.run.done();
        if let Status::Failed { error, .. } = self.run.advance_to(last, Duration::MAX) {
            return Err(error);
        }
        let of = &mut self.cotangents;
        for (k, record) in self.records.lock().iter().enumerate().rev() {
            if let Ok(row) = kept.binary_search(&(first + k + 1)) {
                let at = (record.time(), &record.end);
                self.point.observe(at, rows.row(row), &mut of.point)?;
            }
            self.adjoint.follow(record, of)?;
        }
        Ok(())
    }

    fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError> {
        let (t, state, is_given) = &self.start;
        let of = &mut self.cotangents;
        self.point.observe((*t, state), row, &mut of.point)?;
        let start = (*t, state, *is_given);
        let with = (&mut self.model, &mut self.point);
        self.adjoint.leave(start, self.reactions, with, of)?;
        Ok(&of.point)
    }
}
