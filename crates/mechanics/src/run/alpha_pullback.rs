//! Pullbacks of the α family: a run made again from checkpoints, each piece followed back.

use super::at_times::{AtTimes, observing};
use super::pullback::Follow;
use super::{Job, Method, Problem, Starter, System};
use liouville_alpha::{
    AlphaAdjoint, AlphaCotangents, AlphaRecorder, AlphaRecords, AlphaSlopes, AlphaState,
    AlphaTransposed, Reactions,
};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled};
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
    /// Where states are given at times that are not those of the steps.
    times: Option<AtTimes>,
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
            let sentence = "a pullback of the α family is that of a single run without events";
            return Err(StartError::Invalid(sentence.into()));
        }
        let (stepper, state, sizes) = starter.alpha_at((problem, *weights, *reactions), 0)?;
        let (records, params) = (AlphaRecords::default(), starter.params(0));
        let of = starter.alpha_member(0, &stepper);
        let (copy, trial) = (starter.copy(&stepper), Box::new(stepper.clone()));
        let recorder = AlphaRecorder::new(stepper, records.clone());
        let control = starter.alpha_control((recorder, trial), sizes, 0, &state);
        let derivatives = SensitivityModel::new(sensitivity.clone(), params);
        let point = PointAdjoint::new(starter.model(0), derivatives);
        let detection = starter.job.detection.as_ref();
        let times = detection.and_then(|detection| detection.times.clone());
        let times = times.map(|times| {
            let records = records.clone();
            let made = Box::new(move || records.lock().len());
            let sizes = ([n, m], sensitivity.width());
            AtTimes::new(times, sizes, point.clone(), (made, 1))
        });
        let inner = starter.observer(starter.model(0), 0);
        let observed = (
            Box::new(inner.clone()) as _,
            observing(inner, times.clone()),
        );
        let stepping = (control, copy);
        let run = starter.launch_observed(stepping, of, state.clone(), observed, |of| of)?;
        Ok(Self {
            adjoint: AlphaAdjoint::new(slopes, transposed, params, n),
            point,
            times,
            model: starter.model(0),
            reactions: *reactions,
            start: (starter.job.span.t0, state, starter.has_accelerations()),
            cotangents: AlphaCotangents::zeros(n, sensitivity.width()),
            run,
            records,
        })
    }
}

impl AlphaPullback {
    /// Takes the cotangents of a knot to the state there.
    fn leave_knot(
        &mut self,
        (place, starts): (usize, bool),
        at: (f64, &AlphaState),
    ) -> Result<(), StepError> {
        let times = self.times.as_ref();
        match times.and_then(|times| times.lock().take(place, starts)) {
            Some(knot) => (self.point).observe_knot(at, &knot, &mut self.cotangents.point),
            None => Ok(()),
        }
    }
}

impl Follow for AlphaPullback {
    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.run.restore(saved)
    }

    fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError> {
        self.records.lock().clear();
        let first = self.run.done();
        let pending = self.times.as_ref().map(|times| times.lock().pending());
        let status = self.run.advance_to(last, Duration::MAX);
        if let Status::Failed { error, .. } = status {
            return Err(error);
        }
        if status == Status::Done && self.times.is_some() {
            // what is due at the end only
            drop(self.run.take());
        }
        let shared = self.records.clone();
        let records = shared.lock();
        if let Some((times, pending)) = self.times.as_ref().zip(pending) {
            times.lock().shift(pending, records.len());
        }
        for (k, record) in records.iter().enumerate().rev() {
            let at = (record.time(), &record.end);
            for starts in [false, true] {
                self.leave_knot((k + 1, starts), at)?;
            }
            let of = &mut self.cotangents;
            if let Ok(row) = kept.binary_search(&(first + k + 1)) {
                self.point.observe(at, rows.row(row), &mut of.point)?;
            }
            self.adjoint.follow(record, of)?;
        }
        Ok(())
    }

    fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError> {
        let (t, state, is_given) = &self.start.clone();
        for starts in [false, true] {
            self.leave_knot((0, starts), (*t, state))?;
        }
        let of = &mut self.cotangents;
        if let Some(times) = &self.times {
            add_scaled(&mut of.point.tau, 1.0, &times.lock().tau);
        }
        self.point.observe((*t, state), row, &mut of.point)?;
        let start = (*t, state, *is_given);
        let with = (&mut self.model, &mut self.point);
        self.adjoint.leave(start, self.reactions, with, of)?;
        Ok(&of.point)
    }

    fn give(&mut self, rows: Matrix) -> bool {
        (self.times.as_ref()).is_some_and(|times| times.lock().give(rows))
    }
}
