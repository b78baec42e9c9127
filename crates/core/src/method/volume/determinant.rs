//! How far the determinant of each step is from one.
//!
//! The columns of the derivative of a step are pushed through it as dual numbers, eight at a time.

use super::{Seen, State, Volume};
use crate::dual::{DIRECTIONS, Dual};
use crate::linalg::Lu;
use crate::method::{Composed, Stats, Stepper};
use crate::problem::Observe;
use crate::problem::polynomial::Split;
use crate::tableau::Scheme;
use crate::trouble::{Quantity, Trouble};
use std::sync::Arc;

/// A composition of a split, with the derivative of each of its steps.
#[derive(Clone, Debug)]
pub struct Determinant {
    volume: Volume<Dual>,
    stepper: Composed<Volume<Dual>>,
    dual: State<Dual>,
    x: Vec<Dual>,
    derivative: Lu,
}

/// Where a trajectory is, and the determinants of its steps so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Determined {
    /// The variables, in the order of the split.
    pub x: Vec<f64>,
    /// ln |det| of all steps together.
    pub logarithm: f64,
    /// The largest |det − 1| of a step.
    pub largest: f64,
}

impl Determined {
    /// A trajectory about to start.
    pub fn new(x: &[f64]) -> Self {
        Self {
            x: x.to_vec(),
            logarithm: 0.0,
            largest: 0.0,
        }
    }
}

impl Determinant {
    /// `split`, composed by `scheme`.
    pub fn new(split: Arc<Split>, scheme: &Scheme) -> Self {
        let n = split.n();
        let volume = Volume::new(split, false);
        let x = vec![Dual::constant(0.0); n];
        Self {
            stepper: Composed::new(volume.clone(), scheme),
            dual: volume.state(&x),
            volume,
            x,
            derivative: Lu::new(n),
        }
    }

    /// Makes a step with the columns of the derivative from `first` on.
    fn push(&mut self, first: usize, t: f64, h: f64, start: &[f64]) -> Result<(), Trouble> {
        for (i, (x, &start)) in self.x.iter_mut().zip(start).enumerate() {
            *x = Dual::constant(start);
            if (first..first + DIRECTIONS).contains(&i) {
                x.tangents[i - first] = 1.0;
            }
        }
        self.volume.set(&self.x, &mut self.dual);
        self.stepper.step(t, h, &mut self.dual)?;
        self.stepper.settle(&mut self.dual)?;
        self.volume.values(&self.dual, &mut self.x);
        let matrix = self.derivative.matrix_mut();
        for (i, x) in self.x.iter().enumerate() {
            for (column, tangent) in matrix.row_mut(i)[first..].iter_mut().zip(x.tangents) {
                *column = tangent;
            }
        }
        Ok(())
    }
}

impl Stepper for Determinant {
    type State = Determined;

    fn step(&mut self, t: f64, h: f64, state: &mut Determined) -> Result<(), Trouble> {
        for first in (0..state.x.len()).step_by(DIRECTIONS) {
            self.push(first, t, h, &state.x)?;
        }
        // a singular derivative has no volume
        let determinant = match self.derivative.factor() {
            Ok(()) => self.derivative.determinant(),
            Err(_) => 0.0,
        };
        for (x, dual) in state.x.iter_mut().zip(&self.x) {
            *x = dual.value;
        }
        state.logarithm += determinant.abs().ln();
        state.largest = state.largest.max((determinant - 1.0).abs());
        Ok(())
    }

    fn stats(&self) -> Stats {
        self.stepper.stats()
    }
}

/// Records x, ln |det| of all steps so far, and the largest |det − 1|.
impl Observe<Determined> for Seen {
    fn width(&self, _: &Determined) -> usize {
        self.n + 2
    }

    fn observe(&mut self, t: f64, state: &Determined, row: &mut Vec<f64>) -> Result<(), Trouble> {
        let found = [state.logarithm, state.largest];
        if let Some(index) = found.iter().position(|value| !value.is_finite()) {
            let quantity = Quantity::Observable;
            return Err(Trouble::NotFinite { quantity, index, t });
        }
        let start = row.len();
        row.resize(start + self.n, 0.0);
        self.write(&state.x, &mut row[start..]);
        row.extend(found);
        Ok(())
    }
}
