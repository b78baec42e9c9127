//! States at given times: each is the end of a step of its own, from the end of the last whole step before it.
//!
//! A shorter step by the same method keeps what the method keeps, as no interpolation does, and has its order.

use super::{EventDetector, Events, Outcome, Records};
use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::error::StepError;
use crate::method::Stepper;
use crate::observe::Observe;

/// A time that exceeds the end of a step by this part of it, from roundoff, is of that step.
const ROUNDOFF: f64 = 1e-9;

/// Records a run at given times, in the order of the run.
pub struct GivenTimes<State: Checkpoint> {
    stepper: Box<dyn Stepper<State = State>>,
    observer: Box<dyn Observe<State>>,
    times: Vec<f64>,
    next: usize,
    /// Where the present step begins.
    start: (f64, State),
    within: State,
}

impl<State: Checkpoint + Clone> GivenTimes<State> {
    /// Records by this observer, with steps by a copy of the run's stepper.
    pub fn new(
        stepper: Box<dyn Stepper<State = State>>,
        observer: Box<dyn Observe<State>>,
        times: Vec<f64>,
        state: &State,
    ) -> Self {
        Self {
            stepper,
            observer,
            times,
            next: 0,
            start: (0.0, state.clone()),
            within: state.clone(),
        }
    }
}

impl<State: Checkpoint + Clone> EventDetector<State> for GivenTimes<State> {
    fn is_recording(&self) -> bool {
        true
    }

    fn start(&mut self, _: f64, _: &State) -> Result<(), StepError> {
        Ok(())
    }

    fn before(&mut self, t: f64, state: &mut State) {
        self.start.0 = t;
        self.start.1.clone_from(state);
    }

    fn after(
        &mut self,
        t: f64,
        _: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError> {
        let (start, before) = &self.start;
        let h = t - start;
        while let Some(wanted) = self.times.get(self.next) {
            if (wanted - t) / h > ROUNDOFF {
                break;
            }
            self.within.clone_from(before);
            if wanted.to_bits() != start.to_bits() {
                self.stepper
                    .step(*start, wanted - start, &mut self.within)?;
                self.stepper.synchronize(&mut self.within)?;
            }
            records.push(&mut *self.observer, *wanted, &self.within)?;
            self.next += 1;
        }
        Ok(Outcome::Continue)
    }

    fn finish(&mut self, _: &mut Records) {}

    fn take(&mut self) -> Events {
        Events::default()
    }
}

impl<State: Checkpoint> Checkpoint for GivenTimes<State> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.next.save(member, out);
        self.observer.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.next.restore(member, saved)?;
        self.observer.restore(member, saved)
    }
}
