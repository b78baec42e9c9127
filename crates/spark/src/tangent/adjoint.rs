//! Adjoints of steps that were recorded: a run is made again piece by piece, and each piece followed back.

use super::super::Spark;
use super::super::stages::{Stages, Unknowns};
use super::backward::Backward;
use super::linear_step::LinearStep;
use liouville_base::error::StepError;
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_problem::{Cotangents, Model, SensitivityModel, State, Step};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A step with the unknowns that solved its equations.
#[derive(Clone, Debug)]
pub struct StepRecord {
    t: f64,
    h: f64,
    before: State,
    /// The state that it led to.
    pub end: State,
    unknowns: Unknowns,
}

/// Recorded steps, in memory that is used again.
#[derive(Clone, Debug, Default)]
pub struct StepRecords {
    all: Vec<StepRecord>,
    count: usize,
}

impl StepRecord {
    /// Time at its end.
    pub fn time(&self) -> f64 {
        self.t + self.h
    }

    /// Its length.
    pub fn size(&self) -> f64 {
        self.h
    }
}

impl StepRecords {
    /// Forgets all steps.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The steps, in their order.
    pub fn steps(&self) -> &[StepRecord] {
        &self.all[..self.count]
    }

    /// The place of the next step.
    fn next(&mut self, like: impl FnOnce() -> StepRecord) -> &mut StepRecord {
        if self.count == self.all.len() {
            self.all.push(like());
        }
        self.count += 1;
        &mut self.all[self.count - 1]
    }
}

/// Records that a stepper shares with what follows its steps back.
#[derive(Clone, Debug, Default)]
pub struct SharedRecords(Arc<Mutex<StepRecords>>);

impl SharedRecords {
    /// The records, for as long as nothing else wants them.
    pub fn lock(&self) -> MutexGuard<'_, StepRecords> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A SPARK method at work that records its steps; they have the bits of those without.
#[derive(Clone, Debug)]
pub struct SparkRecorder {
    spark: Spark,
    records: SharedRecords,
}

impl SparkRecorder {
    /// The method, and where it records.
    pub fn new(spark: Spark, records: SharedRecords) -> Self {
        Self { spark, records }
    }
}

impl Stepper for SparkRecorder {
    type State = State;

    fn step(&mut self, t: f64, h: f64, state: &mut State) -> Result<(), StepError> {
        let mut records = self.records.lock();
        let spark = &mut self.spark;
        let record = records.next(|| StepRecord {
            t,
            h,
            before: state.clone(),
            end: state.clone(),
            unknowns: spark.stages.unknowns.clone(),
        });
        (record.t, record.h) = (t, h);
        record.before.clone_from(state);
        if let Err(error) = spark.step(t, h, state) {
            records.count -= 1;
            return Err(error);
        }
        record.end.clone_from(state);
        spark.predictor.write_solution(&mut record.unknowns);
        Ok(())
    }

    fn forget(&mut self) {
        self.spark.forget();
    }

    fn stats(&self) -> Stats {
        self.spark.stats()
    }
}

impl Symmetric for SparkRecorder {}

impl Estimating for SparkRecorder {
    fn error(&self) -> f64 {
        self.spark.error()
    }

    fn error_order(&self) -> f64 {
        self.spark.error_order()
    }

    fn undo(&mut self, state: &mut State) {
        self.spark.undo(state);
        self.records.lock().count -= 1;
    }
}

// What is recorded is made again with the steps.
liouville_base::checkpoint!(SparkRecorder { spark });

/// Follows recorded steps of a SPARK method back.
#[derive(Clone, Debug)]
pub struct SparkAdjoint {
    model: Model,
    stages: Stages,
    linear: LinearStep,
    backward: Backward,
}

impl SparkAdjoint {
    /// The adjoint of a method at work.
    pub fn new(spark: &Spark, sensitivity: SensitivityModel) -> Self {
        let (model, stages) = (spark.model.clone(), spark.stages.clone());
        let linear = LinearStep::new(spark, sensitivity, 1);
        let order = linear.places().1;
        Self {
            backward: Backward::new(&model.problem, &stages.tableau, order),
            model,
            stages,
            linear,
        }
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(&mut self, record: &StepRecord, of: &mut Cotangents) -> Result<(), StepError> {
        let StepRecord { t, h, before, .. } = record;
        let step = Step {
            t: *t,
            h: *h,
            state: before,
        };
        self.stages.unknowns.copy_from(&record.unknowns);
        let (model, stages) = (&mut self.model, &mut self.stages);
        (self.linear).make((model, stages), step, &record.end)?;
        (self.backward).follow(&mut self.linear, (model, stages), step, of)
    }
}
