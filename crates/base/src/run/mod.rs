//! The integration loop: one for each type of state.

mod advance;
mod control;
mod detector;
mod events;
mod parts;
mod record;
mod room;
mod start;

pub use advance::{Advance, Failure, Status};
pub use control::{Adaptive, BetweenTimes, Fixed, Reversible, StepControl, StepSizes};
pub use detector::{Ending, EventDetector, Events, Hits, Outcome};
pub use events::{
    Crossing, EventRule, FunctionInStep, InterpolationAccuracy, NOISE, SAMPLES, Search, Substep,
    SubstepDetector, WatchedFunction, is_met_at, met_at_end, same_time,
};
pub use record::Records;
pub use room::{check, check_spare, refill, reserve, resize};
pub use start::{Span, StartError};

use crate::checkpoint::{Checkpoint, CheckpointMismatch, Count, Numbers};
use crate::error::StepError;
use crate::method::Stats;
use crate::observe::{Finding, Observe, Watch};
use std::time::{Duration, Instant};

/// Appends a record, or replaces the last one.
type Put<State> = fn(&mut Records, &mut dyn Observe<State>, f64, &State) -> Result<(), StepError>;

/// A state, the control of its steps, and its records.
pub struct Run<State: Checkpoint> {
    control: Box<dyn StepControl<State>>,
    state: State,
    observer: Box<dyn Observe<State>>,
    events: Option<Box<dyn EventDetector<State>>>,
    watch: Option<Box<dyn Watch<State>>>,
    records: Records,
    width: usize,
    every: usize,
    n: usize,
    is_recordable: bool,
    /// How many members it has in lock-step.
    members: usize,
    /// Where an event has ended the run.
    end: Option<f64>,
    /// Counts of the run when it was saved, and of this stepper when it was restored.
    saved_stats: Stats,
    own_stats: Stats,
}

impl<State: Checkpoint> Run<State> {
    /// A run about to start; the start is recorded at once, and then one state in `every` and the last.
    ///
    /// `expected` is the number of records, 0 if it is not known.
    ///
    /// # Errors
    /// The start cannot be recorded.
    pub fn new(
        control: Box<dyn StepControl<State>>,
        observer: Box<dyn Observe<State>>,
        state: State,
        (every, expected): (usize, usize),
    ) -> Result<Self, StepError> {
        Self::with_events(control, observer, state, (every, expected), None)
    }

    /// The same with an event detector.
    ///
    /// # Errors
    /// The start cannot be recorded, or an event function cannot be evaluated there.
    pub fn with_events(
        control: Box<dyn StepControl<State>>,
        observer: Box<dyn Observe<State>>,
        state: State,
        (every, expected): (usize, usize),
        events: Option<Box<dyn EventDetector<State>>>,
    ) -> Result<Self, StepError> {
        let width = observer.width(&state);
        let mut run = Self {
            control,
            state,
            observer,
            events,
            watch: None,
            records: Records::with_capacity(expected, width),
            width,
            every,
            n: 0,
            is_recordable: true,
            members: 1,
            end: None,
            saved_stats: Stats::default(),
            own_stats: Stats::default(),
        };
        if let Some(events) = &mut run.events {
            run.control.stepper_mut().synchronize(&mut run.state)?;
            events.start(run.control.time(), &run.state)?;
        }
        if run.is_recorded_by_events() {
            run.follow()?;
        } else {
            run.record()?;
        }
        Ok(run)
    }

    /// The same with a watch over its steps.
    ///
    /// # Errors
    /// The start is no state of the system.
    pub fn watched(self, mut watch: Option<Box<dyn Watch<State>>>) -> Result<Self, StepError> {
        if let Some(watch) = &mut watch {
            watch.look((self.control.time(), 0.0, false), &self.state)?;
        }
        Ok(Self { watch, ..self })
    }

    /// The same as a run of so many members in lock-step, for its statistics.
    #[must_use]
    pub fn of_members(self, members: usize) -> Self {
        Self { members, ..self }
    }

    fn step(&mut self) -> Result<(), StepError> {
        let start = self.control.time();
        if let Some(events) = &mut self.events {
            events.before(start, &mut self.state);
        }
        if let Err(error) = self.control.step(&mut self.state) {
            return self.step_to_event(start, error);
        }
        self.n += 1;
        let records = self.records.len();
        self.finish_step(start).inspect_err(|_| {
            self.n -= 1;
            self.is_recordable = false;
            self.records.truncate(records);
        })
    }

    /// Looks for events in the step just made, and records the state that it led to.
    fn finish_step(&mut self, start: f64) -> Result<(), StepError> {
        let mut outcome = Outcome::Continue;
        if let Some(events) = &mut self.events {
            self.control.stepper_mut().synchronize(&mut self.state)?;
            let (t, is_last) = (self.control.time(), self.control.is_over());
            outcome = events.after((t, is_last), &mut self.state, &mut self.records)?;
            match outcome {
                Outcome::Continue => {}
                Outcome::End(end) => self.end = Some(end),
                Outcome::Shorten(end) => {
                    self.control.stepper_mut().forget();
                    self.control.shorten(end);
                }
                Outcome::Restart(start) => {
                    self.restart(start);
                    self.follow()?;
                    if start.to_bits() != t.to_bits() {
                        self.replace_record(start, outcome)?;
                        // the rest of the step is still to be made
                        self.n -= 1;
                        return Ok(());
                    }
                }
            }
        }
        self.look_and_record(start, outcome)
    }

    /// Goes on from a state that an event has led to.
    fn restart(&mut self, t: f64) {
        self.control.stepper_mut().forget();
        self.control.restart(t, &self.state);
        if let Some(watch) = &mut self.watch {
            watch.restart(t, &self.state);
        }
    }

    /// Looks at the state that a step from `start` has led to, and records it if it is due.
    fn look_and_record(&mut self, start: f64, outcome: Outcome) -> Result<(), StepError> {
        self.look(start)?;
        match self.end {
            Some(end) if self.records.last() == Some(end) => self.replace_record(end, outcome),
            _ if self.is_due() => self.record_after(outcome),
            _ => self.follow(),
        }
    }

    /// Lets an observer that follows all steps see the present state.
    fn follow(&mut self) -> Result<(), StepError> {
        if !self.observer.is_following() {
            return Ok(());
        }
        self.control.stepper_mut().synchronize(&mut self.state)?;
        let t = self.present();
        match &mut self.events {
            Some(events) if events.is_recording() => events.follow(t, &self.state),
            _ => self.observer.follow(t, &self.state),
        }
        Ok(())
    }

    /// Looks at the state that a step from `start` has led to.
    fn look(&mut self, start: f64) -> Result<(), StepError> {
        let (t, is_last) = (self.present(), self.is_over());
        let Some(watch) = &mut self.watch else {
            return Ok(());
        };
        if !watch.is_due(is_last) {
            return Ok(());
        }
        self.control.stepper_mut().synchronize(&mut self.state)?;
        if self.end.is_some() {
            // a reset may have led to it
            watch.restart(t, &self.state);
        }
        watch.look((t, t - start, is_last), &self.state)
    }

    /// Records a state that a reset has led to at the time of the last record, which is of the state before.
    fn replace_record(&mut self, t: f64, outcome: Outcome) -> Result<(), StepError> {
        if self.is_recorded_by_events() || self.records.last() != Some(t) {
            return Ok(());
        }
        self.record_at(t, outcome, Records::replace)
    }

    /// Whether the records are those of the event detector.
    fn is_recorded_by_events(&self) -> bool {
        self.events
            .as_ref()
            .is_some_and(|events| events.is_recording())
    }

    fn is_over(&self) -> bool {
        self.end.is_some() || self.control.is_over()
    }

    fn is_due(&self) -> bool {
        !self.is_recorded_by_events() && (self.control.is_due(self.n, self.every) || self.is_over())
    }

    fn present(&self) -> f64 {
        self.end.unwrap_or_else(|| self.control.time())
    }

    fn record(&mut self) -> Result<(), StepError> {
        self.record_after(Outcome::Continue)
    }

    fn record_after(&mut self, outcome: Outcome) -> Result<(), StepError> {
        self.record_at(self.present(), outcome, Records::push)
    }

    /// Records the state that the events of a step have led to, if there were any.
    fn record_at(&mut self, t: f64, outcome: Outcome, put: Put<State>) -> Result<(), StepError> {
        self.control.stepper_mut().synchronize(&mut self.state)?;
        let held = match (outcome, &mut self.events) {
            (Outcome::Restart(_) | Outcome::Shorten(_), Some(events)) => {
                events.hold((t, outcome), &self.state)?
            }
            _ => None,
        };
        let state = held.unwrap_or(&self.state);
        put(&mut self.records, &mut *self.observer, t, state)
    }

    fn save_all(&self, out: &mut dyn Numbers) {
        let all = 0;
        (self.n, self.end).save(all, out);
        self.stats().0.save(all, out);
        self.state.save(all, out);
        self.control.save(all, out);
        self.observer.save(all, out);
        self.records.save(all, out);
        if let Some(events) = &self.events {
            events.save(all, out);
        }
        if let Some(watch) = &self.watch {
            watch.save(all, out);
        }
    }
}

impl<State: Checkpoint> Advance for Run<State> {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let start = Instant::now();
        let mut batch = 1_usize;
        while !self.is_over() {
            if !self.control.prepare(&self.state) {
                if start.elapsed() >= budget {
                    return Status::Paused;
                }
                continue;
            }
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
            // reading the clock must cost little, and steps between readings must not exceed the budget
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
        let members = (0..self.members).map(|place| self.stats_of(place).0);
        let stats = members.fold(Stats::default(), |sum, stats| sum + stats);
        (stats, self.control.rejected())
    }

    fn stats_of(&self, place: usize) -> (Stats, usize) {
        let made = self.control.stepper().stats_of(place) - self.own_stats;
        (self.saved_stats + made, self.control.rejected())
    }

    fn sizes(&self) -> Option<StepSizes> {
        self.control.sizes()
    }

    fn shape(&self) -> Vec<usize> {
        vec![self.width]
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        if self.is_recorded_by_events() {
            if let Some(events) = &mut self.events {
                events.finish(&mut self.records);
            }
        } else if self.is_recordable && !self.is_due() {
            // on an error the records end before the present state
            let _ = self.record();
        }
        self.records.take()
    }

    fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.records.collect()
    }

    fn place(&mut self) -> Option<Vec<f64>> {
        let (t, mut place) = (self.present(), Vec::new());
        let stepper = self.control.stepper_mut();
        stepper.synchronize(&mut self.state).ok()?;
        let is_known = self.observer.locate(t, &self.state, &mut place).ok()?;
        is_known.then_some(place)
    }

    fn save(&self, out: &mut Vec<f64>) -> Result<bool, StepError> {
        let mut count = Count::default();
        self.save_all(&mut count);
        reserve(out, count.0)?;
        self.save_all(out);
        Ok(true)
    }

    fn restore(&mut self, mut saved: &[f64]) -> Result<(), CheckpointMismatch> {
        let (all, saved) = (0, &mut saved);
        let mut place = (self.n, self.end);
        place.restore(all, saved)?;
        (self.n, self.end) = place;
        self.saved_stats.restore(all, saved)?;
        self.state.restore(all, saved)?;
        self.control.restore(all, saved)?;
        self.own_stats = self.control.stepper().stats();
        self.observer.restore(all, saved)?;
        self.records.restore(all, saved)?;
        if let Some(events) = &mut self.events {
            events.restore(all, saved)?;
        }
        if let Some(watch) = &mut self.watch {
            watch.restore(all, saved)?;
        }
        if saved.is_empty() {
            Ok(())
        } else {
            Err(CheckpointMismatch)
        }
    }

    fn found(&self) -> Vec<(usize, Finding)> {
        self.watch
            .as_ref()
            .map_or_else(Vec::new, |watch| watch.found())
    }

    fn events(&mut self) -> Events {
        match &mut self.events {
            Some(events) => events.take(),
            None => Events::default(),
        }
    }
}
