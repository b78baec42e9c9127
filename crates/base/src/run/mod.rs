//! The one integration loop: steps, some of them recorded.

mod control;
mod detector;
mod record;

pub use control::{Adaptive, Fixed, Listed, Reversible, StepControl, StepSizes};
pub use detector::{EventDetector, NoEvents, Seen};
pub use record::Recorder;

use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::method::{Stats, Stepper};
use crate::observe::Observe;
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
        error: StepError,
    },
}

/// Times of the records of equal steps by (t0, t1, steps, every), as a run tells them.
pub fn times((t0, t1, steps, every): (f64, f64, usize, usize)) -> Vec<f64> {
    let h = (t1 - t0) / steps as f64;
    let kept = (0..steps).step_by(every).chain([steps]);
    kept.map(|n| t0 + n as f64 * h).collect()
}

/// A member of several that cannot go on.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Which one.
    pub member: usize,
    /// The step that could not be made or recorded, and the time at its start; the start itself could not be
    /// split_front where there is none.
    pub step: Option<(usize, f64)>,
    /// Why.
    pub error: StepError,
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
    fn sizes(&self) -> Option<StepSizes> {
        None
    }
    /// Times of the records, one a row, and the rows one after another, the present state last. The
    /// run is over and keeps none.
    fn take(&mut self) -> (Vec<f64>, Vec<f64>);
    /// The records so far, which the run keeps no longer; it goes on.
    fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        (Vec::new(), Vec::new())
    }
    /// Appends all that the rest of the run depends on, but for what was collected; says whether that can be
    /// told.
    fn save(&self, _out: &mut Vec<f64>) -> bool {
        false
    }
    /// Makes a run that was begun in the same way the one that was saved, with the same bits from here on.
    ///
    /// # Errors
    /// It was another run; this one is not to be used then.
    fn restore(&mut self, _saved: &[f64]) -> Result<(), CheckpointMismatch> {
        Err(CheckpointMismatch)
    }
    /// Members that could not go on, in their order, while the others did.
    fn failures(&self) -> Vec<Failure> {
        Vec::new()
    }
    /// How many members have come to their end, or failed.
    fn over(&self) -> usize {
        0
    }
    /// The events met since this was last asked for; after the records.
    fn seen(&mut self) -> Seen {
        Seen::default()
    }
}

/// A stepper, its state, the length of its steps, the recorder, and who else looks.
pub struct Run<S: Stepper, O, P, W = NoEvents> {
    stepper: S,
    state: S::State,
    control: P,
    every: usize,
    n: usize,
    is_recordable: bool,
    records: Recorder<O>,
    watch: W,
    /// Where the watch has ended the run.
    end: Option<f64>,
    /// What was done before the run was restored, without what this stepper had done then.
    before: Stats,
    apart: Stats,
}

impl<S: Stepper, O: Observe<S::State>, P: StepControl<S>> Run<S, O, P> {
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
        control: P,
        every: usize,
        expected: usize,
    ) -> Result<Self, StepError> {
        Self::watched(
            stepper,
            observer,
            state,
            control,
            (every, expected),
            NoEvents,
        )
    }
}

impl<S: Stepper, O: Observe<S::State>, P: StepControl<S>, W: EventDetector<S, O>> Run<S, O, P, W> {
    /// The same with someone who looks at each step.
    ///
    /// # Errors
    /// The start cannot be recorded, or cannot be looked at.
    pub fn watched(
        stepper: S,
        observer: O,
        state: S::State,
        control: P,
        (every, expected): (usize, usize),
        watch: W,
    ) -> Result<Self, StepError> {
        let width = observer.width(&state);
        let mut run = Self {
            stepper,
            state,
            control,
            every,
            n: 0,
            is_recordable: true,
            records: Recorder::new(observer, expected, width),
            watch,
            end: None,
            before: Stats::default(),
            apart: Stats::default(),
        };
        if W::IS_ACTIVE {
            run.stepper.synchronize(&mut run.state)?;
            (run.watch).start(run.control.time(), &run.state, &mut run.records)?;
        }
        if !run.watch.is_recording() {
            run.record()?;
        }
        Ok(run)
    }

    fn step(&mut self) -> Result<(), StepError> {
        if W::IS_ACTIVE {
            self.watch.before(self.control.time(), &self.state);
        }
        self.control.step(&mut self.stepper, &mut self.state)?;
        self.n += 1;
        self.look().inspect_err(|_| {
            self.n -= 1;
            self.is_recordable = false;
        })
    }

    fn look(&mut self) -> Result<(), StepError> {
        if W::IS_ACTIVE {
            self.stepper.synchronize(&mut self.state)?;
            let t = self.control.time();
            self.end = (self.watch).after(t, &mut self.state, &mut self.records)?;
        }
        // a run that ends where a step began has its last record
        let is_there = self.end.is_some() && self.end == self.records.last();
        if self.is_due() && !is_there {
            self.record()?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.end.is_some() || self.control.is_over()
    }

    fn is_due(&self) -> bool {
        !self.watch.is_recording() && (self.control.is_due(self.n, self.every) || self.is_over())
    }

    fn present(&self) -> f64 {
        self.end.unwrap_or_else(|| self.control.time())
    }

    fn record(&mut self) -> Result<(), StepError> {
        self.stepper.synchronize(&mut self.state)?;
        self.records.record(self.present(), &self.state)
    }
}

impl<S, O, P, W> Advance for Run<S, O, P, W>
where
    S: Stepper,
    S::State: Send,
    O: Observe<S::State>,
    P: StepControl<S>,
    W: EventDetector<S, O>,
{
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let start = Instant::now();
        let mut batch = 1_usize;
        while !self.is_over() {
            for _ in 0..batch {
                if self.n >= steps {
                    return Status::Paused;
                }
                let (n, t) = (self.n, self.control.time());
                if let Err(error) = self.step() {
                    return Status::Failed { n, t, error };
                }
                if self.is_over() {
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
        self.present()
    }

    fn stats(&self) -> (Stats, usize) {
        let stats = self.before + (self.stepper.stats() - self.apart);
        (stats, self.control.rejected())
    }

    fn sizes(&self) -> Option<StepSizes> {
        self.control.sizes()
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        if self.watch.is_recording() {
            self.watch.finish(&mut self.records);
        } else if self.is_recordable && !self.is_due() {
            // where it cannot be recorded, the records end before it
            let _ = self.record();
        }
        self.records.take()
    }

    fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.records.collect()
    }

    fn save(&self, out: &mut Vec<f64>) -> bool {
        let whole = 0;
        (self.n, self.end).save(whole, out);
        self.stats().0.save(whole, out);
        self.state.save(whole, out);
        self.stepper.save(whole, out);
        self.control.save(whole, out);
        self.records.save(whole, out);
        self.watch.save(whole, out);
        true
    }

    fn restore(&mut self, mut saved: &[f64]) -> Result<(), CheckpointMismatch> {
        let (whole, saved) = (0, &mut saved);
        let mut place = (self.n, self.end);
        place.restore(whole, saved)?;
        (self.n, self.end) = place;
        self.before.restore(whole, saved)?;
        self.state.restore(whole, saved)?;
        self.stepper.restore(whole, saved)?;
        self.apart = self.stepper.stats();
        self.control.restore(whole, saved)?;
        self.records.restore(whole, saved)?;
        self.watch.restore(whole, saved)?;
        if saved.is_empty() {
            Ok(())
        } else {
            Err(CheckpointMismatch)
        }
    }

    fn seen(&mut self) -> Seen {
        self.watch.take()
    }
}
