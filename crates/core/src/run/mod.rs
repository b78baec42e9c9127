//! The one integration loop: steps, some of them recorded.

mod pace;

pub use pace::{Controlled, Equal, Listed, Pace, Reversible, Sizes};

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

/// A run of any stepper, independent of its type.
pub trait Advance: Send {
    /// Makes steps for about this long, or until the end.
    fn advance(&mut self, budget: Duration) -> Status {
        self.advance_to(usize::MAX, budget)
    }
    /// Makes steps for about this long, or until so many are made in all, or until the end.
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status;
    /// Number of steps made.
    fn done(&self) -> usize;
    /// The time they lead to.
    fn time(&self) -> f64;
    /// What the stepper has done, and how many of its steps were thrown away.
    fn stats(&self) -> (Stats, usize);
    /// The sizes of its steps, where they are not equal.
    fn sizes(&self) -> Option<Sizes> {
        None
    }
    /// Times of the records, one a row, and the rows one after another, the present state last. The
    /// run is over and keeps none.
    fn take(&mut self) -> (Vec<f64>, Vec<f64>);
}

/// A stepper, its state, the length of its steps, and the recorder.
pub struct Run<S: Stepper, O, P> {
    stepper: S,
    observer: O,
    state: S::State,
    pace: P,
    every: usize,
    n: usize,
    is_recordable: bool,
    times: Vec<f64>,
    rows: Vec<f64>,
}

impl<S: Stepper, O: Observe<S::State>, P: Pace<S>> Run<S, O, P> {
    /// A run about to start; the start is recorded at once, and then one state in `every` and the last.
    ///
    /// `expected` is how many records will be made, if that is known.
    ///
    /// # Errors
    /// The start cannot be recorded.
    pub fn new(
        stepper: S,
        observer: O,
        state: S::State,
        pace: P,
        every: usize,
        expected: usize,
    ) -> Result<Self, Trouble> {
        let times = Vec::with_capacity(expected.min(1 << 20));
        let rows = Vec::with_capacity((expected * observer.width(&state)).min(1 << 24));
        let mut run = Self {
            stepper,
            observer,
            state,
            pace,
            every,
            n: 0,
            is_recordable: true,
            times,
            rows,
        };
        run.record()?;
        Ok(run)
    }

    fn step(&mut self) -> Result<(), Trouble> {
        self.pace.step(&mut self.stepper, &mut self.state)?;
        self.n += 1;
        if self.is_due() {
            self.record().inspect_err(|_| {
                self.n -= 1;
                self.is_recordable = false;
            })?;
        }
        Ok(())
    }

    fn is_due(&self) -> bool {
        self.pace.is_due(self.n, self.every) || self.pace.is_over()
    }

    fn record(&mut self) -> Result<(), Trouble> {
        self.stepper.settle(&mut self.state)?;
        let t = self.pace.time();
        let before = self.rows.len();
        self.observer.observe(t, &self.state, &mut self.rows)?;
        // some observers have several rows for a state, or none
        let rows = match self.observer.width(&self.state) {
            0 => 1,
            width => (self.rows.len() - before) / width,
        };
        self.times.extend(std::iter::repeat_n(t, rows));
        Ok(())
    }
}

impl<S: Stepper, O: Observe<S::State>, P: Pace<S>> Advance for Run<S, O, P>
where
    S::State: Send,
{
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let start = Instant::now();
        let mut batch = 1_usize;
        while !self.pace.is_over() {
            for _ in 0..batch {
                if self.n >= steps {
                    return Status::Paused;
                }
                let (n, t) = (self.n, self.pace.time());
                if let Err(trouble) = self.step() {
                    return Status::Failed { n, t, trouble };
                }
                if self.pace.is_over() {
                    return Status::Done;
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

    fn time(&self) -> f64 {
        self.pace.time()
    }

    fn stats(&self) -> (Stats, usize) {
        (self.stepper.stats(), self.pace.rejected())
    }

    fn sizes(&self) -> Option<Sizes> {
        self.pace.sizes()
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        if self.is_recordable && !self.is_due() {
            // where it cannot be recorded, the records end before it
            let _ = self.record();
        }
        (
            std::mem::take(&mut self.times),
            std::mem::take(&mut self.rows),
        )
    }
}
