//! The Hamiltonian of two coordinates, given frozen ones.

use crate::cells::Cells;
use crate::equation::Fault;
use crate::spline::Spline;
use crate::traced::{Programs, Traced};
use liouville_base::real::Real;

/// Memory for the flows of a plane, of one trajectory or several in lock-step.
#[derive(Clone, Debug, Default)]
pub struct Memory<R>(pub(crate) Kept<R>);

#[derive(Clone, Debug, Default)]
pub(crate) enum Kept<R> {
    #[default]
    Nothing,
    Cells(Box<Cells<R>>),
    Programs(Programs<R>),
}

/// The Hamiltonian of two coordinates, given frozen ones.
#[derive(Clone, Debug)]
pub enum Plane {
    /// On a grid.
    Spline(Box<Spline>),
    /// As programs.
    Traced(Traced),
}

impl Plane {
    /// How many coordinates are frozen.
    pub fn frozen(&self) -> usize {
        match self {
            Self::Spline(spline) => spline.frozen(),
            Self::Traced(traced) => traced.frozen(),
        }
    }

    /// Numbers that the Hamiltonian has as parameters.
    pub fn params(&self) -> &[f64] {
        match self {
            Self::Spline(_) => &[],
            Self::Traced(traced) => traced.params(),
        }
    }

    /// Memory for flows.
    pub fn memory<R: Real>(&self) -> Memory<R> {
        Memory(match self {
            Self::Spline(spline) => Kept::Cells(Box::new(Cells::new(spline))),
            Self::Traced(traced) => Kept::Programs(traced.programs()),
        })
    }

    /// Whether memory is of certain trajectories, whose cells it has; else flows of any may take it.
    pub fn has_cells(&self) -> bool {
        matches!(self, Self::Spline(_))
    }

    /// F, v' and w' at frozen coordinates, v and w.
    ///
    /// # Errors
    /// The number of a coordinate that is outside its axis.
    ///
    /// # Panics
    /// When the memory is that of another plane.
    pub fn sample(&self, x: [f64; 4], memory: &mut Memory<f64>) -> Result<[f64; 3], Fault> {
        match (self, &mut memory.0) {
            (Self::Spline(spline), _) => spline.sample(x),
            (Self::Traced(traced), Kept::Programs(programs)) => traced.sample(x, programs),
            _ => panic!("memory of another plane"),
        }
    }
}
