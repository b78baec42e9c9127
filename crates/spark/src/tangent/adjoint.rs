//! Adjoints of steps that were recorded: a run is made again piece by piece, and each piece followed back.

use super::super::Spark;
use super::super::stages::Stages;
use super::backward::Backward;
use super::linear_step::LinearStep;
use liouville_base::error::StepError;
use liouville_base::recorder::{Recordable, StepRecord};
use liouville_problem::{Cotangents, Model, SensitivityModel, State, Step};

impl Recordable for Spark {
    fn write_unknowns(&self, _: &State, out: &mut Vec<f64>) {
        self.predictor.append_solution(out);
    }
}

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
        let mut spark = spark.clone();
        let stages = spark.own_stages();
        let linear = LinearStep::new((&spark, &stages), sensitivity, 1);
        let order = linear.places().1;
        Self {
            backward: Backward::new(&spark.model.problem, &stages.tableau, order),
            model: spark.model,
            stages,
            linear,
        }
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(
        &mut self,
        record: &StepRecord<State>,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let StepRecord { t, h, before, .. } = record;
        let step = Step {
            t: *t,
            h: *h,
            state: before,
        };
        self.stages.unknowns.put_back(&record.unknowns);
        let (model, stages) = (&mut self.model, &mut self.stages);
        (self.linear).make((model, stages), step, &record.end)?;
        (self.backward).follow(&mut self.linear, (model, stages), step, of)
    }
}
