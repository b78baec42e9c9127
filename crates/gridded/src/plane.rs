//! The Hamiltonian of two coordinates, given frozen ones.

use crate::equation::Fault;
use crate::spline::Spline;
use crate::traced::{Memory, Traced};

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
    pub fn memory(&self) -> Memory {
        match self {
            Self::Spline(_) => Memory::default(),
            Self::Traced(traced) => traced.memory(),
        }
    }

    /// F, v' and w' at frozen coordinates, v and w.
    ///
    /// # Errors
    /// The number of a coordinate that is outside its axis.
    pub fn sample(&self, x: [f64; 4], memory: &mut Memory) -> Result<[f64; 3], Fault> {
        match self {
            Self::Spline(spline) => spline.sample(x),
            Self::Traced(traced) => traced.sample(x, memory),
        }
    }
}
