//! Recorded steps: a pullback repeats the steps of a run by a stepper that keeps each of them, with the unknowns that
//! solve its equations.

use crate::error::StepError;
use crate::method::{Estimating, Stats, Stepper, Symmetric};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A method whose steps can be followed back.
pub trait Recordable: Stepper {
    /// Writes the unknowns that solve the equations of the last step, which led to this state.
    fn write_unknowns(&self, state: &Self::State, out: &mut Vec<f64>);
}

/// A step with the unknowns that solved its equations.
#[derive(Clone, Debug)]
pub struct StepRecord<S> {
    /// Time at its start.
    pub t: f64,
    /// Its length.
    pub h: f64,
    /// The state that it began with.
    pub before: S,
    /// The state that it led to.
    pub end: S,
    /// The unknowns that solve its equations.
    pub unknowns: Vec<f64>,
}

impl<S> StepRecord<S> {
    /// Time at its end.
    pub fn time(&self) -> f64 {
        self.t + self.h
    }
}

/// Recorded steps, in memory that is used again.
#[derive(Clone, Debug)]
pub struct StepRecords<S> {
    all: Vec<StepRecord<S>>,
    count: usize,
}

impl<S> StepRecords<S> {
    /// Forgets all steps.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The steps, in their order.
    pub fn steps(&self) -> &[StepRecord<S>] {
        &self.all[..self.count]
    }
}

/// Records that a stepper shares with the adjoint of its method.
#[derive(Debug)]
pub struct SharedRecords<S>(Arc<Mutex<StepRecords<S>>>);

impl<S> Clone for SharedRecords<S> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<S> Default for SharedRecords<S> {
    fn default() -> Self {
        let (all, count) = (Vec::new(), 0);
        Self(Arc::new(Mutex::new(StepRecords { all, count })))
    }
}

impl<S> SharedRecords<S> {
    /// The records, locked.
    pub fn lock(&self) -> MutexGuard<'_, StepRecords<S>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A method at work that records its steps; they have the bits of those without.
#[derive(Clone, Debug)]
pub struct Recorder<M: Stepper> {
    method: M,
    records: SharedRecords<M::State>,
}

impl<M: Stepper> Recorder<M> {
    /// The method, and where it records.
    pub fn new(method: M, records: SharedRecords<M::State>) -> Self {
        Self { method, records }
    }
}

impl<M: Recordable> Stepper for Recorder<M>
where
    M::State: Clone + Send,
{
    type State = M::State;

    fn step(&mut self, t: f64, h: f64, state: &mut M::State) -> Result<(), StepError> {
        let mut records = self.records.lock();
        let StepRecords { all, count } = &mut *records;
        if *count == all.len() {
            all.push(StepRecord {
                t,
                h,
                before: state.clone(),
                end: state.clone(),
                unknowns: Vec::new(),
            });
        }
        let record = &mut all[*count];
        (record.t, record.h) = (t, h);
        record.before.clone_from(state);
        self.method.step(t, h, state)?;
        record.end.clone_from(state);
        self.method.write_unknowns(state, &mut record.unknowns);
        *count += 1;
        Ok(())
    }

    fn forget(&mut self) {
        self.method.forget();
    }

    fn stats(&self) -> Stats {
        self.method.stats()
    }
}

impl<M: Recordable + Symmetric> Symmetric for Recorder<M> where M::State: Clone + Send {}

impl<M: Recordable + Estimating> Estimating for Recorder<M>
where
    M::State: Clone + Send,
{
    fn error(&self) -> f64 {
        self.method.error()
    }

    fn error_order(&self) -> f64 {
        self.method.error_order()
    }

    fn undo(&mut self, state: &mut M::State) {
        self.method.undo(state);
        self.records.lock().count -= 1;
    }
}

// Records are made again with the steps.
crate::checkpoint!([M: Stepper] Recorder<M> { method });
