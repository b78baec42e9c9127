//! Steps that cannot be made as a whole, where an event ends their first part.

use super::{Outcome, Run};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;

/// The shortest part of a step that is tried.
const SHORTEST: f64 = 1.0 / 1024.0;
/// The largest number of parts.
const MOST: usize = 32;

impl<State: Checkpoint> Run<State> {
    /// Makes the first part of a step that could not be made, up to an event within it, from which the run goes on.
    ///
    /// A force may jump at an event: then the equations of a step have a solution near and up to the event alone. Parts
    /// are halved until one can be made.
    ///
    /// # Errors
    /// The error of the whole step, if no event restarts or ends the run in a part; state and time are as they were.
    pub(super) fn step_to_event(&mut self, start: f64, error: StepError) -> Result<(), StepError> {
        if self.events.is_none() || error == StepError::Interrupted {
            return Err(error);
        }
        let (mut state, mut control) = (Vec::new(), Vec::new());
        self.state.save(0, &mut state);
        self.control.save(0, &mut control);
        let (n, records) = (self.n, self.records.len());
        if let Ok(true) = self.parts_to_event(start) {
            return Ok(());
        }
        self.n = n;
        self.records.truncate(records);
        let state = self.state.restore(0, &mut &state[..]);
        let control = self.control.restore(0, &mut &control[..]);
        self.is_recordable &= state.is_ok() && control.is_ok();
        Err(error)
    }

    /// Makes parts of the step from `start` until an event restarts or ends the run; false where none does.
    fn parts_to_event(&mut self, start: f64) -> Result<bool, StepError> {
        let mut part = 0.5;
        for _ in 0..MOST {
            match self.control.step_part(&mut self.state, part) {
                None => return Ok(false),
                Some(Err(_)) if part < SHORTEST => return Ok(false),
                Some(Err(_)) => part /= 2.0,
                Some(Ok(())) if self.finish_part(start)? => return Ok(true),
                Some(Ok(())) => {
                    let t = self.control.time();
                    if let Some(events) = &mut self.events {
                        events.before(t, &mut self.state);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Looks for events in the part of a step just made; returns whether one restarts or ends the run.
    fn finish_part(&mut self, start: f64) -> Result<bool, StepError> {
        self.control.stepper_mut().synchronize(&mut self.state)?;
        let t = self.control.time();
        let Some(events) = &mut self.events else {
            return Ok(false);
        };
        let outcome = events.after((t, false), &mut self.state, &mut self.records)?;
        match outcome {
            Outcome::Restart(at) => {
                self.restart(at);
                self.replace_record(at, outcome)?;
            }
            Outcome::End(at) => {
                (self.end, self.n) = (Some(at), self.n + 1);
                self.look_and_record(start, outcome)?;
            }
            Outcome::Continue | Outcome::Shorten(_) => return Ok(false),
        }
        Ok(true)
    }
}
