//! Event detectors: what a run consults between its steps.

use super::Records;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;

/// Finds events on the trajectory, and may record states at given times.
pub trait EventDetector<State>: Checkpoint {
    /// Whether the records are those at the detector's own times, instead of one state in so many.
    fn is_recording(&self) -> bool;

    /// The run is about to begin here.
    ///
    /// # Errors
    /// An event function is not finite, or needs multipliers that cannot be solved for.
    fn start(&mut self, t: f64, state: &State) -> Result<(), StepError>;

    /// A step is about to be made from here.
    fn before(&mut self, t: f64, state: &State);

    /// A step led here. Where the run is to end within it, the state becomes that of its end, and the time
    /// of that is returned.
    ///
    /// # Errors
    /// An event function is not finite, or a state cannot be recorded.
    fn after(
        &mut self,
        t: f64,
        state: &mut State,
        records: &mut Records,
    ) -> Result<Option<f64>, StepError>;

    /// The run is over: records that are still due.
    fn finish(&mut self, records: &mut Records);

    /// The events found since this was last called, and how the run has ended.
    fn take(&mut self) -> Events;
}

/// The events that a run has met.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Events {
    /// For each kind of event the times, and rows of y, z and λ one after another.
    pub found: Vec<(Vec<f64>, Vec<f64>)>,
    /// Which kind ended the run, and when.
    pub end: Option<(usize, f64)>,
}
