//! The determinant of the derivative of each step.
//!
//! The columns of the derivative of a step are pushed through it as dual numbers, eight at a time. The trajectory is that
//! of a run without them, bit for bit: flows held back between steps and compensated sums are read, not changed.

use super::tangents::DualSteps;
use super::{State, UserVariables, Volume};
use crate::problem::Split;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::dual::DIRECTIONS;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::Lu;
use liouville_base::method::{Stats, Stepper};
use liouville_base::observe::Observe;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// A composition of a split, with the derivative of each of its steps.
#[derive(Clone, Debug)]
pub struct Determinant {
    volume: Volume<f64>,
    stepper: Composed<Volume<f64>>,
    /// The start of a step.
    start: State<f64>,
    x: Vec<f64>,
    duals: DualSteps,
    derivative: Lu,
}

/// A trajectory, and the determinants of its steps so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Determined {
    state: State<f64>,
    /// The variables in the order of the split, at the last [`Stepper::synchronize`].
    pub x: Vec<f64>,
    /// ln |det| of all steps together.
    pub logarithm: f64,
    /// The largest |det − 1| of a step.
    pub largest: f64,
}

impl Determinant {
    /// `split`, composed by `scheme`, with or without compensated sums.
    pub fn new(split: Arc<Split>, scheme: &Scheme, is_compensated: bool) -> Self {
        let n = split.n();
        let volume = Volume::new(Arc::clone(&split), is_compensated);
        let x = vec![0.0; n];
        Self {
            stepper: Composed::new(volume.clone(), scheme),
            start: volume.state(&x),
            volume,
            x,
            duals: DualSteps::new(split, scheme),
            derivative: Lu::new(n),
        }
    }

    /// A trajectory about to start.
    ///
    /// # Panics
    /// When there are not as many values as variables.
    pub fn state(&self, x: &[f64]) -> Determined {
        Determined {
            state: self.volume.state(x),
            x: x.to_vec(),
            logarithm: 0.0,
            largest: 0.0,
        }
    }

    /// det of the derivative of a step.
    fn determinant(&mut self, t: f64, h: f64, state: &State<f64>) -> Result<f64, StepError> {
        self.stepper.peek(state, &mut self.start)?;
        self.volume.values(&self.start, &mut self.x);
        let derivative = self.derivative.matrix_mut();
        for first in (0..self.x.len()).step_by(DIRECTIONS) {
            let identity = |i, k| if i == first + k { 1.0 } else { 0.0 };
            self.duals.push(t, h, &self.x, identity)?;
            for (i, x) in self.duals.x.iter().enumerate() {
                let columns = derivative.row_mut(i)[first..].iter_mut();
                for (column, tangent) in columns.zip(x.tangents) {
                    *column = tangent;
                }
            }
        }
        // the determinant of a derivative that is singular to roundoff is not known
        let determinant = match self.derivative.factor() {
            Ok(()) => self.derivative.determinant(),
            Err(_) => f64::NAN,
        };
        if determinant.is_finite() && determinant != 0.0 {
            return Ok(determinant);
        }
        Err(StepError::NotFinite {
            quantity: Quantity::Observable,
            index: 0,
            t,
        })
    }
}

impl Stepper for Determinant {
    type State = Determined;

    fn step(&mut self, t: f64, h: f64, state: &mut Determined) -> Result<(), StepError> {
        let determinant = self.determinant(t, h, &state.state)?;
        self.stepper.step(t, h, &mut state.state)?;
        state.logarithm += determinant.abs().ln();
        state.largest = state.largest.max((determinant - 1.0).abs());
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Determined) -> Result<(), StepError> {
        self.stepper.synchronize(&mut state.state)?;
        self.volume.values(&state.state, &mut state.x);
        Ok(())
    }

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }
}

/// Records x, ln |det| of all steps so far, and the largest |det − 1|.
impl Observe<Determined> for UserVariables {
    fn width(&self, _: &Determined) -> usize {
        self.n + 2
    }

    fn observe(&mut self, _: f64, state: &Determined, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        row.resize(start + self.n, 0.0);
        self.write(&state.x, &mut row[start..]);
        row.extend([state.logarithm, state.largest]);
        Ok(())
    }
}

liouville_base::checkpoint!(Determinant { stepper });

liouville_base::checkpoint!(Determined {
    state,
    x,
    logarithm,
    largest
});

impl Checkpoint for UserVariables {}
