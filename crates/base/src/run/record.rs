//! Records of a run: times, and a row of observed quantities for each.

use super::reserve;
use crate::error::StepError;
use crate::observe::Observe;

/// Times and rows recorded so far.
#[derive(Clone, Debug, Default)]
pub struct Records {
    times: Vec<f64>,
    rows: Vec<f64>,
    /// The time of the last record, also when it was collected since.
    last: Option<f64>,
}

impl Records {
    /// Room for so many records of this width, or fewer where they are many or memory is short.
    pub fn with_capacity(expected: usize, width: usize) -> Self {
        let mut records = Self::default();
        // without room, the first record makes its own or fails
        let _ = reserve(&mut records.times, expected.min(1 << 20));
        let _ = reserve(
            &mut records.rows,
            expected.saturating_mul(width).min(1 << 24),
        );
        records
    }

    /// Appends what an observer reads from a state: one row, several or none.
    ///
    /// # Errors
    /// Why it cannot be observed, or that there is no memory for it; the records are as they were.
    pub fn push<T>(
        &mut self,
        observer: &mut dyn Observe<T>,
        t: f64,
        state: &T,
    ) -> Result<(), StepError> {
        reserve(&mut self.times, 1)?;
        reserve(&mut self.rows, observer.width(state))?;
        let before = self.rows.len();
        observer.observe(t, state, &mut self.rows)?;
        let rows = match observer.width(state) {
            0 => 1,
            width => (self.rows.len() - before) / width,
        };
        self.times.extend(std::iter::repeat_n(t, rows));
        self.last = self.times.last().copied().or(self.last);
        Ok(())
    }

    /// Records a state in the place of that of the same time before a reset, unless that was collected already.
    ///
    /// # Errors
    /// Errors of [`Self::push`]; the record before is gone then.
    pub fn replace<T>(
        &mut self,
        observer: &mut dyn Observe<T>,
        t: f64,
        state: &T,
    ) -> Result<(), StepError> {
        while self.times.last() == Some(&t) {
            self.rows
                .truncate(self.rows.len() - self.rows.len() / self.times.len());
            self.times.pop();
        }
        self.push(observer, t, state)
    }

    /// How many records there are that were not collected.
    pub(super) fn len(&self) -> usize {
        self.times.len()
    }

    /// Drops all records but the first.
    pub(super) fn truncate(&mut self, count: usize) {
        let width = self.rows.len().checked_div(self.times.len()).unwrap_or(0);
        self.times.truncate(count);
        self.rows.truncate(count * width);
    }

    /// The time of the last record.
    pub fn last(&self) -> Option<f64> {
        self.last
    }

    /// The records so far; room is left for as many again.
    pub(super) fn collect(&mut self) -> (Vec<f64>, Vec<f64>) {
        let again = |x: &mut Vec<f64>| {
            let mut next = Vec::new();
            let _ = reserve(&mut next, x.len());
            std::mem::replace(x, next)
        };
        (again(&mut self.times), again(&mut self.rows))
    }

    pub(super) fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let rows = std::mem::take(&mut self.rows);
        (std::mem::take(&mut self.times), rows)
    }
}

// Times and rows are not saved: they were collected before.
crate::checkpoint!(Records { last } then |records| {
    records.times.clear();
    records.rows.clear();
    Ok(())
});
