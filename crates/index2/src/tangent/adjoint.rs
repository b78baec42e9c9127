//! Adjoints of steps of an index-2 method that were recorded.

use super::super::Index2;
use super::super::attempt::KeptCollocation;
use super::super::stages::{CollocationStages, CollocationStep};
use super::linear_step::LinearCollocation;
use crate::semi_explicit::{SemiExplicitSensitivityModel, SemiExplicitState};
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_problem::Cotangents;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A step with the unknowns that solved its equations.
#[derive(Clone, Debug)]
pub struct Index2Record {
    t: f64,
    h: f64,
    before: SemiExplicitState,
    /// The state that it led to.
    pub end: SemiExplicitState,
    unknowns: KeptCollocation,
}

impl Index2Record {
    /// Time at its end.
    pub fn time(&self) -> f64 {
        self.t + self.h
    }
}

/// Records that a stepper shares with what follows its steps back.
#[derive(Clone, Debug, Default)]
pub struct Index2Records(Arc<Mutex<Vec<Index2Record>>>);

impl Index2Records {
    /// The records, for as long as nothing else wants them.
    pub fn lock(&self) -> MutexGuard<'_, Vec<Index2Record>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An index-2 method at work that records its steps; they have the bits of those without.
#[derive(Clone, Debug)]
pub struct Index2Recorder {
    index2: Index2,
    records: Index2Records,
}

impl Index2Recorder {
    /// The method, and where it records.
    pub fn new(index2: Index2, records: Index2Records) -> Self {
        Self { index2, records }
    }
}

impl Stepper for Index2Recorder {
    type State = SemiExplicitState;

    fn step(&mut self, t: f64, h: f64, state: &mut SemiExplicitState) -> Result<(), StepError> {
        let before = state.clone();
        self.index2.step(t, h, state)?;
        let mut unknowns = KeptCollocation::new(&self.index2.stages);
        unknowns.copy_from(&self.index2.stages);
        self.records.lock().push(Index2Record {
            t,
            h,
            before,
            end: state.clone(),
            unknowns,
        });
        Ok(())
    }

    fn forget(&mut self) {
        self.index2.forget();
    }

    fn stats(&self) -> Stats {
        self.index2.stats()
    }
}

impl Symmetric for Index2Recorder {}

impl Estimating for Index2Recorder {
    fn error(&self) -> f64 {
        self.index2.error()
    }

    fn error_order(&self) -> f64 {
        self.index2.error_order()
    }

    fn undo(&mut self, state: &mut SemiExplicitState) {
        self.index2.undo(state);
        self.records.lock().pop();
    }
}

// What is recorded is made again with the steps.
liouville_base::checkpoint!(Index2Recorder { index2 });

/// Follows recorded steps of an index-2 method back.
#[derive(Clone, Debug)]
pub struct Index2Adjoint {
    stages: CollocationStages,
    linear: LinearCollocation,
}

impl Index2Adjoint {
    /// The adjoint of a method at work.
    pub fn new(index2: &Index2, sensitivity: SemiExplicitSensitivityModel) -> Self {
        Self {
            stages: index2.stages.clone(),
            linear: LinearCollocation::new(index2, sensitivity),
        }
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(&mut self, record: &Index2Record, of: &mut Cotangents) -> Result<(), StepError> {
        let step = CollocationStep {
            t: record.t,
            h: record.h,
            state: &record.before,
        };
        record.unknowns.put_back(&mut self.stages);
        self.stages.move_points(step);
        self.linear.make(&self.stages, step)?;
        self.linear.pull(&self.stages, step, of);
        Ok(())
    }

    /// Adds cotangents (y, z) of a point.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn observe(
        &mut self,
        (t, state): (f64, &SemiExplicitState),
        row: &[f64],
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (of_y, of_z) = row.split_at(state.y.len());
        add_scaled(&mut of.y, 1.0, of_y);
        if of_z.iter().all(|x| *x == 0.0) {
            return Ok(());
        }
        self.linear.linearize_hidden(t, state)?;
        let sensitivity = &mut self.linear.sensitivity;
        sensitivity.pull(of_z, &mut of.y, &mut of.tau);
        Ok(())
    }
}
