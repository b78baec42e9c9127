//! The interface of a run of any kind.

use super::{Events, StepSizes};
use crate::checkpoint::CheckpointMismatch;
use crate::error::StepError;
use crate::method::Stats;
use crate::observe::Finding;
use std::time::Duration;

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
        /// The cause.
        error: StepError,
    },
}

/// A member of an ensemble that failed.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Its number.
    pub member: usize,
    /// The step that could not be made or recorded, and the time at its start; none where the start itself failed.
    pub step: Option<(usize, f64)>,
    /// The cause.
    pub error: StepError,
}

/// A run of any kind.
pub trait Advance: Send + Sync {
    /// Makes steps until this time budget is spent, or the run is over.
    fn advance(&mut self, budget: Duration) -> Status {
        self.advance_to(usize::MAX, budget)
    }
    /// The same, or until `steps` are made in all.
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status;
    /// Number of steps made.
    fn done(&self) -> usize;
    /// The time they lead to.
    fn time(&self) -> f64;
    /// Statistics of the steps, and how many were rejected; of members in lock-step, of all together.
    fn stats(&self) -> (Stats, usize);
    /// The same of the member at a place in lock-step.
    fn stats_of(&self, _place: usize) -> (Stats, usize) {
        self.stats()
    }
    /// The sizes of its steps, where they are not equal.
    fn sizes(&self) -> Option<StepSizes> {
        None
    }
    /// The shape of a record: its width, or the number of members and the width of each.
    fn shape(&self) -> Vec<usize>;
    /// Times of the records, one a row, and the rows one after another, the present state last. The
    /// run is over and keeps none.
    fn take(&mut self) -> (Vec<f64>, Vec<f64>);
    /// Takes the records so far out of the run, which goes on.
    fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        (Vec::new(), Vec::new())
    }
    /// The arguments of the equations at the present state, by [`crate::observe::Observe::locate`]; none where the run has
    /// no single motion with these.
    fn place(&mut self) -> Option<Vec<f64>> {
        None
    }
    /// Appends all that the rest of the run depends on; the records and events collected before are not part of
    /// it. Returns whether runs of this kind can be saved.
    ///
    /// # Errors
    /// There is no memory for it.
    fn save(&self, _out: &mut Vec<f64>) -> Result<bool, StepError> {
        Ok(false)
    }
    /// Continues a saved run, with the same bits; this one was begun in the same way.
    ///
    /// # Errors
    /// It was another run; this one is not to be used then.
    fn restore(&mut self, _saved: &[f64]) -> Result<(), CheckpointMismatch> {
        Err(CheckpointMismatch)
    }
    /// Members that failed while others went on, in their order.
    fn failures(&self) -> Vec<Failure> {
        Vec::new()
    }
    /// Whether records were lost in [`Advance::take`], for want of memory.
    fn is_short(&self) -> bool {
        false
    }
    /// How many members have reached their end, or failed.
    fn over(&self) -> usize {
        0
    }
    /// Returns the findings of the motion so far, or of the members that are over, with their numbers.
    fn found(&self) -> Vec<(usize, Finding)> {
        Vec::new()
    }
    /// The events found since the last call; to be called after the records were collected.
    fn events(&mut self) -> Events {
        Events::default()
    }
}
