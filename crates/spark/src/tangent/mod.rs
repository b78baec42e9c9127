//! Steps with their tangents: derivatives of a step's end by its start, by parameters and by time.

mod adjoint;
mod equations;
mod errors;
mod forward;
mod linear_step;
mod stage_changes;
mod step_changes;

use super::Spark;
use super::stages::Stages;
pub use adjoint::{BatchAdjoint, SparkAdjoint};
use equations::LinearEquations;
use errors::TangentErrors;
use forward::{Forward, StepAlong};
use linear_step::LinearStep;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_problem::{
    BeginTangents, Directions, LargestError, MomentumTangents, SensitivityModel, State, Step,
    TangentState,
};

/// A SPARK method at work on a state and its tangents.
///
/// A step is made first, as it is without tangents; then its equations are linearised at their solution. The derivative
/// is that of the step as it is made, with its size held unless that is among the directions.
#[derive(Clone, Debug)]
pub struct SparkTangents {
    spark: Spark,
    /// Stages of a finished step.
    stages: Stages,
    linear: LinearStep,
    equations: LinearEquations,
    forward: Forward,
    directions: Directions,
    /// The state before the step.
    before: TangentState,
    /// Of tangents in random directions: one where errors control the steps.
    errors: Vec<TangentErrors>,
}

impl Spark {
    /// Stages to linearise a finished step at.
    fn own_stages(&mut self) -> Stages {
        let tableau = &self.tableau;
        (self.model).reserve_batch(tableau.stages, tableau.intervals + 1);
        Stages::new(&self.model, tableau.clone())
    }
}

impl SparkTangents {
    /// The method with tangents of a motion from `motion` at `t`: changes of its coordinates and of its z, a row for
    /// each direction, and of `t`. Where errors control the steps these follow those of other tangents too.
    ///
    /// # Errors
    /// A derivative at the start that is not finite.
    pub fn new(
        mut spark: Spark,
        sensitivity: SensitivityModel,
        mut directions: Directions,
        (t, motion, params): (f64, State, &[f64]),
        (y, z, dt): (Matrix, Matrix, Vec<f64>),
    ) -> Result<(Self, TangentState), StepError> {
        let mut state = TangentState {
            motion,
            carried: Matrix::zeros(y.rows(), y.cols()),
            y,
            z,
            t: dt,
        };
        let mut momenta = MomentumTangents {
            model: spark.model.clone(),
            sensitivity,
        };
        momenta.begin(t, &mut directions, &mut state)?;
        let sensitivity = momenta.sensitivity;
        let stages = spark.own_stages();
        let linear = LinearStep::new((&spark.model, &spark.tableau), sensitivity);
        let errors = TangentErrors::new(&spark, &linear.sensitivity, (&state.motion, params));
        // the steps are to have the same bits whatever they are differentiated by
        let count = errors
            .as_ref()
            .map_or(directions.count(), TangentErrors::count);
        let equations = LinearEquations::new((&spark, &stages), count);
        let stepper = Self {
            errors: errors.into_iter().collect(),
            forward: Forward::new(&linear, &stages),
            stages,
            before: state.clone(),
            spark,
            linear,
            equations,
            directions,
        };
        Ok((stepper, state))
    }
}

impl SparkTangents {
    /// Makes the tangents at the end of the step that was just made.
    fn follow(&mut self, t: f64, h: f64, state: &mut TangentState) -> Result<(), StepError> {
        let (spark, before) = (&mut self.spark, &self.before);
        let step = Step {
            t,
            h,
            state: &before.motion,
        };
        let (model, stages) = (&mut spark.model, &mut self.stages);
        (spark.predictor).write_solution(&mut stages.unknowns);
        let equations = &mut self.equations;
        (self.linear).make((model, stages), (step, &state.motion), equations)?;
        for errors in &mut self.errors {
            let by = (&mut self.forward, &mut *equations);
            errors.follow(by, (&mut self.linear, model, stages), (step, &state.motion))?;
        }
        for direction in 0..self.directions.count() {
            let along = StepAlong {
                step,
                direction,
                before,
                stretch: self.directions.stretch[direction],
            };
            let directions = &mut self.directions;
            let at = (&*model, &*stages);
            let of = (&mut self.linear, &mut *equations);
            (self.forward).follow(of, at, directions, along, state)?;
        }
        Ok(())
    }

    /// The same for parts of steps, whose errors are not asked for.
    #[must_use]
    pub fn alone(&self) -> Self {
        Self {
            errors: Vec::new(),
            ..self.clone()
        }
    }

    /// The largest error, of the motion or of a tangent.
    fn largest(&self) -> LargestError {
        let of_tangents = self.errors.iter().map(|errors| errors.tangents.largest);
        LargestError::of(&self.spark, of_tangents)
    }
}

impl Stepper for SparkTangents {
    type State = TangentState;

    fn step(&mut self, t: f64, h: f64, state: &mut TangentState) -> Result<(), StepError> {
        self.before.clone_from(state);
        for errors in &mut self.errors {
            errors.begin(t, &state.motion)?;
        }
        self.spark.step(t, h, &mut state.motion)?;
        let made = self.follow(t, h, state);
        made.inspect_err(|_| {
            state.clone_from(&self.before);
            self.errors.iter_mut().for_each(TangentErrors::undo);
            self.spark.predictor.undo();
        })
    }

    fn forget(&mut self) {
        self.spark.forget();
        for errors in &mut self.errors {
            errors.forget();
        }
    }

    fn stats(&self) -> Stats {
        self.spark.stats()
    }
}

impl Symmetric for SparkTangents {}

impl Estimating for SparkTangents {
    fn error(&self) -> f64 {
        self.largest().error
    }

    fn error_order(&self) -> f64 {
        self.largest().order
    }

    fn undo(&mut self, state: &mut TangentState) {
        for errors in &mut self.errors {
            errors.undo();
        }
        self.spark.undo(&mut state.motion);
        state.clone_from(&self.before);
    }

    fn most_corrections(&self) -> f64 {
        self.spark.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.spark.insist(insists);
    }
}

// Tangents are saved with the state; other memory is rewritten in each step.
liouville_base::checkpoint!(SparkTangents {
    spark,
    equations,
    errors
});
