//! What a run keeps: times, and rows of what an observer sees.

use crate::problem::Observe;
use crate::trouble::Trouble;

/// An observer and what it has recorded so far.
#[derive(Clone, Debug)]
pub struct Recorder<O> {
    observer: O,
    times: Vec<f64>,
    rows: Vec<f64>,
}

impl<O> Recorder<O> {
    /// Room for so many records of this width.
    pub(super) fn new(observer: O, expected: usize, width: usize) -> Self {
        Self {
            observer,
            times: Vec::with_capacity(expected.min(1 << 20)),
            rows: Vec::with_capacity((expected * width).min(1 << 24)),
        }
    }

    /// Records a state.
    ///
    /// # Errors
    /// Why it cannot be recorded; the records are as they were.
    pub fn record<T>(&mut self, t: f64, state: &T) -> Result<(), Trouble>
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
        Ok(())
    }

    /// The time of the last record.
    pub(super) fn last(&self) -> Option<f64> {
        self.times.last().copied()
    }

    pub(super) fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let rows = std::mem::take(&mut self.rows);
        (std::mem::take(&mut self.times), rows)
    }
}
