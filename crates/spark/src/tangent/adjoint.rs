//! Adjoints of steps that were recorded: a run is made again piece by piece, and each piece followed back.

use super::super::Spark;
use super::super::full_newton::FullMatrix;
use super::super::lanes::SparkBatch;
use super::super::stages::Stages;
use super::SparkTangents;
use super::equations::{LinearEquations, StepMatrix, is_small};
use super::linear_step::LinearStep;
use super::step_changes::StepChanges;
use liouville_base::error::StepError;
use liouville_base::linalg::copy;
use liouville_base::real::Real;
use liouville_base::recorder::{Recordable, StepRecord};
use liouville_problem::{
    Cotangents, MemberLanes, Model, SensitivityModel, State, Step, TangentState,
};
use std::mem::swap;

impl Recordable for Spark {
    fn write_unknowns(&self, _: &State, out: &mut Vec<f64>) {
        self.predictor.append_solution(out);
    }
}

impl Recordable for SparkTangents {
    fn write_unknowns(&self, state: &TangentState, out: &mut Vec<f64>) {
        self.spark.write_unknowns(&state.motion, out);
    }
}

impl Recordable for SparkBatch {
    fn write_unknowns(&self, _: &State<MemberLanes>, out: &mut Vec<f64>) {
        self.predictor.append_solution(out);
    }
}

/// Follows recorded steps back.
#[derive(Clone, Debug)]
struct Adjoint<R, E> {
    model: Model<R>,
    stages: Stages<R>,
    linear: LinearStep<R>,
    matrix: E,
    changes: StepChanges<R>,
}

impl<R: Real, E: StepMatrix<R>> Adjoint<R, E> {
    fn new(
        (model, stages): (Model<R>, Stages<R>),
        sensitivity: SensitivityModel<R>,
        matrix: E,
    ) -> Self {
        let linear = LinearStep::new((&model, &stages.tableau), sensitivity);
        Self {
            changes: StepChanges::new(&linear, &stages),
            model,
            stages,
            linear,
            matrix,
        }
    }

    fn follow(
        &mut self,
        record: &StepRecord<State<R>>,
        of: &mut Cotangents<R>,
    ) -> Result<(), StepError> {
        let StepRecord { t, h, before, .. } = record;
        let step = Step {
            t: *t,
            h: *h,
            state: before,
        };
        self.stages.unknowns.put_back(&record.unknowns);
        let (model, stages) = (&mut self.model, &mut self.stages);
        let (linear, matrix) = (&mut self.linear, &mut self.matrix);
        linear.make((model, stages), (step, &record.end), matrix)?;
        let changes = &mut self.changes;
        changes.right.fill(R::splat(0.0));
        (changes.clock.t1, changes.clock.stretch) = (of.tau[0], of.stretch);
        copy(&mut changes.end.y, &of.y);
        copy(&mut changes.end.p, &of.carried);
        copy(&mut changes.right[changes.momentum.clone()], &of.z);
        swap(&mut changes.clock.tau, &mut of.tau);
        changes.pass::<true>((linear, matrix), (model, stages), step.h)?;
        swap(&mut changes.clock.tau, &mut of.tau);
        (of.tau[0], of.stretch) = (changes.clock.t0, changes.clock.stretch);
        copy(&mut of.y, &changes.start.y);
        copy(&mut of.carried, &changes.start.p);
        of.z.fill(R::splat(0.0));
        Ok(())
    }
}

/// Follows recorded steps of a SPARK method back.
#[derive(Clone, Debug)]
pub struct SparkAdjoint(Adjoint<f64, LinearEquations>);

impl SparkAdjoint {
    /// The adjoint of a method at work.
    pub fn new(spark: &Spark, sensitivity: SensitivityModel) -> Self {
        let mut spark = spark.clone();
        let stages = spark.own_stages();
        let equations = LinearEquations::new((&spark, &stages), 1);
        Self(Adjoint::new((spark.model, stages), sensitivity, equations))
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
        self.0.follow(record, of)
    }
}

/// Follows recorded steps of several members in lock-step back, each with the bits it has alone.
#[derive(Clone, Debug)]
pub struct BatchAdjoint(Adjoint<MemberLanes, FullMatrix<MemberLanes>>);

impl BatchAdjoint {
    /// The adjoint of a method at work; `None` where the equations of a step are so large that members differ in how
    /// these are solved.
    pub fn new(spark: &SparkBatch, sensitivity: SensitivityModel<MemberLanes>) -> Option<Self> {
        let (model, tableau) = (spark.model.clone(), spark.stages.tableau.clone());
        if !is_small(&model.problem, &tableau) {
            return None;
        }
        let matrix = FullMatrix::new(&model, &tableau);
        let stages = Stages::new(&model, tableau);
        Some(Self(Adjoint::new((model, stages), sensitivity, matrix)))
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix, of any member.
    pub fn follow(
        &mut self,
        record: &StepRecord<State<MemberLanes>>,
        of: &mut Cotangents<MemberLanes>,
    ) -> Result<(), StepError> {
        self.0.follow(record, of)
    }
}
