//! Pullbacks: a run made again from checkpoints, one piece after another from the last, each followed back.

use super::Starter;
use super::event_adjoint::EventAdjoint;
use super::given_times::GivenTimes;
use super::journal::{Entry, EventRecorder, GivenEntry, Journal, replaces_record};
use super::recording::{RecordedSteps, Recording, StepAdjoint};
use super::shared::SharedRun;
use crate::events::DenseDetector;
use liouville_base::cancel;
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::recorder::{SharedRecords, StepRecord};
use liouville_base::run::{Advance, Status};
use liouville_problem::{Cotangents, ObservePoint};
use std::time::Duration;

/// How long steps are repeated without asking whether to stop.
const BETWEEN: Duration = Duration::from_millis(40);

/// The adjoint of a run, which takes cotangents back to its start, from checkpoint to checkpoint.
pub trait Follow: Send + Sync {
    /// The run, whose steps are recorded as they are made.
    fn run(&self) -> SharedRun;

    /// Forgets the steps recorded so far: a checkpoint was saved behind them.
    fn forget(&mut self);

    /// Restores a checkpoint of the run.
    ///
    /// # Errors
    /// It is one of another run.
    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch>;

    /// Makes the steps up to the step `last` that are not made, and takes cotangents back over those recorded. `rows`
    /// are cotangents of (y, z, λ) at the ends of the steps `kept`, both in their order.
    ///
    /// # Errors
    /// A step cannot be repeated, its adjoint fails, or the thread is cancelled.
    fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError>;

    /// Adds the cotangents `row` of the start, and returns all.
    ///
    /// # Errors
    /// A derivative that is not finite.
    fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError>;

    /// Sets cotangents of (y, z, λ) at the given times, a row for each; returns whether their number is that of the run.
    fn give(&mut self, _rows: Matrix) -> bool {
        false
    }

    /// Sets cotangents of the events of each kind, a row for each time it was met: of t, y, z and λ, and of y, z and λ
    /// after a reset.
    fn give_events(&mut self, _rows: Vec<Matrix>) {}
}

/// The pullback of a run at the steps that it has made.
pub struct Pullback<A: StepAdjoint> {
    run: SharedRun,
    records: SharedRecords<A::State>,
    /// The step that is followed back.
    step: Vec<StepRecord<A::State>>,
    adjoint: A,
    point: A::Point,
    /// The start, and whether the whole carried state was given there.
    start: (f64, A::State, bool),
    /// How many times the method is at work in a step.
    parts: usize,
    cotangents: Cotangents,
    /// Where states are recorded at times that are not those of the steps.
    times: Option<GivenTimes>,
    events: Option<EventAdjoint>,
    journal: Journal<A::State>,
    /// The cotangent of the time at which the run begins, by the times of its steps.
    of_start: f64,
    /// Whether the record at the start of the step last followed back is of the state after an event there.
    is_replaced: bool,
    /// The given time last followed back, where its state is that after an event.
    given_after: Option<f64>,
}

impl<A> Pullback<A>
where
    A: StepAdjoint,
    A::State: 'static,
{
    /// The pullback of a starter's run, with so many derivatives by τ.
    pub(super) fn of(
        starter: &Starter,
        width: usize,
        method: Recording<A>,
    ) -> Result<Self, StepError> {
        let RecordedSteps {
            control,
            copy,
            whole,
            partial,
            parts,
        } = method.steps;
        let (of, point) = (method.member, method.point);
        let ([n, l, m], model) = (method.sizes, of.model.clone());
        let detection = starter.job.detection.as_ref();
        let times = detection.and_then(|detection| detection.times.clone());
        let times = times.map(|times| GivenTimes::new(times, method.sizes));
        let inner = starter.observer(model, 0);
        let journal = Journal::default();
        let recorder = EventRecorder {
            journal: journal.clone(),
            whole: whole.clone(),
            partial,
            parts,
        };
        let (reset, slopes) = (method.reset, starter.slopes(0));
        let events = starter.has_events().then(|| EventAdjoint {
            events: slopes.clone(),
            reset,
            rows: Vec::new(),
            sizes: [n + l, m, starter.system.multipliers()],
        });
        let observed = [Box::new(inner.clone()) as _, Box::new(inner) as _];
        let stepping = (control, copy);
        let with =
            |detector: DenseDetector<A::State, _>| detector.followed(Box::new(recorder), slopes);
        let start = method.start;
        let step = vec![StepRecord::like(&start); parts];
        let run = starter.launch_observed(stepping, of, start.clone(), observed, with)?;
        Ok(Self {
            cotangents: Cotangents::zeros(A::sizes(n), width),
            point,
            parts,
            start: (starter.job.span.t0, start, method.is_given),
            run: SharedRun::new(run),
            step,
            records: whole,
            adjoint: method.adjoint,
            times,
            events,
            journal,
            of_start: 0.0,
            is_replaced: false,
            given_after: None,
        })
    }
}

impl<A: StepAdjoint> Pullback<A> {
    /// Follows a step back.
    fn leave_step(&mut self, step: &[StepRecord<A::State>]) -> Result<(), StepError> {
        let end = &step[self.parts - 1];
        let of = &mut self.cotangents;
        if self.events.is_none() {
            for part in step.iter().rev() {
                self.adjoint.follow(part, &mut self.point, of)?;
            }
            return Ok(());
        }
        let before = std::mem::take(&mut of.stretch);
        for part in step.iter().rev() {
            self.adjoint.follow(part, &mut self.point, of)?;
        }
        // the end of the step is where it would be without events before, and its length follows
        let moved = of.stretch / step.iter().map(|part| part.h).sum::<f64>();
        of.stretch = before + moved * (end.time() - self.start.0);
        of.tau[0] -= moved;
        self.of_start += moved;
        Ok(())
    }

    /// Adds the cotangents of states at given times, to those of the state where the part of the step begins.
    fn leave_given(&mut self, entries: &[GivenEntry<A::State>]) -> Result<(), StepError> {
        let Some(times) = &self.times else {
            return Ok(());
        };
        for entry in entries {
            let row = times.row(entry.t);
            let is_replaced = !entry.is_after && self.given_after == Some(entry.t);
            self.given_after = entry.is_after.then_some(entry.t);
            if is_replaced {
                continue;
            }
            if row.iter().any(|x| *x != 0.0) {
                let (of, point) = (&mut self.cotangents, &mut self.point);
                entry.leave(row, (&mut self.adjoint, point), of)?;
            }
        }
        Ok(())
    }

    /// Adds the cotangents of the record where an event has cut a step, at a time that is held or is that of the event.
    fn observe_cut(
        &mut self,
        entry: &Entry<A::State>,
        row: &[f64],
        is_held: bool,
    ) -> Result<(), StepError> {
        let (state, point) = (
            entry.after.as_ref().unwrap_or(&entry.state),
            &mut self.point,
        );
        let mut own = self.cotangents.like();
        point.observe((entry.t, state), row, &mut own)?;
        if is_held {
            let rate = entry.rate((&mut self.adjoint, point), &own)?;
            own.tau[0] -= rate;
            own.stretch += rate * (entry.t - self.start.0);
            self.of_start += rate;
        }
        self.cotangents.add_scaled(1.0, &own);
        Ok(())
    }

    /// Takes cotangents back over a step that an event has cut.
    fn leave_cut(&mut self, entry: &Entry<A::State>) -> Result<(), StepError> {
        let (of, point) = (&mut self.cotangents, &mut self.point);
        if let Some(events) = &mut self.events {
            events.leave_reset(entry, (&mut self.adjoint, point), of)?;
        }
        let (of, point) = (&mut self.cotangents, &mut self.point);
        match &mut self.events {
            Some(events) => events.leave(entry, (&mut self.adjoint, point), of),
            None => Ok(()),
        }
    }

    /// Adds the cotangents of an event within a whole step.
    fn leave_event(&mut self, entry: &Entry<A::State>) -> Result<(), StepError> {
        let Some(events) = &mut self.events else {
            return Ok(());
        };
        let mut own = self.cotangents.like();
        events.leave(entry, (&mut self.adjoint, &mut self.point), &mut own)?;
        self.cotangents.add_scaled(1.0, &own);
        Ok(())
    }
}

impl<A: StepAdjoint> Follow for Pullback<A> {
    fn run(&self) -> SharedRun {
        self.run.clone()
    }

    fn forget(&mut self) {
        self.records.lock().clear();
        drop(self.journal.take());
    }

    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.forget();
        self.run.restore(saved)
    }

    fn follow(&mut self, last: usize, kept: &[usize], rows: &Matrix) -> Result<(), StepError> {
        let status = loop {
            let status = self.run.advance_to(last, BETWEEN);
            if status != Status::Paused || self.run.done() >= last {
                break status;
            }
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
        };
        if let Status::Failed { error, .. } = status {
            return Err(error);
        }
        let is_over = status == Status::Done;
        let shared = self.records.clone();
        let records = shared.lock();
        let (mut entries, mut given) = self.journal.take();
        // a run that was recorded as it was made may go beyond the last cotangent
        let (mut number, parts) = (self.run.done().min(last), self.parts);
        let last = records.len() - (self.run.done() - number) * parts;
        for place in (1..=last / parts).rev().map(|k| k * parts) {
            if cancel::is_cancelled() {
                return Err(StepError::Interrupted);
            }
            let own = entries.split_off(entries.partition_point(|entry| entry.place < place));
            let cut = own.iter().rfind(|entry| entry.is_cut());
            let mut within = given.split_off(given.partition_point(|entry| entry.place < place));
            let behind = within.split_off(within.partition_point(|entry| !entry.is_after));
            for (k, part) in self.step.iter_mut().enumerate() {
                records.read(place - parts + k, part);
            }
            let step = std::mem::take(&mut self.step);
            // a step that an event has parted is one with that to its end
            let is_whole = cut.is_none_or(|entry| !entry.goes_on() || is_over && place == last);
            let replaces = replaces_record(&entries, &own, (place, parts));
            let is_recorded = (is_whole || replaces) && !self.is_replaced;
            self.is_replaced = replaces || self.is_replaced && !is_whole;
            // the last record may have replaced that of the step before
            let others = [number, number - usize::from(is_whole && replaces)];
            let mut found = others
                .iter()
                .filter_map(|record| kept.binary_search(record).ok());
            if is_recorded && let Some(row) = found.next() {
                if let Some(entry) = cut {
                    let is_held = !(is_over && place == last && self.journal.is_ended());
                    self.observe_cut(entry, rows.row(row), is_held)?;
                } else {
                    let end = &step[parts - 1];
                    let at = (end.time(), &end.end);
                    self.point
                        .observe(at, rows.row(row), &mut self.cotangents)?;
                }
            }
            number -= usize::from(is_whole);
            self.leave_given(&behind)?;
            if cut.is_none() {
                self.leave_step(&step)?;
            }
            // several resets may follow each other where the run ends
            for entry in own.iter().rev().filter(|entry| entry.is_cut()) {
                self.leave_cut(entry)?;
            }
            self.step = step;
            self.leave_given(&within)?;
            for entry in own.iter().filter(|entry| !entry.is_cut()) {
                self.leave_event(entry)?;
            }
        }
        Ok(())
    }

    fn end(&mut self, row: &[f64]) -> Result<&Cotangents, StepError> {
        let (t, start, is_given) = self.start.clone();
        let at = (t, &start);
        self.cotangents.tau[0] += std::mem::take(&mut self.of_start);
        if !self.is_replaced {
            self.point.observe(at, row, &mut self.cotangents)?;
        }
        let (point, of) = (&mut self.point, &mut self.cotangents);
        self.adjoint.leave(at, is_given, point, of)?;
        Ok(&self.cotangents)
    }

    fn give(&mut self, rows: Matrix) -> bool {
        (self.times.as_mut()).is_some_and(|times| times.give(rows))
    }

    fn give_events(&mut self, rows: Vec<Matrix>) {
        if let Some(events) = &mut self.events {
            events.rows = rows;
        }
    }
}
