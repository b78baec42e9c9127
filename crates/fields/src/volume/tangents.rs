//! Tangents: the derivatives of a trajectory along directions at its start.
//!
//! They are pushed through each step as dual numbers, eight at a time. The trajectory is that of a run without them, bit
//! for bit: flows held back between steps and compensated sums are read, not changed.

use super::{Observer, State, UserVariables, Volume};
use crate::problem::Split;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::dual::{DIRECTIONS, Dual};
use liouville_base::error::{Quantity, StepError};
use liouville_base::method::{Stats, Stepper};
use liouville_base::observe::Observe;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// A composition of a split, of dual numbers.
#[derive(Clone, Debug)]
struct DualSteps {
    volume: Volume<Dual>,
    stepper: Composed<Volume<Dual>>,
    state: State<Dual>,
    /// The variables after the last step.
    x: Vec<Dual>,
}

impl DualSteps {
    fn new(split: Arc<Split>, scheme: &Scheme) -> Self {
        let x = vec![Dual::constant(0.0); split.n()];
        let volume = Volume::new(split, false);
        Self {
            stepper: Composed::new(volume.clone(), scheme),
            state: volume.state(&x),
            volume,
            x,
        }
    }

    /// Makes a step from `start`; `seed(i, k)` is what the variable i has there of direction k of eight.
    fn push(
        &mut self,
        t: f64,
        h: f64,
        start: &[f64],
        seed: impl Fn(usize, usize) -> f64,
    ) -> Result<(), StepError> {
        for (i, (x, &start)) in self.x.iter_mut().zip(start).enumerate() {
            *x = Dual::constant(start);
            for (k, tangent) in x.tangents.iter_mut().enumerate() {
                *tangent = seed(i, k);
            }
        }
        self.volume.set(&self.x, &mut self.state);
        self.stepper.step(t, h, &mut self.state)?;
        self.stepper.synchronize(&mut self.state)?;
        self.volume.values(&self.state, &mut self.x);
        Ok(())
    }
}

/// A composition of a split, with tangents.
#[derive(Clone, Debug)]
pub struct Tangents {
    volume: Volume<f64>,
    stepper: Composed<Volume<f64>>,
    /// The start of a step, and the tangents at its end.
    start: State<f64>,
    x: Vec<f64>,
    next: Vec<f64>,
    duals: DualSteps,
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
        let volume = Volume::new(Arc::clone(&split), is_compensated);
        let x = vec![0.0; n];
        Self {
            stepper: Composed::new(volume.clone(), scheme),
            start: volume.state(&x),
            volume,
            x,
            next: vec![0.0; directions * n],
            duals: DualSteps::new(split, scheme),
        }
    }

    /// What is stepped without its tangents.
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
        for (block, next) in self.next.chunks_mut(DIRECTIONS * n).enumerate() {
            let first = block * DIRECTIONS;
            self.duals.push(t, h, &self.x, |i, k| seed(first + k, i))?;
            for (k, row) in next.chunks_mut(n).enumerate() {
                for (tangent, x) in row.iter_mut().zip(&self.duals.x) {
                    *tangent = x.tangents[k];
                }
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

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }
}

/// Records of a trajectory, and its tangents behind them in the variables of the user.
#[derive(Clone, Debug)]
pub struct TangentObserver {
    plain: Observer<f64>,
    variables: UserVariables,
    /// The variables of the split.
    n: usize,
    /// The quantities that the plain observer has beside states.
    observed: usize,
}

impl TangentObserver {
    /// Behind the records of `plain`, which has so many quantities beside states, and `n` variables of the split.
    pub fn new(plain: Observer<f64>, variables: UserVariables, n: usize, observed: usize) -> Self {
        Self {
            plain,
            variables,
            n,
            observed,
        }
    }
}

impl Observe<Tangential> for TangentObserver {
    fn width(&self, state: &Tangential) -> usize {
        self.plain.width(&state.state) + state.tangents.len() / self.n * self.variables.n
    }

    fn observe(&mut self, t: f64, state: &Tangential, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        self.plain.observe(t, &state.state, row)?;
        let first = row.len();
        for tangent in state.tangents.chunks(self.n) {
            let end = row.len();
            row.resize(end + self.variables.n, 0.0);
            self.variables.write(tangent, &mut row[end..]);
        }
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

impl Checkpoint for TangentObserver {}
