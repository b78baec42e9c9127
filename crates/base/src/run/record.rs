//! What a run keeps: times, and rows of what an observer sees.

use crate::checkpoint::{Checkpoint, CheckpointMismatch};
use crate::error::StepError;
use crate::observe::Observe;

/// An observer and what it has recorded so far.
#[derive(Clone, Debug)]
pub struct Recorder<O> {
    observer: O,
    times: Vec<f64>,
    rows: Vec<f64>,
    /// The time of the last record, wherever it is by now.
    last: Option<f64>,
}

impl<O> Recorder<O> {
    /// Room for so many records of this width.
    pub(super) fn new(observer: O, expected: usize, width: usize) -> Self {
        Self {
            observer,
            times: Vec::with_capacity(expected.min(1 << 20)),
            rows: Vec::with_capacity((expected * width).min(1 << 24)),
            last: None,
        }
    }

    /// Records a state.
    ///
    /// # Errors
    /// Why it cannot be recorded; the records are as they were.
    pub fn record<T>(&mut self, t: f64, state: &T) -> Result<(), StepError>
    where
        O: Observe<T>,
    {
        let before = self.rows.len();
        self.observer.observe(t, state, &mut self.rows)?;
        // some observers have several rows for a state, or none
        let rows = match self.observer.width(state) {
            0 => 1,
            width => (self.rows.len() - before) / width,
        };
        self.times.extend(std::iter::repeat_n(t, rows));
        self.last = self.times.last().copied().or(self.last);
        Ok(())
    }

    /// The time of the last record.
    pub(super) fn last(&self) -> Option<f64> {
        self.last
    }

    /// The records so far; there will be about as many again.
    pub(super) fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        let again = |x: &mut Vec<f64>| {
            let next = Vec::with_capacity(x.len());
            std::mem::replace(x, next)
        };
        (again(&mut self.times), again(&mut self.rows))
    }

    pub(super) fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let rows = std::mem::take(&mut self.rows);
        (std::mem::take(&mut self.times), rows)
    }
}

/// What is recorded is with whoever has collected it.
impl<O: Checkpoint> Checkpoint for Recorder<O> {
    fn save(&self, member: usize, out: &mut Vec<f64>) {
        self.observer.save(member, out);
        self.last.save(member, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.times.clear();
        self.rows.clear();
        self.observer.restore(member, saved)?;
        self.last.restore(member, saved)
    }
}
