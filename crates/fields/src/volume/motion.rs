//! What the flow of each kind of piece needs, laid out for the kernels.

use super::affine::Affine;
use super::exponential::Exponential;
use super::order::Order;
use super::rows::{Rows, narrow};
use super::triangular::Triangular;
use crate::problem::{Piece, Polynomials, Split, Wave};

/// A piece, ready to be moved along.
#[derive(Clone, Debug)]
pub(super) enum Motion {
    /// x += h R
    Natural { rows: Rows, waves: Rows },
    /// x += h g a
    Shear {
        change: Rows,
        waves: Rows,
        places: Vec<(u32, f64)>,
    },
    /// x *= exp(h p)
    Scaling { rows: Rows },
    /// x *= exp(c t*)
    Exponential(Exponential),
    /// A Runge-Kutta method.
    Triangular(Triangular),
    /// x = exp(h A) x + ...
    Affine(Affine),
}

/// How the pieces of a split are laid out.
pub(super) struct Layout<'a> {
    pub(super) split: &'a Split,
    pub(super) order: &'a Order,
    /// Whether rows are joined to runs: what is stored is one trajectory.
    pub(super) in_runs: bool,
}

impl Layout<'_> {
    pub(super) fn motion(&self, piece: &Piece) -> Motion {
        match piece {
            Piece::Natural {
                rows,
                change,
                waves,
            } => Motion::Natural {
                rows: self.rows(change, rows),
                waves: self.waves(waves),
            },
            Piece::Shear {
                places,
                direction,
                change,
                waves,
            } => Motion::Shear {
                change: self.compiled(change, &[(0, 0)]),
                waves: self.waves(waves),
                places: self.paired(places, direction),
            },
            Piece::Scaling { rows, rate } => Motion::Scaling {
                rows: self.rows(rate, rows),
            },
            Piece::Exponential {
                rows,
                rates,
                monomial,
            } => {
                let monomial = monomial.iter().map(|variable| self.place(*variable));
                Motion::Exponential(Exponential::new(
                    self.paired(rows, rates),
                    monomial.collect(),
                ))
            }
            Piece::Triangular {
                order,
                change,
                a,
                b,
            } => Motion::Triangular(Triangular::new(self, order, change, a, b)),
            Piece::Affine { matrix, vector } => {
                Motion::Affine(Affine::new(self.order, self.split.n(), matrix, vector))
            }
        }
    }

    pub(super) fn place(&self, variable: usize) -> u32 {
        narrow(self.order.place_of(variable))
    }

    fn paired(&self, variables: &[usize], values: &[f64]) -> Vec<(u32, f64)> {
        let places = variables.iter().map(|variable| self.place(*variable));
        places.zip(values.iter().copied()).collect()
    }

    /// Rows whose results do not depend on one another, by place.
    fn rows(&self, polynomials: &Polynomials, rows: &[usize]) -> Rows {
        let places = rows.iter().map(|row| self.order.place_of(*row));
        let mut places: Vec<(usize, usize)> = places.enumerate().collect();
        places.sort_unstable_by_key(|(_, place)| *place);
        self.compiled(polynomials, &places)
    }

    pub(super) fn compiled(&self, polynomials: &Polynomials, rows: &[(usize, usize)]) -> Rows {
        let place_of = |variable| self.order.place_of(variable);
        Rows::new(polynomials, rows, place_of, self.in_runs)
    }

    /// The arguments of cosines, as rows behind the variables.
    fn waves(&self, waves: &[Wave]) -> Rows {
        let n = self.split.n();
        let mut rows = Rows::default();
        for (q, wave) in waves.iter().enumerate() {
            let factors = wave.places.iter().map(|variable| self.place(*variable));
            let terms = factors.zip(&wave.k).map(|(place, k)| (*k, vec![place]));
            let phase = (wave.phase, Vec::new());
            let terms: Vec<_> = std::iter::once(phase).chain(terms).collect();
            rows.push(n + q, &terms);
        }
        rows
    }
}
