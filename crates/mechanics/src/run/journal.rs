//! The events of a run that is made again, and its states at given times.

use crate::events::{FollowEvents, Given, Meeting};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Obstacle, StepError};
use liouville_base::recorder::{Recorded, SharedRecords, StepRecord};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An event that was met.
#[derive(Clone, Debug)]
pub(super) struct Entry<S> {
    /// How many steps were recorded, that in which it was met included.
    pub(super) place: usize,
    pub(super) t: f64,
    /// The part of the step that led to it, and the state there.
    pub(super) part: f64,
    pub(super) state: S,
    /// That after a reset.
    pub(super) after: Option<S>,
    /// Whether it ends the run, or the step.
    pub(super) is_last: bool,
    pub(super) event: usize,
    pub(super) hit: usize,
    /// The length of the whole step, and the largest size of the event's function in it.
    pub(super) h: f64,
    pub(super) height: f64,
    pub(super) lam: Vec<f64>,
    pub(super) obstacle: Option<Obstacle>,
    /// The part of the step.
    pub(super) steps: Vec<StepRecord<S>>,
}

impl<S> Entry<S> {
    /// Whether no more of the step was made.
    pub(super) fn is_cut(&self) -> bool {
        self.after.is_some() || self.is_last
    }

    /// Whether it begins a step anew within one, which is then made to its end.
    pub(super) fn goes_on(&self) -> bool {
        self.after.is_some() && self.part < 1.0
    }
}

/// A state at a given time.
#[derive(Clone, Debug)]
pub(super) struct GivenEntry<S> {
    /// How many steps were recorded, that which was parted included.
    pub(super) place: usize,
    pub(super) t: f64,
    /// The length of the whole step.
    pub(super) h: f64,
    pub(super) state: S,
    /// Whether it is that after a reset.
    pub(super) is_after: bool,
    /// The part of the step that led to it.
    pub(super) steps: Vec<StepRecord<S>>,
}

/// The events met, and the states at given times.
#[derive(Debug)]
struct Notes<S> {
    events: Vec<Entry<S>>,
    given: Vec<GivenEntry<S>>,
    /// Whether an event has ended the run.
    is_ended: bool,
}

/// Notes that the run and its adjoint share.
#[derive(Debug)]
pub(super) struct Journal<S>(Arc<Mutex<Notes<S>>>);

impl<S> Clone for Journal<S> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<S> Default for Journal<S> {
    fn default() -> Self {
        let (events, given) = (Vec::new(), Vec::new());
        let is_ended = false;
        Self(Arc::new(Mutex::new(Notes {
            events,
            given,
            is_ended,
        })))
    }
}

impl<S> Journal<S> {
    /// All up to now, which are forgotten.
    pub(super) fn take(&self) -> (Vec<Entry<S>>, Vec<GivenEntry<S>>) {
        let mut notes = self.lock();
        let given = std::mem::take(&mut notes.given);
        (std::mem::take(&mut notes.events), given)
    }

    /// Whether an event has ended the run.
    pub(super) fn is_ended(&self) -> bool {
        self.lock().is_ended
    }

    fn lock(&self) -> MutexGuard<'_, Notes<S>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Keeps the events of a run, and its states at given times.
pub(super) struct EventRecorder<S> {
    pub(super) journal: Journal<S>,
    /// Whole steps, and parts of steps, each made of so many.
    pub(super) whole: SharedRecords<S>,
    pub(super) partial: SharedRecords<S>,
    pub(super) parts: usize,
}

impl<S: Checkpoint + Recorded + Clone> EventRecorder<S> {
    /// How many steps were recorded, and those of which this part of the last one was made, of states like this one.
    #[allow(clippy::float_cmp)] // 0 and 1 are the ends of the step
    fn steps(&self, part: f64, like: &S) -> (usize, Vec<StepRecord<S>>) {
        let whole = self.whole.lock();
        let (partial, last) = (self.partial.lock(), self.parts);
        let steps = match part {
            0.0 => Vec::new(),
            1.0 => whole.copies(whole.len() - last..whole.len(), like),
            _ => partial.copies(partial.len() - last..partial.len(), like),
        };
        (whole.len(), steps)
    }
}

impl<S: Checkpoint + Recorded + Clone> FollowEvents<S> for EventRecorder<S> {
    fn begin(&mut self, _: &mut S) {
        self.partial.lock().clear();
    }

    fn align(&mut self, _: f64, _: &mut S) {}

    fn meet(&mut self, met: Meeting<'_>, state: &mut S) -> Result<(), StepError> {
        let (place, steps) = self.steps(met.part, state);
        self.journal.lock().events.push(Entry {
            place,
            t: met.t,
            part: met.part,
            state: state.clone(),
            after: None,
            is_last: met.is_last,
            event: met.event,
            hit: met.hit,
            h: met.h,
            height: met.height,
            lam: met.lam.to_vec(),
            obstacle: met.obstacle,
            steps,
        });
        Ok(())
    }

    fn hold(&mut self, at: Given, state: &mut S) -> Result<(), StepError> {
        if at.is_of_step {
            return Ok(());
        }
        let part = if at.is_after { 0.0 } else { at.part };
        let (place, steps) = self.steps(part, state);
        let given = &mut self.journal.lock().given;
        // that before a reset
        given.pop_if(|last| last.t.to_bits() == at.t.to_bits());
        given.push(GivenEntry {
            place,
            t: at.t,
            h: at.h,
            state: state.clone(),
            is_after: at.is_after,
            steps,
        });
        Ok(())
    }

    fn reset(
        &mut self,
        _: (usize, f64),
        _: &[f64],
        (_, after): (&S, &mut S),
    ) -> Result<(), StepError> {
        if let Some(entry) = self.journal.lock().events.last_mut() {
            entry.after = Some(after.clone());
        }
        Ok(())
    }

    fn end(&mut self) {
        self.journal.lock().is_ended = true;
    }

    fn record(&mut self, _: f64, _: &S, _: &mut Vec<f64>) -> Result<(), StepError> {
        Ok(())
    }
}

/// Whether the events `own` of the step that ends at `place` cut it at its start, and so does each step before as far as one
/// that was made whole: the record there is of the state after them.
#[allow(clippy::float_cmp)] // 0 and 1 are the ends of the step
pub(super) fn replaces_record<S>(
    entries: &[Entry<S>],
    own: &[Entry<S>],
    (mut place, parts): (usize, usize),
) -> bool {
    let mut cuts = own.iter().filter(|entry| entry.is_cut());
    if cuts.next().is_none_or(|first| first.part != 0.0) {
        return false;
    }
    loop {
        place -= parts;
        let mut before = entries.iter().filter(|entry| entry.place == place);
        match before.find(|entry| entry.is_cut()) {
            Some(first) if first.part == 0.0 => {}
            Some(first) => return first.part == 1.0,
            None => return true,
        }
    }
}
