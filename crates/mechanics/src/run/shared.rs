//! A run in two hands: one advances it, the other follows its recorded steps back.

use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::method::Stats;
use liouville_base::observe::Finding;
use liouville_base::run::{Advance, Events, Failure, Status, StepSizes};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A run that several own, and advance in turn.
#[derive(Clone)]
pub struct SharedRun(Arc<Mutex<Box<dyn Advance>>>);

impl SharedRun {
    /// A run that has one owner so far.
    pub fn new(run: Box<dyn Advance>) -> Self {
        Self(Arc::new(Mutex::new(run)))
    }

    fn lock(&self) -> MutexGuard<'_, Box<dyn Advance>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Advance for SharedRun {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        self.lock().advance_to(steps, budget)
    }

    fn done(&self) -> usize {
        self.lock().done()
    }

    fn time(&self) -> f64 {
        self.lock().time()
    }

    fn stats(&self) -> (Stats, usize) {
        self.lock().stats()
    }

    fn sizes(&self) -> Option<StepSizes> {
        self.lock().sizes()
    }

    fn shape(&self) -> Vec<usize> {
        self.lock().shape()
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.lock().take()
    }

    fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.lock().collect()
    }

    fn place(&mut self) -> Option<Vec<f64>> {
        self.lock().place()
    }

    fn save(&self, out: &mut Vec<f64>) -> Result<bool, StepError> {
        self.lock().save(out)
    }

    fn restore(&mut self, saved: &[f64]) -> Result<(), CheckpointMismatch> {
        self.lock().restore(saved)
    }

    fn failures(&self) -> Vec<Failure> {
        self.lock().failures()
    }

    fn is_short(&self) -> bool {
        self.lock().is_short()
    }

    fn over(&self) -> usize {
        self.lock().over()
    }

    fn found(&self) -> Vec<(usize, Finding)> {
        self.lock().found()
    }

    fn events(&mut self) -> Events {
        self.lock().events()
    }
}
