//! The one integration loop: steps of equal size, some of them recorded.

use crate::method::{Stats, Stepper};
use crate::problem::Observe;
use crate::trouble::Trouble;
use std::time::{Duration, Instant};

/// Where a run stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Status {
    /// There are steps left.
    Paused,
    /// All steps are made.
    Done,
    /// Step `n` could not be made or recorded; the state and the records are those before it.
    Failed {
        /// Number of the step, from 0.
        n: usize,
        /// Time at its start.
        t: f64,
        /// Why.
        trouble: Trouble,
    },
}

/// What a run covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where it starts.
    pub t0: f64,
    /// Step size.
    pub h: f64,
    /// Number of steps.
    pub steps: usize,
    /// One state in this many is recorded, at least 1, and the last.
    pub every: usize,
}

/// A run of any stepper, independent of its type.
pub trait Advance: Send {
    /// Makes steps for about this long, or until the end.
    fn advance(&mut self, budget: Duration) -> Status;
    /// Number of steps made.
    fn done(&self) -> usize;
    /// What the stepper has done.
    fn stats(&self) -> Stats;
    /// Times of the records, and their rows one after another, the present state last. The run is
    /// over and keeps none.
    fn take(&mut self) -> (Vec<f64>, Vec<f64>);
}

/// A stepper, its state, and the recorder.
pub struct Run<S: Stepper, O> {
    stepper: S,
    observer: O,
    state: S::State,
    span: Span,
    n: usize,
    is_recordable: bool,
    times: Vec<f64>,
    rows: Vec<f64>,
}

impl<S: Stepper, O: Observe<State = S::State>> Run<S, O> {
    /// A run about to start; the start is recorded at once.
    ///
    /// # Errors
    /// The start cannot be recorded.
    pub fn new(stepper: S, mut observer: O, state: S::State, span: Span) -> Result<Self, Trouble> {
        let kept = span.steps / span.every + 2;
        let mut times = Vec::with_capacity(kept.min(1 << 20));
        let mut rows = Vec::with_capacity((kept * observer.width()).min(1 << 24));
        observer.observe(span.t0, &state, &mut rows)?;
        times.push(span.t0);
        Ok(Self {
            stepper,
            observer,
            state,
            span,
            n: 0,
            is_recordable: true,
            times,
            rows,
        })
    }

    fn time(&self) -> f64 {
        self.span.t0 + self.n as f64 * self.span.h
    }

    fn step(&mut self) -> Result<(), Trouble> {
        self.stepper
            .step(self.time(), self.span.h, &mut self.state)?;
        self.n += 1;
        if self.n.is_multiple_of(self.span.every) || self.n == self.span.steps {
            self.record().inspect_err(|_| {
                self.n -= 1;
                self.is_recordable = false;
            })?;
        }
        Ok(())
    }

    fn record(&mut self) -> Result<(), Trouble> {
        let t = self.time();
        self.observer.observe(t, &self.state, &mut self.rows)?;
        self.times.push(t);
        Ok(())
    }
}

impl<S: Stepper, O: Observe<State = S::State>> Advance for Run<S, O>
where
    S::State: Send,
{
    fn advance(&mut self, budget: Duration) -> Status {
        let start = Instant::now();
        let mut batch = 1;
        while self.n < self.span.steps {
            for _ in 0..batch.min(self.span.steps - self.n) {
                let (n, t) = (self.n, self.time());
                if let Err(trouble) = self.step() {
                    return Status::Failed { n, t, trouble };
                }
            }
            let spent = start.elapsed();
            if spent >= budget {
                return Status::Paused;
            }
            // looking at the clock must cost little, and not looking must not cost the budget
            if spent * 8 < budget {
                batch *= 2;
            } else {
                batch = batch.div_ceil(2);
            }
        }
        Status::Done
    }

    fn done(&self) -> usize {
        self.n
    }

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let is_recorded = self.n.is_multiple_of(self.span.every) || self.n == self.span.steps;
        if self.is_recordable && !is_recorded {
            // where it cannot be recorded, the records end before it
            let _ = self.record();
        }
        (
            std::mem::take(&mut self.times),
            std::mem::take(&mut self.rows),
        )
    }
}
