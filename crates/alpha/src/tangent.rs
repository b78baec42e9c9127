//! Steps of the α family with their tangents.

use super::linear_step::{LinearAlpha, carried};
use super::slopes::AlphaSlopes;
use super::start_tangents::AlphaStartTangents;
use super::state::AlphaState;
use super::tangent_errors::TangentErrors;
use super::{Alpha, begins_again};
use liouville_base::error::StepError;
use liouville_base::linalg::Matrix;
use liouville_base::method::{Estimating, Stats, Stepper};
use liouville_problem::{BeginTangents, Directions, LargestError, SensitivityModel, TangentState};

/// A method of the α family at work on a state and its tangents.
#[derive(Clone, Debug)]
pub struct AlphaTangents {
    pub(super) alpha: Alpha,
    linear: LinearAlpha,
    directions: Directions,
    /// The tangents where a motion begins.
    starts: AlphaStartTangents,
    before: TangentState<AlphaState>,
    /// The state as it was carried, where the step has begun again.
    carried: Option<TangentState<AlphaState>>,
    /// Of tangents in random directions: one where errors control the steps.
    errors: Vec<TangentErrors>,
}

impl AlphaTangents {
    /// The method with tangents of a motion from `motion` at `t`: changes of its coordinates and velocities, a row for
    /// each direction. Accelerations follow those, unless they are `given`.
    ///
    /// # Errors
    /// A derivative at the start that is not finite, or a singular matrix.
    pub fn new(
        alpha: Alpha,
        (slopes, params): (AlphaSlopes, &[f64]),
        (sensitivity, mut directions): (SensitivityModel, Directions),
        (t, motion, is_given): (f64, AlphaState, bool),
        (y, z): (Matrix, Matrix),
    ) -> Result<(Self, TangentState<AlphaState>), StepError> {
        let n = y.cols();
        let dt: Vec<f64> = (0..directions.count())
            .map(|k| directions.tau[(k, 0)])
            .collect();
        let mut state = TangentState {
            carried: Matrix::zeros(y.rows(), carried(n)),
            motion,
            y,
            z,
            t: dt,
        };
        let mut starts = AlphaStartTangents::new(&alpha, (&slopes, params), sensitivity);
        starts.begin(t, &mut directions, &mut state)?;
        if is_given {
            for direction in 0..directions.count() {
                state.carried.row_mut(direction)[..n].fill(0.0);
            }
        }
        let errors = TangentErrors::new(&alpha, starts.clone(), &state.motion, params);
        let stepper = Self {
            errors: errors.into_iter().collect(),
            starts,
            before: state.clone(),
            carried: None,
            linear: LinearAlpha::new(slopes, params),
            alpha,
            directions,
        };
        Ok((stepper, state))
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
        LargestError::of(&self.alpha, of_tangents)
    }

    /// Puts back the state that a step has begun again from.
    fn restore_carried(&mut self, state: &mut TangentState<AlphaState>) {
        if let Some(carried) = self.carried.take() {
            *state = carried;
        }
    }

    fn make(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        if self.carried.is_some() {
            self.alpha.leave_cut(t, h, &mut state.motion)?;
            self.starts.begin(t, &mut self.directions, state)?;
            for errors in &mut self.errors {
                errors.forget();
            }
        }
        self.before.clone_from(state);
        for errors in &mut self.errors {
            errors.begin(t, &state.motion)?;
        }
        self.alpha.step(t, h, &mut state.motion)?;
        let followed = self.follow(t, h, state);
        followed.inspect_err(|_| {
            state.clone_from(&self.before);
            for errors in &mut self.errors {
                errors.undo();
            }
        })
    }

    /// Makes the tangents at the end of the step that was just made.
    fn follow(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        let (linear, before) = (&mut self.linear, &self.before);
        let ends = [&before.motion, &state.motion];
        linear.make(&self.alpha, (t, h), ends)?;
        for errors in &mut self.errors {
            errors.follow((&mut self.alpha, linear), (t, h), &state.motion)?;
        }
        for direction in 0..self.directions.count() {
            let along = (&self.directions, direction);
            linear.push(&self.alpha, (t, h), along, (before, state))?;
        }
        Ok(())
    }
}

impl Stepper for AlphaTangents {
    type State = TangentState<AlphaState>;

    fn step(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        self.carried = begins_again(&state.motion, h).then(|| state.clone());
        let made = self.make(t, h, state);
        if made.is_err() {
            self.restore_carried(state);
        }
        made
    }

    fn forget(&mut self) {
        self.alpha.forget();
        for errors in &mut self.errors {
            errors.forget();
        }
    }

    fn stats(&self) -> Stats {
        self.alpha.stats()
    }
}

impl Estimating for AlphaTangents {
    fn error(&self) -> f64 {
        self.largest().error
    }

    fn error_order(&self) -> f64 {
        self.largest().order
    }

    fn undo(&mut self, state: &mut TangentState<AlphaState>) {
        for errors in &mut self.errors {
            errors.undo();
        }
        self.alpha.undo(&mut state.motion);
        state.clone_from(&self.before);
        self.restore_carried(state);
    }

    fn most_corrections(&self) -> f64 {
        self.alpha.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.alpha.insist(insists);
    }
}

// Tangents are saved with the state; other memory is rewritten in each step.
liouville_base::checkpoint!(AlphaTangents { alpha, errors });
