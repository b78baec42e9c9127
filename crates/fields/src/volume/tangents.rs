//! Tangents: the derivatives of a trajectory along directions at its start.
//!
//! They are taken through each step flow by flow. The trajectory is that of a run without them, bit for bit: flows held
//! back between steps and compensated sums are read, not changed.

use super::{LinearSteps, Observer, State, UserVariables, Volume};
use crate::problem::Split;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::error::{Quantity, StepError};
use liouville_base::method::{Stats, Stepper};
use liouville_base::observe::Observe;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// A composition of a split, with tangents.
#[derive(Clone, Debug)]
pub struct Tangents {
    volume: Volume<f64>,
    stepper: Composed<Volume<f64>>,
    /// The start of a step, and the tangents at its end.
    start: State<f64>,
    x: Vec<f64>,
    next: Vec<f64>,
    steps: LinearSteps,
    /// The directions as the derivative of a step takes them, and in coefficients and the step size, row by row.
    y: Vec<f64>,
    constants: Vec<f64>,
}

/// A trajectory and its tangents.
#[derive(Clone, Debug, PartialEq)]
pub struct Tangential {
    state: State<f64>,
    /// Rows in the order of the variables of the split, one for each direction.
    pub tangents: Vec<f64>,
}

impl Tangents {
    /// Of `directions`, which follow `split`, composed by `scheme`, with or without compensated sums.
    pub fn new(
        split: Arc<Split>,
        scheme: &Scheme,
        is_compensated: bool,
        directions: usize,
    ) -> Self {
        let n = split.n();
        let steps = LinearSteps::new(&split, scheme, false);
        let volume = Volume::new(split, is_compensated);
        let x = vec![0.0; n];
        Self {
            stepper: Composed::new(volume.clone(), scheme),
            start: volume.state(&x),
            volume,
            x,
            next: vec![0.0; directions * n],
            steps,
            y: Vec::new(),
            constants: Vec::new(),
        }
    }

    /// The same for parts of steps that end at held times: along a direction the time of the start of the run changes by
    /// `starts`, and with it and the step size that of the start of each part.
    #[must_use]
    pub fn to_held_times(self, (t0, h): (f64, f64), starts: &[f64]) -> PartTangents {
        let width = self.steps.constants().len().max(1);
        let rows = self.constants.chunks(width);
        let stretches = rows.map(|row| row.last().map_or(0.0, |change| change / h));
        PartTangents {
            t0,
            stretches: stretches.collect(),
            starts: starts.to_vec(),
            tangents: self,
        }
    }

    /// The same with changes of coefficients and of the step size, row by row; without, there are none.
    #[must_use]
    pub fn with_constants(mut self, scheme: &Scheme, constants: &[f64]) -> Self {
        if !constants.is_empty() {
            self.steps = LinearSteps::new(&self.volume.split, scheme, true);
            self.constants = constants.to_vec();
        }
        self
    }

    /// The method without tangents.
    pub fn volume(&self) -> &Volume<f64> {
        &self.volume
    }

    /// A trajectory about to start, and directions there, row by row.
    ///
    /// # Panics
    /// When there are not as many values as variables, or as many directions as were said.
    pub fn state(&self, x: &[f64], directions: &[f64]) -> Tangential {
        assert_eq!(directions.len(), self.next.len(), "values of directions");
        Tangential {
            state: self.volume.state(x),
            tangents: directions.to_vec(),
        }
    }
}

impl Tangents {
    /// Makes the tangents at the end of a step, [`Self::next`]; `seed(direction, variable)` are those at its start.
    pub(super) fn push(
        &mut self,
        t: f64,
        h: f64,
        state: &State<f64>,
        seed: impl Fn(usize, usize) -> f64,
    ) -> Result<(), StepError> {
        self.stepper.peek(state, &mut self.start)?;
        self.volume.values(&self.start, &mut self.x);
        let n = self.x.len();
        let width = self.next.len() / n;
        let y = &mut self.y;
        y.clear();
        y.resize(self.steps.width() * width, 0.0);
        for direction in 0..width {
            for i in 0..n {
                y[i * width + direction] = seed(direction, i);
            }
        }
        let constants = self.steps.constants();
        for (direction, row) in self.constants.chunks(constants.len().max(1)).enumerate() {
            for (place, change) in constants.clone().zip(row) {
                y[place * width + direction] = *change;
            }
        }
        self.steps.push((t, h), &self.x, width, y)?;
        for (direction, row) in self.next.chunks_mut(n).enumerate() {
            for (i, tangent) in row.iter_mut().enumerate() {
                *tangent = y[i * width + direction];
            }
        }
        Ok(())
    }

    /// The tangents at the end of a step, row by row.
    pub(super) fn next(&self) -> &[f64] {
        &self.next
    }

    /// Makes a step without its tangents.
    pub(super) fn step_alone(
        &mut self,
        t: f64,
        h: f64,
        state: &mut State<f64>,
    ) -> Result<(), StepError> {
        self.stepper.step(t, h, state)
    }

    /// Brings a trajectory to the end of its last step.
    pub(super) fn synchronize_alone(&mut self, state: &mut State<f64>) -> Result<(), StepError> {
        self.stepper.synchronize(state)
    }
}

/// Parts of steps with tangents, from ends of steps to times that are held.
#[derive(Clone, Debug)]
pub struct PartTangents {
    tangents: Tangents,
    /// The start of the run; along each direction its change, and by which part of themselves steps become longer.
    t0: f64,
    starts: Vec<f64>,
    stretches: Vec<f64>,
}

impl Stepper for PartTangents {
    type State = Tangential;

    fn step(&mut self, t: f64, h: f64, state: &mut Tangential) -> Result<(), StepError> {
        let width = self.tangents.steps.constants().len().max(1);
        let rows = self.tangents.constants.chunks_mut(width);
        let moves = self.starts.iter().zip(&self.stretches);
        for (row, (start, stretch)) in rows.zip(moves) {
            if let Some(change) = row.last_mut() {
                *change = -(start + stretch * (t - self.t0));
            }
        }
        self.tangents.step(t, h, state)
    }

    fn synchronize(&mut self, state: &mut Tangential) -> Result<(), StepError> {
        self.tangents.synchronize(state)
    }

    fn forget(&mut self) {
        self.tangents.forget();
    }

    fn stats(&self) -> Stats {
        self.tangents.stats()
    }
}

impl Stepper for Tangents {
    type State = Tangential;

    fn step(&mut self, t: f64, h: f64, state: &mut Tangential) -> Result<(), StepError> {
        let n = self.x.len();
        let tangents = &state.tangents;
        let seed = |direction, i| tangents.get(direction * n + i).copied().unwrap_or(0.0);
        self.push(t, h, &state.state, seed)?;
        self.step_alone(t, h, &mut state.state)?;
        state.tangents.copy_from_slice(&self.next);
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Tangential) -> Result<(), StepError> {
        self.synchronize_alone(&mut state.state)
    }

    fn forget(&mut self) {
        self.stepper.forget();
    }

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }
}

/// Records of a trajectory, and its tangents behind them in the variables of the user.
#[derive(Clone, Debug)]
pub struct TangentObserver {
    plain: Observer<f64>,
    rows: TangentRows,
    /// The quantities that the plain observer has beside states.
    observed: usize,
}

/// The tangents of a trajectory in the variables of the user.
#[derive(Clone, Debug)]
pub struct TangentRows {
    /// The variables of the user, and how many a split has.
    pub variables: UserVariables,
    /// The variables of the split.
    pub n: usize,
}

/// Records of a trajectory without its tangents.
#[derive(Clone, Debug)]
pub struct WithoutTangents(pub Observer<f64>);

impl Observe<Tangential> for WithoutTangents {
    fn width(&self, state: &Tangential) -> usize {
        self.0.width(&state.state)
    }

    fn observe(&mut self, t: f64, state: &Tangential, row: &mut Vec<f64>) -> Result<(), StepError> {
        self.0.observe(t, &state.state, row)
    }
}

impl Observe<Tangential> for TangentRows {
    fn width(&self, state: &Tangential) -> usize {
        state.tangents.len() / self.n * self.variables.n
    }

    fn observe(&mut self, _: f64, state: &Tangential, row: &mut Vec<f64>) -> Result<(), StepError> {
        for tangent in state.tangents.chunks(self.n) {
            let end = row.len();
            row.resize(end + self.variables.n, 0.0);
            self.variables.write(tangent, &mut row[end..]);
        }
        Ok(())
    }
}

impl TangentObserver {
    /// Behind the records of `plain`, which has so many quantities beside states.
    pub fn new(plain: Observer<f64>, rows: TangentRows, observed: usize) -> Self {
        Self {
            plain,
            rows,
            observed,
        }
    }
}

impl Observe<Tangential> for TangentObserver {
    fn width(&self, state: &Tangential) -> usize {
        self.plain.width(&state.state) + self.rows.width(state)
    }

    fn observe(&mut self, t: f64, state: &Tangential, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.plain.observe(t, &state.state, row)?;
        let first = row.len();
        self.rows.observe(t, state, row)?;
        let bad = row[first..].iter().position(|value| !value.is_finite());
        let Some(place) = bad else { return Ok(()) };
        row.truncate(start);
        Err(StepError::NotFinite {
            quantity: Quantity::Observable,
            index: self.observed + place,
            t,
        })
    }
}

liouville_base::checkpoint!(Tangents { stepper });

liouville_base::checkpoint!(Tangential { state, tangents });

liouville_base::checkpoint!(PartTangents { tangents });

impl Checkpoint for TangentObserver {}

impl Checkpoint for TangentRows {}

impl Checkpoint for WithoutTangents {}
