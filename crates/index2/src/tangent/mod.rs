//! Steps of an index-2 method with their tangents, and their adjoints.

mod adjoint;
mod errors;
mod linear_step;
mod observer;
mod start;

use super::Index2;
use super::stages::CollocationStep;
use crate::semi_explicit::{SemiExplicitSensitivityModel, SemiExplicitState};
pub use adjoint::Index2Adjoint;
use errors::TangentErrors;
use linear_step::LinearCollocation;
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_problem::{Directions, LargestError, TangentState};
pub use observer::SemiExplicitTangentObserver;

/// An index-2 method at work on a state and its tangents.
///
/// A step is made first, as it is without tangents; then its equations are linearised at their solution.
#[derive(Clone, Debug)]
pub struct Index2Tangents {
    index2: Index2,
    linear: LinearCollocation,
    directions: Directions,
    before: TangentState<SemiExplicitState>,
    /// Of tangents in random directions: one where errors control the steps.
    errors: Vec<TangentErrors>,
}

impl Index2Tangents {
    /// The method with tangents of a motion from `motion` at `t`: changes of its coordinates, a row for each direction.
    ///
    /// # Errors
    /// A derivative at the start that is not finite, or a singular matrix.
    pub fn new(
        index2: Index2,
        sensitivity: SemiExplicitSensitivityModel,
        mut directions: Directions,
        (t, motion, params): (f64, SemiExplicitState, &[f64]),
        y: Matrix,
    ) -> Result<(Self, TangentState<SemiExplicitState>), StepError> {
        let mut linear = LinearCollocation::new(&index2, sensitivity);
        let dt: Vec<f64> = (0..directions.count())
            .map(|k| directions.tau[(k, 0)])
            .collect();
        let mut z = Matrix::zeros(y.rows(), motion.z.len());
        let sensitivity = &mut linear.solvers.sensitivity;
        sensitivity.linearize(&mut index2.model.clone(), t, (&motion.y, &motion.z))?;
        for (direction, dt) in dt.iter().enumerate() {
            let tau = directions.tau(direction, *dt);
            sensitivity.push(y.row(direction), tau, z.row_mut(direction));
        }
        let state = TangentState {
            motion,
            carried: Matrix::zeros(y.rows(), 0),
            y,
            z,
            t: dt,
        };
        let own = &linear.solvers.sensitivity;
        let errors = TangentErrors::new(&index2, own, (&state.motion, params));
        let stepper = Self {
            before: state.clone(),
            errors: errors.into_iter().collect(),
            index2,
            linear,
            directions,
        };
        Ok((stepper, state))
    }

    /// The largest error, of the motion or of a tangent.
    fn largest(&self) -> LargestError {
        let of_tangents = self.errors.iter().map(|errors| errors.tangents.largest);
        LargestError::of(&self.index2, of_tangents)
    }

    /// Makes the tangents at the end of the step that was just made.
    fn follow(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<SemiExplicitState>,
    ) -> Result<(), StepError> {
        let (stages, before) = (&self.index2.stages, &self.before);
        let step = CollocationStep {
            t,
            h,
            state: &before.motion,
        };
        self.linear.make(stages, step, Some(&state.motion))?;
        for errors in &mut self.errors {
            errors.follow(&mut self.linear, (t, h), &state.motion);
        }
        for direction in 0..self.directions.count() {
            let along = (&self.directions, direction);
            let LinearCollocation { map, solvers, .. } = &mut self.linear;
            let Ok(()) = map.push(solvers, along, (before, state));
        }
        Ok(())
    }
}

impl Index2Tangents {
    /// The same for parts of steps, whose errors are not asked for.
    #[must_use]
    pub fn alone(&self) -> Self {
        Self {
            errors: Vec::new(),
            ..self.clone()
        }
    }
}

impl Stepper for Index2Tangents {
    type State = TangentState<SemiExplicitState>;

    fn step(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<SemiExplicitState>,
    ) -> Result<(), StepError> {
        self.before.clone_from(state);
        for errors in &mut self.errors {
            errors.tangents.begin(t, &state.motion)?;
        }
        self.index2.step(t, h, &mut state.motion)?;
        let made = self.follow(t, h, state);
        made.inspect_err(|_| {
            state.clone_from(&self.before);
            for errors in &mut self.errors {
                errors.tangents.undo();
            }
            self.index2.predictor.undo();
        })
    }

    fn forget(&mut self) {
        self.index2.forget();
        for errors in &mut self.errors {
            errors.tangents.forget();
        }
    }

    fn stats(&self) -> Stats {
        self.index2.stats()
    }
}

impl Symmetric for Index2Tangents {}

impl Estimating for Index2Tangents {
    fn error(&self) -> f64 {
        self.largest().error
    }

    fn error_order(&self) -> f64 {
        self.largest().order
    }

    fn undo(&mut self, state: &mut TangentState<SemiExplicitState>) {
        for errors in &mut self.errors {
            errors.tangents.undo();
        }
        self.index2.undo(&mut state.motion);
        state.clone_from(&self.before);
    }
}

// Tangents are saved with the state; other memory is rewritten in each step.
liouville_base::checkpoint!(Index2Tangents { index2, errors });
