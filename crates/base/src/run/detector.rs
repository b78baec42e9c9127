//! Event detectors, which a run calls before and after each step.

use super::{Records, reserve};
use crate::checkpoint::Checkpoint;
use crate::error::StepError;

/// Finds events on the trajectory, and may record states at given times.
pub trait EventDetector<State>: Checkpoint {
    /// Whether the records are those at the detector's own times, instead of one state in so many.
    fn is_recording(&self) -> bool;

    /// Called where the run begins.
    ///
    /// # Errors
    /// An event function is not finite, or needs multipliers that cannot be solved for.
    fn start(&mut self, t: f64, state: &State) -> Result<(), StepError>;

    /// Called before each step.
    fn before(&mut self, t: f64, state: &mut State);

    /// Called after each step, which led to `state` at this time; with whether it is the last of the run. Where the run ends
    /// or restarts within the step, `state` becomes the state there.
    ///
    /// # Errors
    /// An event function is not finite, or a state cannot be recorded.
    fn after(
        &mut self,
        end: (f64, bool),
        state: &mut State,
        records: &mut Records,
    ) -> Result<Outcome, StepError>;

    /// Called before the state to which an event has cut a step is recorded at `t`, as a step's end; gives that to record in its
    /// place, if it is another one. The step goes on from there, or a reset has led there.
    ///
    /// # Errors
    /// It has no derivative.
    fn hold(&mut self, _: (f64, Outcome), _: &State) -> Result<Option<&State>, StepError> {
        Ok(None)
    }

    /// Called at the end of each step, and behind a reset, where the records are its own and its observer follows.
    fn follow(&mut self, _t: f64, _state: &State) {}

    /// Called at the end of the run; makes the records that are still due.
    fn finish(&mut self, records: &mut Records);

    /// The events found since this was last called, and how the run has ended.
    fn take(&mut self) -> Events;
}

/// The effect of the events in a step on the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// Nothing that changes the run.
    Continue,
    /// The run goes on from this time within the step, or at its end, with another state.
    Restart(f64),
    /// The step ends at this time within it, and the next one begins anew.
    Shorten(f64),
    /// The run ends at this time.
    End(f64),
}

/// The events of a run, or of each member of an ensemble.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Events {
    /// Hits of each kind of event.
    pub found: Vec<Hits>,
    /// The events that ended the run, or runs of members.
    pub ends: Vec<Ending>,
}

/// The hits of one kind of event.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hits {
    /// The times.
    pub times: Vec<f64>,
    /// Rows of y, z and λ one after another; of an event with a reset, those after it behind those before.
    pub rows: Vec<f64>,
    /// The member of each, in an ensemble.
    pub members: Vec<usize>,
}

/// An event that has ended a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ending {
    /// Which kind.
    pub event: usize,
    /// When.
    pub t: f64,
    /// Where its hits accumulate, if that is why.
    pub limit: Option<f64>,
    /// The member of an ensemble.
    pub member: usize,
}

crate::checkpoint!(Ending {
    event,
    t,
    limit,
    member
});

impl Events {
    /// Appends what a member of an ensemble has met.
    ///
    /// # Errors
    /// There is no memory for it; nothing was appended to the last kind of event.
    pub fn append(&mut self, member: usize, other: Self) -> Result<(), StepError> {
        self.found
            .resize_with(other.found.len().max(self.found.len()), Hits::default);
        for (all, hits) in self.found.iter_mut().zip(other.found) {
            reserve(&mut all.times, hits.times.len())?;
            reserve(&mut all.rows, hits.rows.len())?;
            all.members
                .extend(std::iter::repeat_n(member, hits.times.len()));
            all.times.extend(hits.times);
            all.rows.extend(hits.rows);
        }
        let ends = other.ends.into_iter();
        self.ends.extend(ends.map(|end| Ending { member, ..end }));
        Ok(())
    }
}
