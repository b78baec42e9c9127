//! Divergence-free polynomial fields as sums of pieces whose flows preserve volume.
//!
//!     x' = f(x) = Σ pieces,   ∂f_1/∂x_1 + … + ∂f_n/∂x_n = 0
//!
//! Each [`Piece`] is divergence-free, and has an explicit flow or an explicit method with a unit determinant. The checks
//! here are of each piece; the front end has made the pieces so that their sum is the field.

mod check;
mod split;
mod terms;

pub use split::{Formula, Function, Piece, Split};
pub use terms::Polynomials;

/// The defect of a polynomial, a piece or a split.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum Malformed {
    #[error("piece {piece}: {defect}")]
    Piece {
        piece: usize,
        defect: Box<Malformed>,
    },
    #[error("{name} has size {found}, wanted {wanted}")]
    Size {
        name: &'static str,
        found: usize,
        wanted: usize,
    },
    #[error("{name} {index} is not finite")]
    NotFinite { name: &'static str, index: usize },
    #[error("term {term}: there is no row {row} among {rows}")]
    Row {
        term: usize,
        row: usize,
        rows: usize,
    },
    #[error("term {term}: there is no factor {factor} among {variables} variables")]
    Factor {
        term: usize,
        factor: i64,
        variables: usize,
    },
    #[error("there is no variable {variable} among {n}")]
    Variable { variable: usize, n: usize },
    #[error("variable {variable} is named twice")]
    Repeated { variable: usize },
    #[error("the rate of variable {row} contains variable {variable}, which the piece changes")]
    Coupled { row: usize, variable: usize },
    #[error("the rate of variable {row} contains variable {variable}, which does not precede it")]
    Order { row: usize, variable: usize },
    #[error("stage {stage} of the Runge-Kutta method is not explicit")]
    Implicit { stage: usize },
    #[error("its divergence is not zero but {divergence:e} times its monomial")]
    Divergence { divergence: f64 },
    #[error("there are more than 2^31 variables")]
    TooLarge,
}
