//! Events of a run that is made again, and their adjoints.
//!
//! With (ū, t̄) the cotangents of the state and the time of an event, and w the derivative by the length of the step,
//!
//!     κ̄ = ū w + t̄,   (ū, t̄) −= κ̄ / (e_y w_y + e_z w_z + e_t) (e_y, e_z, e_t),   θ̄ −= κ̄ / (…) e_θ
//!
//! before the part of the step is followed back. The products with w are what an adjoint step says of its length, so that
//! part is followed twice: with (ū, t̄), and with the slopes of e. Of a state at a given time the part of the step is as
//! long as that time is later than its start, so that the cotangent of the time of the start takes −ū w.

use super::pullback::StepAdjoint;
use crate::events::{Before, FollowEvents, Given, LinearReset, Meeting, SlopesModel};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Obstacle, StepError};
use liouville_base::linalg::{Matrix, add_scaled};
use liouville_base::recorder::{Recorded, SharedRecords, StepRecord};
use liouville_problem::{Carried, Cotangents, ObservePoint, Side};
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
    event: usize,
    hit: usize,
    /// The length of the whole step, and the largest size of the event's function in it.
    h: f64,
    height: f64,
    lam: Vec<f64>,
    obstacle: Option<Obstacle>,
    /// The part of the step.
    steps: Vec<StepRecord<S>>,
}

impl<S> Entry<S> {
    /// Whether no more of the step was made.
    pub(super) fn is_cut(&self) -> bool {
        self.after.is_some() || self.is_last
    }
}

/// A state at a given time.
#[derive(Clone, Debug)]
pub(super) struct GivenEntry<S> {
    /// How many steps were recorded, that which was parted included.
    pub(super) place: usize,
    pub(super) t: f64,
    /// The length of the whole step.
    h: f64,
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

/// The adjoints of events.
pub(super) struct EventAdjoint {
    pub(super) events: Vec<SlopesModel>,
    pub(super) reset: Box<dyn LinearReset>,
    /// Cotangents of each event: of t, y, z and λ, and of y, z and λ after a reset, a row for each time it was met.
    pub(super) rows: Vec<Matrix>,
    /// Of y and z together, of the multipliers of a step, and of all.
    pub(super) sizes: [usize; 3],
}

impl EventAdjoint {
    /// The row of an entry, where cotangents of its event were given.
    fn row<S>(&self, entry: &Entry<S>) -> Option<&[f64]> {
        let rows = self.rows.get(entry.event)?;
        (entry.hit < rows.rows()).then(|| rows.row(entry.hit))
    }

    /// Takes cotangents from behind a reset to before it.
    ///
    /// # Errors
    /// It has no derivative.
    pub(super) fn leave_reset<A: StepAdjoint>(
        &mut self,
        entry: &Entry<A::State>,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let Some(after) = &entry.after else {
            return Ok(());
        };
        adjoint.leave((entry.t, after), false, point, of)?;
        let [state, m, _] = self.sizes;
        if let Some(row) = self.row(entry).and_then(|row| row.get(1 + state + m..))
            && !row.is_empty()
        {
            point.observe((entry.t, after), row, of)?;
        }
        let slopes = &mut self.events[entry.event];
        let (y, z) = (entry.state.y(), entry.state.z());
        let before: Before<'_> = (entry.t, [y, z, &entry.lam]);
        self.reset.make(slopes, before, [after.y(), after.z()])?;
        let found = self.reset.pull(slopes, before, [&of.y, &of.z])?;
        of.y.fill(0.0);
        of.z.fill(0.0);
        self.add((entry, &found), point, of)
    }

    /// Adds cotangents of (t, y, z, λ, θ) at an event.
    fn add<S: Carried>(
        &self,
        (entry, found): (&Entry<S>, &[f64]),
        point: &mut impl ObservePoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let [state, m, multipliers] = self.sizes;
        // of redundant constraints there are more multipliers, which no event depends on
        let row = &found[1..][..state + m.min(multipliers)];
        let row = if m == multipliers {
            row.to_vec()
        } else {
            [&row[..state], &vec![0.0; m]].concat()
        };
        of.tau[0] += found[0];
        add_scaled(&mut of.tau[1..], 1.0, &found[1 + state + multipliers..]);
        point.observe((entry.t, &entry.state), &row, of)
    }

    /// Takes cotangents from an event to the start of the step in which it was met, those of the event included.
    ///
    /// # Errors
    /// It has no derivative.
    pub(super) fn leave<A: StepAdjoint>(
        &mut self,
        entry: &Entry<A::State>,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let [state, m, _] = self.sizes;
        if let Some(row) = self.row(entry) {
            of.tau[0] += row[0];
            point.observe((entry.t, &entry.state), &row[1..=state + m], of)?;
        }
        let (y, z) = (entry.state.y(), entry.state.z());
        let before: Before<'_> = (entry.t, [y, z, &entry.lam]);
        let gradient = self.events[entry.event].gradient(before)?.to_vec();
        let mut slopes = of.like();
        self.add((entry, &gradient), point, &mut slopes)?;
        let at = (entry.t, &entry.state);
        let (own, slope, length) = if entry.steps.is_empty() {
            let side = Side::Before(entry.h);
            let own = point.rate(at, side, of)?;
            (own, point.rate(at, side, &slopes)?, 1.0)
        } else {
            let before = std::mem::take(&mut of.stretch);
            for step in entry.steps.iter().rev() {
                adjoint.follow(step, point, of)?;
                adjoint.follow(step, point, &mut slopes)?;
            }
            let own = std::mem::replace(&mut of.stretch, before);
            let slope = std::mem::take(&mut slopes.stretch);
            (own, slope, entry.steps.iter().map(|step| step.h).sum())
        };
        entry.meeting().check(slope / length)?;
        of.add_scaled(-own / slope, &slopes);
        Ok(())
    }
}

impl<S> Entry<S> {
    fn meeting(&self) -> Meeting<'_> {
        Meeting {
            event: self.event,
            hit: self.hit,
            part: self.part,
            t: self.t,
            h: self.h,
            lam: &self.lam,
            needs_lam: false,
            height: self.height,
            is_last: self.is_last,
            obstacle: self.obstacle,
        }
    }

    /// The derivative by time of a function with these cotangents of the state that it has led to: along the motion after a
    /// reset, else along that before.
    pub(super) fn rate<A: StepAdjoint<State = S>>(
        &self,
        (adjoint, point): (&mut A, &mut A::Point),
        of: &Cotangents,
    ) -> Result<f64, StepError>
    where
        S: Carried,
    {
        if let Some(after) = &self.after {
            return point.rate((self.t, after), Side::After(self.h), of);
        }
        if self.steps.is_empty() {
            return point.rate((self.t, &self.state), Side::Before(self.h), of);
        }
        let mut back = of.clone();
        for step in self.steps.iter().rev() {
            adjoint.follow(step, point, &mut back)?;
        }
        Ok(back.stretch / self.steps.iter().map(|step| step.h).sum::<f64>())
    }

    /// Whether it begins a step anew within one, which is then made to its end.
    pub(super) fn goes_on(&self) -> bool {
        self.after.is_some() && self.part < 1.0
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

impl<S: Carried> GivenEntry<S> {
    /// Adds cotangents of (y, z, λ) at the given time to those of the state where the part of the step begins.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub(super) fn leave<A: StepAdjoint<State = S>>(
        &self,
        row: &[f64],
        (adjoint, point): (&mut A, &mut A::Point),
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (mut own, at) = (of.like(), (self.t, &self.state));
        point.observe(at, row, &mut own)?;
        // the time there is held
        own.tau[0] = 0.0;
        own.tau[0] = if self.steps.is_empty() {
            -point.rate(at, Side::After(self.h), &own)?
        } else {
            for step in self.steps.iter().rev() {
                adjoint.follow(step, point, &mut own)?;
            }
            let length: f64 = self.steps.iter().map(|step| step.h).sum();
            own.tau[0] - std::mem::take(&mut own.stretch) / length
        };
        of.add_scaled(1.0, &own);
        Ok(())
    }
}
