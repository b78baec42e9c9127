//! Pullbacks: a run made again from checkpoints, one piece after another from the last, each followed back.

use super::{Job, Method, Recorded, Starter};
use crate::problem::Split;
use crate::volume::{LinearSteps, State, UserVariables, Volume};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::run::{Advance, StartError, Status};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A time that exceeds the end of a step by this part of it, from roundoff, is of that step.
const ROUNDOFF: f64 = 1e-9;

/// The steps made: time and size of each, and all their starts.
#[derive(Debug, Default)]
struct StepStarts {
    steps: Vec<(f64, f64)>,
    x: Vec<f64>,
}

/// A stepper that leaves the starts of its steps.
struct StartRecorder {
    stepper: Composed<Volume<f64>>,
    start: State<f64>,
    x: Vec<f64>,
    starts: Arc<Mutex<StepStarts>>,
}

impl Stepper for StartRecorder {
    type State = State<f64>;

    fn step(&mut self, t: f64, h: f64, state: &mut State<f64>) -> Result<(), StepError> {
        self.stepper.peek(state, &mut self.start)?;
        self.stepper.parts().values(&self.start, &mut self.x);
        self.stepper.step(t, h, state)?;
        let mut starts = self.starts.lock().unwrap_or_else(PoisonError::into_inner);
        starts.steps.push((t, h));
        starts.x.extend_from_slice(&self.x);
        Ok(())
    }

    fn synchronize(&mut self, state: &mut State<f64>) -> Result<(), StepError> {
        self.stepper.synchronize(state)
    }

    fn forget(&mut self) {
        self.stepper.forget();
    }

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }
}

/// The checkpoint of a run without a recorder.
impl Checkpoint for StartRecorder {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.stepper.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.stepper.restore(member, saved)
    }
}

/// The pullback of a run of one trajectory.
pub struct Pullback {
    run: Box<dyn Advance>,
    starts: Arc<Mutex<StepStarts>>,
    steps: LinearSteps,
    variables: UserVariables,
    n: usize,
    /// Cotangents of the variables that are stepped, of all coefficients and of the step size, then intermediate results;
    /// then the same cotangents of a part of a step, and the cotangent of the time of the start.
    y: Vec<f64>,
    part: Vec<f64>,
    start: f64,
    /// Where the run begins, and its step size.
    origin: (f64, f64),
}

/// Cotangents of the user's variables, rows in the order of the run.
#[derive(Clone, Copy, Debug)]
pub struct Cotangents<'a> {
    /// At the ends of these steps.
    pub kept: &'a [usize],
    /// Their rows.
    pub rows: &'a [f64],
    /// At these times, which are held; those of the steps that are followed come last.
    pub times: &'a [f64],
    /// Their rows.
    pub held: &'a [f64],
}

impl Pullback {
    /// The pullback of a job's run.
    ///
    /// # Errors
    /// The job is no such run, or its start failed.
    pub fn new(split: Arc<Split>, method: Method, job: Job) -> Result<Self, StartError> {
        job.check(&split)?;
        let is_single = job.members.is_none() && job.directions.is_empty();
        if !is_single || !matches!(job.recorded, Recorded::Observables { .. }) {
            let sentence = "a pullback is that of a single run without tangents";
            return Err(StartError::Invalid(sentence.into()));
        }
        let starter = Starter {
            clock: job.clock(&split),
            split,
            method,
            job,
        };
        let starts = Arc::<Mutex<StepStarts>>::default();
        let stepper = starter.stepper::<f64>(starter.job.threads);
        let observer = starter.observer(stepper.parts(), &[0]);
        let x = starter.in_lanes::<f64>(&[0]);
        let state = stepper.parts().state(&x);
        let has_parts = !(starter.job.times.is_empty() && starter.job.events.is_empty());
        let detector = has_parts.then(|| starter.detector(&stepper, &observer, &state, &[0]));
        let recorder = Box::new(StartRecorder {
            start: state.clone(),
            stepper,
            x,
            starts: Arc::clone(&starts),
        });
        let observer = Box::new(observer);
        let run = match detector {
            Some(detector) => starter.launch_watched(recorder, observer, state, detector),
            None => starter.launch(recorder, observer, state, 1),
        };
        let steps = LinearSteps::new(&starter.split, method.scheme, true);
        Ok(Self {
            run: run?,
            starts,
            y: vec![0.0; steps.width()],
            part: vec![0.0; steps.width()],
            start: 0.0,
            origin: (starter.job.span.t0, starter.job.span.h()),
            n: starter.split.n(),
            steps,
            variables: starter.job.variables,
        })
    }

    /// The number of the user's variables.
    pub fn variables(&self) -> usize {
        self.variables.n
    }

    /// Goes to a checkpoint of the run.
    ///
    /// # Errors
    /// It is one of another run.
    pub fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.run.restore(saved)
    }

    /// Makes the steps up to the step `last` again, and follows them back.
    ///
    /// # Errors
    /// A step cannot be made again, or not followed back.
    pub fn follow(&mut self, last: usize, given: Cotangents<'_>) -> Result<(), StepError> {
        let lock = || self.starts.lock().unwrap_or_else(PoisonError::into_inner);
        *lock() = StepStarts::default();
        let first = self.run.done();
        if let Status::Failed { error, .. } = self.run.advance_to(last, Duration::MAX) {
            return Err(error);
        }
        let (starts, width) = (lock(), self.variables.n);
        let mut next = given.times.len();
        for (k, &(t, h)) in starts.steps.iter().enumerate().rev() {
            if let Ok(row) = given.kept.binary_search(&(first + k + 1)) {
                let row = &given.rows[row * width..][..width];
                self.variables.pull(row, &mut self.y[..self.n]);
            }
            let x = &starts.x[k * self.n..][..self.n];
            self.steps.pull((t, h), x, &mut self.y)?;
            // a time is of the step that a run looks at it in, and the first takes what is left
            while next > 0 && (k == 0 || (given.times[next - 1] - t) / h > ROUNDOFF) {
                next -= 1;
                let row = &given.held[next * width..][..width];
                let length = given.times[next] - t;
                if length == 0.0 {
                    self.variables.pull(row, &mut self.y[..self.n]);
                    continue;
                }
                self.part.fill(0.0);
                self.variables.pull(row, &mut self.part[..self.n]);
                self.steps.pull((t, length), x, &mut self.part)?;
                let end = self.steps.constants().end - 1;
                (self.y[..end].iter_mut())
                    .zip(&self.part)
                    .for_each(|(y, own)| *y += own);
                // the part is shorter by what its start moves: with that of the run, and the steps before it
                let (t0, step) = self.origin;
                self.start -= self.part[end];
                self.y[end] -= self.part[end] * (t - t0) / step;
            }
        }
        Ok(())
    }

    /// Ends at the start, whose cotangents are `row`: those of the variables that are stepped, of all coefficients, of the
    /// step size, and of the time of the start.
    pub fn end(&mut self, row: &[f64]) -> Vec<f64> {
        self.variables.pull(row, &mut self.y[..self.n]);
        let own = self.y[..self.steps.constants().end].iter().copied();
        own.chain([self.start]).collect()
    }
}
