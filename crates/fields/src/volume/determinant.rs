//! The determinant of the derivative of each step.
//!
//! The derivative of a step has the tangents along all variables, which [`Tangents`] makes, as its columns.

use super::{State, Tangents, UserVariables};
use crate::problem::Split;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::Lu;
use liouville_base::method::{Stats, Stepper};
use liouville_base::observe::Observe;
use liouville_base::tableau::Scheme;
use std::sync::Arc;

/// A composition of a split, with the derivative of each of its steps.
#[derive(Clone, Debug)]
pub struct Determinant {
    /// Along all variables.
    tangents: Tangents,
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
        Self {
            tangents: Tangents::new(split, scheme, is_compensated, n),
            derivative: Lu::new(n),
        }
    }

    /// A trajectory about to start.
    ///
    /// # Panics
    /// When there are not as many values as variables.
    pub fn state(&self, x: &[f64]) -> Determined {
        Determined {
            state: self.tangents.volume().state(x),
            x: x.to_vec(),
            logarithm: 0.0,
            largest: 0.0,
        }
    }

    /// det of the derivative of a step.
    fn determinant(&mut self, t: f64, h: f64, state: &State<f64>) -> Result<f64, StepError> {
        let identity = |direction, i| if direction == i { 1.0 } else { 0.0 };
        self.tangents.push(t, h, state, identity)?;
        let n = self.tangents.volume().split().n();
        let derivative = self.derivative.matrix_mut();
        for (k, tangent) in self.tangents.next().chunks(n).enumerate() {
            for (i, entry) in tangent.iter().enumerate() {
                derivative.row_mut(i)[k] = *entry;
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
        self.tangents.step_alone(t, h, &mut state.state)?;
        state.logarithm += determinant.abs().ln();
        state.largest = state.largest.max((determinant - 1.0).abs());
        Ok(())
    }

    fn synchronize(&mut self, state: &mut Determined) -> Result<(), StepError> {
        self.tangents.synchronize_alone(&mut state.state)?;
        self.tangents.volume().values(&state.state, &mut state.x);
        Ok(())
    }

    fn stats(&self) -> Stats {
        self.tangents.stats()
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

liouville_base::checkpoint!(Determinant { tangents });

liouville_base::checkpoint!(Determined {
    state,
    x,
    logarithm,
    largest
});

impl Checkpoint for UserVariables {}
