//! Volume-preserving steps of split polynomial fields: the flow of each piece, with det = 1.
//!
//! Source: quispel1995, mclachlan2002.

mod observe;
mod section;

pub use observe::{Observer, Seen};
pub use section::{Direction, Plane, Section};

use crate::problem::polynomial::{Piece, Polynomials, Split, Wave};
use crate::real::Scalar;
use crate::trouble::Trouble;
use std::sync::Arc;

/// Where the variables are.
#[derive(Clone, Debug, PartialEq)]
pub struct State<S> {
    /// The variables, in the order of the stepper.
    x: Vec<S>,
    /// What they have lost to rounding, where that is kept.
    low: Vec<S>,
}

/// The flows of a split field's pieces, for one trajectory or several in lock-step.
#[derive(Clone, Debug)]
pub struct Volume<S> {
    split: Arc<Split>,
    is_compensated: bool,
    /// What is about to be added to the variables of a piece.
    change: Vec<S>,
    kept: Option<State<S>>,
}

/// States above this size are not copied before each step.
const LARGEST_KEPT: usize = 1 << 14;

impl<S: Scalar> Volume<S> {
    /// The flows of the pieces of `split`, with or without compensated sums.
    pub fn new(split: Arc<Split>, is_compensated: bool) -> Self {
        let change = vec![S::splat(0.0); split.n()];
        Self {
            split,
            is_compensated,
            change,
            kept: None,
        }
    }

    /// What is split.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The state at these values of the variables.
    ///
    /// # Panics
    /// When there are not as many as variables.
    pub fn state(&self, x: &[S]) -> State<S> {
        assert_eq!(x.len(), self.split.n(), "size of a state");
        let low = if self.is_compensated { x.len() } else { 0 };
        State {
            x: x.to_vec(),
            low: vec![S::splat(0.0); low],
        }
    }

    /// Writes the values of the variables, in the order of the split.
    ///
    /// # Panics
    /// When there are not as many places as variables.
    pub fn values(&self, state: &State<S>, x: &mut [S]) {
        x.copy_from_slice(&state.x);
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.split.pieces().len()
    }

    /// Whether the flow of a piece is exact.
    pub fn is_exact(&self, part: usize) -> bool {
        !matches!(self.split.pieces()[part], Piece::Triangular { .. })
    }

    /// Moves `state` along a piece, or by the adjoint of its method.
    ///
    /// # Errors
    /// An exponential piece has no flow as long as this.
    pub fn flow(
        &mut self,
        part: usize,
        _is_adjoint: bool,
        t: f64,
        h: f64,
        state: &mut State<S>,
    ) -> Result<(), Trouble> {
        let split = Arc::clone(&self.split);
        match &split.pieces()[part] {
            Piece::Natural {
                rows,
                change,
                waves,
            } => {
                for row in 0..rows.len() {
                    self.change[row] = value(change, row, waves, &state.x);
                }
                for (&row, &change) in rows.iter().zip(&self.change) {
                    state.x[row] = state.x[row] + change.scaled(h);
                }
            }
            Piece::Exponential {
                rows,
                rates,
                monomial,
            } => {
                let m = monomial
                    .iter()
                    .fold(S::splat(1.0), |m, place| m * state.x[*place]);
                let power = |row: &usize| monomial.iter().filter(|place| *place == row).count();
                let alpha: f64 = rows
                    .iter()
                    .zip(rates)
                    .map(|(row, rate)| rate * power(row) as f64)
                    .sum();
                let z = m.scaled(alpha * h);
                #[allow(clippy::neg_cmp_op_on_partial_ord)] // NaN is refused too
                if z.any(|z| !(z < 1.0)) {
                    return Err(Trouble::Singular {
                        piece: part,
                        member: 0,
                        t,
                    });
                }
                let time = if alpha == 0.0 {
                    m.scaled(h)
                } else {
                    (-z).ln_1p().scaled(-1.0 / alpha)
                };
                for (&row, &rate) in rows.iter().zip(rates) {
                    state.x[row] = state.x[row] * time.scaled(rate).exp();
                }
            }
            _ => todo!("the kernels"),
        }
        Ok(())
    }

    /// Refuses a state that is not finite.
    ///
    /// # Errors
    /// The first variable that is not finite, and in which trajectory.
    pub fn check(&self, t: f64, state: &State<S>) -> Result<(), Trouble> {
        let is_bad = |x: f64| !x.is_finite();
        match state.x.iter().position(|x| x.any(is_bad)) {
            None => Ok(()),
            Some(index) => {
                let mut members = 0..S::MEMBERS;
                let member = members.find(|member| is_bad(state.x[index].member(*member)));
                Err(Trouble::Overflow {
                    index,
                    member: member.unwrap_or(0),
                    t,
                })
            }
        }
    }

    /// Keeps a copy of the state, or says that it is too large for that.
    pub fn keep(&mut self, state: &State<S>) -> bool {
        if state.x.len() > LARGEST_KEPT {
            return false;
        }
        match &mut self.kept {
            Some(kept) => kept.clone_from(state),
            none => *none = Some(state.clone()),
        }
        true
    }

    /// Puts back what was kept last.
    pub fn restore(&mut self, state: &mut State<S>) {
        if let Some(kept) = &self.kept {
            state.clone_from(kept);
        }
    }
}

/// The value of a polynomial, term by term.
fn value<S: Scalar>(polynomials: &Polynomials, row: usize, waves: &[Wave], x: &[S]) -> S {
    let factor = |factor: &u32| match waves.get((*factor as usize).wrapping_sub(x.len())) {
        None => x[*factor as usize],
        Some(wave) => {
            let places = wave.places.iter().zip(&wave.k);
            let start = S::splat(wave.phase);
            places
                .fold(start, |sum, (place, k)| sum + x[*place].scaled(*k))
                .cos()
        }
    };
    polynomials
        .row(row)
        .fold(S::splat(0.0), |sum, (coefficient, factors)| {
            let start = S::splat(coefficient);
            sum + factors
                .iter()
                .fold(start, |term, index| term * factor(index))
        })
}
