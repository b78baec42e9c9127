//! The flows of pieces, laid out for the kernels.

use super::affine::Affine;
use super::exponential::Exponential;
use super::layout::SplitLayout;
use super::plane::PlanePiece;
use super::rows::PolynomialRows;
use super::triangular::Triangular;
use super::turn::Turn;
use crate::problem::Piece;
use liouville_base::simd::Stored;
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
    /// Symplectic Euler, a group of members after another.
    Plane(PlanePiece),
}

/// One change g of several variables.
#[derive(Clone, Debug)]
pub(super) struct Shear {
    pub(super) change: PolynomialRows,
    /// Places, and a.
    pub(super) places: Vec<(u32, f64)>,
}

/// The use of the value of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// x += h R
    Add,
    /// x *= exp(h p)
    Scale,
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
    /// Lays a piece out.
    pub(super) fn new(layout: &SplitLayout<'_>, piece: &Piece) -> Self {
        match piece {
            Piece::Natural { rows, change, .. } => Self::Natural {
                rows: layout.rows(change, rows),
            },
            Piece::Shear {
                places,
                direction,
                change,
                ..
            } => Self::Shear(Shear {
                change: layout.compiled(change, &[(0, 0)]),
                places: layout.paired(places, direction),
            }),
            Piece::Scaling { rows, rate, .. } => Self::Scaling {
                rows: layout.rows(rate, rows),
            },
            Piece::Exponential {
                rows,
                rates,
                monomial,
                ..
            } => {
                let monomial = monomial.iter().map(|variable| layout.place(*variable));
                Self::Exponential(Exponential::new(
                    layout.paired(rows, rates),
                    monomial.collect(),
                ))
            }
            Piece::Triangular {
                order,
                change,
                a,
                b,
            } => Self::Triangular(Triangular::new(layout, order, change, a, b)),
            Piece::Affine { matrix, vector } => {
                Self::Affine(Affine::new(layout.order, layout.split.n(), matrix, vector))
            }
            Piece::Turn {
                rows,
                change,
                is_cayley,
                ..
            } => Self::Turn(Turn::new(layout, rows, change, *is_cayley)),
            Piece::Plane { plane, variables } => {
                let places = variables.iter().map(|v| layout.order.place_of(*v));
                Self::Plane(PlanePiece::new(
                    plane.clone(),
                    layout.number,
                    variables,
                    places,
                ))
            }
        }
    }

    /// Memory of its own for the flows of a plane.
    pub(super) fn memory<S: Stored>(&self) -> Vec<Memory<S::Group>> {
        match self {
            Self::Plane(piece) => piece.memory::<S>(),
            _ => Vec::new(),
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
