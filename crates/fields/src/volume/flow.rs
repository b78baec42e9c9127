//! The flows of pieces, laid out for the kernels.

use super::affine::Affine;
use super::exponential::Exponential;
use super::kernel::Change;
use super::order::Order;
use super::plane::PlanePiece;
use super::rows::{PolynomialRows, narrow};
use super::triangular::Triangular;
use super::turn::Turn;
use crate::problem::{Piece, Polynomials, Split};
use liouville_gridded::Memory;
use std::slice;

/// The flow of a piece, compiled.
#[derive(Clone, Debug)]
pub(super) enum PieceFlow {
    /// x += h R
    Natural { rows: PolynomialRows },
    /// x += h g a
    Shear(Shear),
    /// x *= exp(h p)
    Scaling { rows: PolynomialRows },
    /// x *= exp(c t*)
    Exponential(Exponential),
    /// A Runge-Kutta method.
    Triangular(Triangular),
    /// x = exp(h A) x + ...
    Affine(Affine),
    /// A rotation and a push.
    Turn(Turn),
    /// Symplectic Euler, one member after another.
    Plane(PlanePiece),
}

/// One change g of several variables.
#[derive(Clone, Debug)]
pub(super) struct Shear {
    pub(super) change: PolynomialRows,
    /// Places, and a.
    pub(super) places: Vec<(u32, f64)>,
}

/// Rows that a flow changes level after level.
pub(super) struct Levels<'a> {
    pub(super) change: Change,
    rows: &'a [PolynomialRows],
    is_reversed: bool,
}

impl Levels<'_> {
    /// The levels in their order.
    #[inline]
    pub(super) fn iter(&self) -> impl Iterator<Item = &PolynomialRows> {
        let last = self.rows.len() - 1;
        let place = move |k| if self.is_reversed { last - k } else { k };
        (0..self.rows.len()).map(move |k| &self.rows[place(k)])
    }
}

impl PieceFlow {
    /// Memory of its own for the flows of a plane.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Plane(piece) => piece.memory(),
            _ => Memory::default(),
        }
    }

    /// The levels of a flow, or of its adjoint, that only changes rows.
    #[inline]
    pub(super) fn levels(&self, is_adjoint: bool) -> Option<Levels<'_>> {
        let (change, levels, is_reversed) = match self {
            Self::Natural { rows } => (Change::Add, slice::from_ref(rows), false),
            Self::Scaling { rows } => (Change::Scale, slice::from_ref(rows), false),
            Self::Triangular(piece) if piece.is_euler() => {
                (Change::Add, &piece.levels[..], !is_adjoint)
            }
            Self::Shear(_)
            | Self::Exponential(_)
            | Self::Triangular(_)
            | Self::Affine(_)
            | Self::Turn(_)
            | Self::Plane(_) => return None,
        };
        Some(Levels {
            change,
            rows: levels,
            is_reversed,
        })
    }
}

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
    pub(super) fn flow(&self, piece: &Piece) -> PieceFlow {
        match piece {
            Piece::Natural { rows, change, .. } => PieceFlow::Natural {
                rows: self.rows(change, rows),
            },
            Piece::Shear {
                places,
                direction,
                change,
                ..
            } => PieceFlow::Shear(Shear {
                change: self.compiled(change, &[(0, 0)]),
                places: self.paired(places, direction),
            }),
            Piece::Scaling { rows, rate, .. } => PieceFlow::Scaling {
                rows: self.rows(rate, rows),
            },
            Piece::Exponential {
                rows,
                rates,
                monomial,
                ..
            } => {
                let monomial = monomial.iter().map(|variable| self.place(*variable));
                PieceFlow::Exponential(Exponential::new(
                    self.paired(rows, rates),
                    monomial.collect(),
                ))
            }
            Piece::Triangular {
                order,
                change,
                a,
                b,
            } => PieceFlow::Triangular(Triangular::new(self, order, change, a, b)),
            Piece::Affine { matrix, vector } => {
                PieceFlow::Affine(Affine::new(self.order, self.split.n(), matrix, vector))
            }
            Piece::Turn {
                rows,
                change,
                is_cayley,
                ..
            } => PieceFlow::Turn(Turn::new(self, rows, change, *is_cayley)),
            Piece::Plane { plane, variables } => {
                let places = variables.iter().map(|v| self.order.place_of(*v));
                PieceFlow::Plane(PlanePiece::new(
                    plane.clone(),
                    self.number,
                    variables,
                    places,
                ))
            }
        }
    }

    /// The place of a factor: a variable, or one of the functions numbered after them.
    pub(super) fn place(&self, factor: usize) -> u32 {
        match factor.checked_sub(self.split.n()) {
            Some(q) => self.functions[q],
            None => narrow(self.order.place_of(factor)),
        }
    }

    fn paired(&self, variables: &[usize], values: &[f64]) -> Vec<(u32, f64)> {
        let places = variables.iter().map(|variable| self.place(*variable));
        places.zip(values.iter().copied()).collect()
    }

    /// Independent rows, by place.
    fn rows(&self, polynomials: &Polynomials, rows: &[usize]) -> PolynomialRows {
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
