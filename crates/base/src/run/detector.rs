//! What looks at a run between its steps: events, and records at given times.

use super::Recorder;
use crate::checkpoint::Checkpoint;
use crate::error::StepError;
use crate::method::Stepper;

/// Someone who looks at each step of a run.
pub trait EventDetector<S: Stepper, O>: Checkpoint + Send {
    /// Whether anybody looks.
    const IS_ACTIVE: bool = true;

    /// Whether the run's records are those at times of its own, and not one state in some.
    fn is_recording(&self) -> bool;

    /// The run is about to begin here.
    ///
    /// # Errors
    /// Something that is looked at is not finite, or cannot be recorded.
    fn start(&mut self, t: f64, state: &S::State, out: &mut Recorder<O>) -> Result<(), StepError>;

    /// A step is about to be made from here.
    fn before(&mut self, t: f64, state: &S::State);

    /// A step led here. Where the run is to end within it, the state becomes that of its end, and the time
    /// of that is returned.
    ///
    /// # Errors
    /// Something that is looked at is not finite, or cannot be recorded.
    fn after(
        &mut self,
        t: f64,
        state: &mut S::State,
        out: &mut Recorder<O>,
    ) -> Result<Option<f64>, StepError>;

    /// The run is over: what was held back is recorded.
    fn finish(&mut self, out: &mut Recorder<O>);

    /// What was found since this was last asked for, and how the run has ended.
    fn take(&mut self) -> Seen;
}

/// The events that a run has met.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// For each kind of event the times, and rows of y, z and λ one after another.
    pub events: Vec<(Vec<f64>, Vec<f64>)>,
    /// Which kind ended the run, and when.
    pub end: Option<(usize, f64)>,
}

/// Nobody looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoEvents;

impl<S: Stepper, O> EventDetector<S, O> for NoEvents {
    const IS_ACTIVE: bool = false;

    fn is_recording(&self) -> bool {
        false
    }

    fn start(&mut self, _: f64, _: &S::State, _: &mut Recorder<O>) -> Result<(), StepError> {
        Ok(())
    }

    fn before(&mut self, _: f64, _: &S::State) {}

    fn after(
        &mut self,
        _: f64,
        _: &mut S::State,
        _: &mut Recorder<O>,
    ) -> Result<Option<f64>, StepError> {
        Ok(None)
    }

    fn finish(&mut self, _: &mut Recorder<O>) {}

    fn take(&mut self) -> Seen {
        Seen::default()
    }
}

impl Checkpoint for NoEvents {}
