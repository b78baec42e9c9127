//! Plane flows of divergence-free fields that are given on grids, or by a vector potential.
//!
//! A field v = curl A is the sum of three, each of one component of A. That of A_k moves two coordinates by the Hamiltonian
//! A_k with the third one frozen, and a symplectic map of them keeps volume. A_k is a [`Spline`], a sum of products
//! of [`Basis`] functions, or [`Traced`], programs of it and its derivatives; [`PlaneFlow`] makes the map. Source: feng1995.

mod basis;
mod cells;
mod derivative;
mod equation;
mod flow;
mod plane;
mod spline;
mod traced;

pub use basis::{Basis, Bounds};
pub use equation::{Fault, MOST_CORRECTIONS};
pub use flow::PlaneFlow;
pub use plane::{Memory, Plane};
pub use spline::Spline;
pub use traced::Traced;

/// The defect of a basis or a plane.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs)]
pub enum Malformed {
    #[error("{name} has size {found}, wanted {wanted}")]
    Size {
        name: &'static str,
        found: usize,
        wanted: usize,
    },
    #[error("{name} {index} is not finite")]
    NotFinite { name: &'static str, index: usize },
    #[error("edge {index} is not above the one before it")]
    Edges { index: usize },
    #[error("splines of degree {degree}, which are of degree {wanted}")]
    Degree { degree: usize, wanted: &'static str },
    #[error("an axis of {cells} cells, wanted as many as the degree, or three")]
    Cells { cells: usize },
    #[error("cell {cell} has no table {table} among {tables}")]
    Table {
        cell: usize,
        table: usize,
        tables: usize,
    },
}

fn size(name: &'static str, found: usize, wanted: usize) -> Result<(), Malformed> {
    if found == wanted {
        return Ok(());
    }
    Err(Malformed::Size {
        name,
        found,
        wanted,
    })
}

fn finite(name: &'static str, values: &[f64]) -> Result<(), Malformed> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(Malformed::NotFinite { name, index }),
        None => Ok(()),
    }
}
