//! The times of a run by equal steps, and the errors of a start.

use super::reserve;
use crate::error::StepError;

/// A run by equal steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where it starts.
    pub t0: f64,
    /// Where it ends, before `t0` in a run back in time.
    pub t1: f64,
    /// How many steps lead there.
    pub steps: usize,
    /// One state in so many is recorded, and the last.
    pub every: usize,
}

impl Span {
    /// The length of a step.
    pub fn h(&self) -> f64 {
        (self.t1 - self.t0) / self.steps as f64
    }

    /// How many records there will be, or a few more.
    pub fn records(&self) -> usize {
        self.steps / self.every + 2
    }

    /// The times of all records.
    ///
    /// # Errors
    /// There is no memory for them.
    pub fn times(&self) -> Result<Vec<f64>, StepError> {
        let mut times = Vec::new();
        reserve(&mut times, self.records())?;
        let kept = (0..self.steps).step_by(self.every).chain([self.steps]);
        times.extend(kept.map(|n| self.t0 + n as f64 * self.h()));
        Ok(times)
    }
}

/// Why a run could not start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Sizes or options that do not fit together.
    #[error("{0}")]
    Invalid(String),
    /// The start itself failed.
    #[error(transparent)]
    Failed(#[from] StepError),
}

impl StartError {
    /// An error of sizes or options, as a sentence.
    pub fn invalid(sentence: impl Into<String>) -> Self {
        Self::Invalid(sentence.into())
    }
}
