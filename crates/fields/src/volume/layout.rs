//! The places that the flows of a piece read and change.

use super::order::Order;
use super::rows::{PolynomialRows, narrow};
use crate::problem::{Polynomials, Split};

/// The layout of the pieces of a split.
pub(super) struct SplitLayout<'a> {
    pub(super) split: &'a Split,
    pub(super) order: &'a Order,
    /// The places of the piece's functions.
    pub(super) functions: &'a [u32],
    /// The number of the piece.
    pub(super) number: usize,
    /// Whether rows are joined to runs, which is for states of one trajectory.
    pub(super) in_runs: bool,
}

impl SplitLayout<'_> {
    /// The place of a factor: a variable, or one of the functions numbered after them.
    pub(super) fn place(&self, factor: usize) -> u32 {
        match factor.checked_sub(self.split.n()) {
            Some(q) => self.functions[q],
            None => narrow(self.order.place_of(factor)),
        }
    }

    pub(super) fn paired(&self, variables: &[usize], values: &[f64]) -> Vec<(u32, f64)> {
        let places = variables.iter().map(|variable| self.place(*variable));
        places.zip(values.iter().copied()).collect()
    }

    /// Independent rows, by place.
    pub(super) fn rows(&self, polynomials: &Polynomials, rows: &[usize]) -> PolynomialRows {
        let places = rows.iter().map(|row| self.order.place_of(*row));
        let mut places: Vec<(usize, usize)> = places.enumerate().collect();
        places.sort_unstable_by_key(|(_, place)| *place);
        self.compiled(polynomials, &places)
    }

    pub(super) fn compiled(
        &self,
        polynomials: &Polynomials,
        rows: &[(usize, usize)],
    ) -> PolynomialRows {
        let place_of = |factor| self.place(factor);
        PolynomialRows::new(polynomials, rows, place_of, self.in_runs)
    }
}
