//! The pieces of a split field.

use super::check::{NOWHERE, check};
use super::{Malformed, Polynomials};
use liouville_base::tape::Tape;
use liouville_gridded::Plane;
use std::sync::Arc;

/// A function of some variables, a factor like a variable: number q of a piece is factor n + q.
#[derive(Clone, Debug)]
pub struct Function {
    /// The variables it depends on.
    pub places: Vec<usize>,
    /// Its value.
    pub formula: Formula,
}

/// The value of a function at the variables of its places.
#[derive(Clone, Debug)]
pub enum Formula {
    /// cos(k · x + phase)
    Cosine {
        /// The wave vector, one number a place.
        k: Vec<f64>,
        /// The phase.
        phase: f64,
    },
    /// Any other, by a program of one or several values, of which this is one.
    Tape {
        /// The program, of one group of arguments and no parameters.
        value: Arc<Tape>,
        /// The partial derivatives of all of its values, value by value.
        slopes: Arc<Tape>,
        /// Which of the values it is.
        output: usize,
    },
}

/// A divergence-free field that is easy to step.
#[derive(Clone, Debug)]
pub enum Piece {
    /// x_i' = R_i, no R_i containing a variable the piece changes: x_i += h R_i.
    Natural {
        /// The variables i.
        rows: Vec<usize>,
        /// R_i, one row each.
        change: Polynomials,
        /// Factors n + q of `change`.
        functions: Vec<Function>,
    },
    /// x' = g(x) a with a · grad g = 0, which is not checked: x += h g(x) a.
    Shear {
        /// The variables where a is not zero.
        places: Vec<usize>,
        /// a at these places.
        direction: Vec<f64>,
        /// g, the only row.
        change: Polynomials,
        /// Factors n + q of `change`.
        functions: Vec<Function>,
    },
    /// x_i' = p_i x_i, no p_i containing a variable the piece changes, and Σ p_i = 0, which is not checked:
    /// x_i *= exp(h p_i).
    Scaling {
        /// The variables i.
        rows: Vec<usize>,
        /// p_i, one row each.
        rate: Polynomials,
        /// Factors n + q of `rate`.
        functions: Vec<Function>,
    },
    /// x_i' = c_i x_i m with one m, a monomial x^j times functions of variables that stand still, and Σ c_i (j_i + 1) = 0.
    Exponential {
        /// The variables i.
        rows: Vec<usize>,
        /// c_i
        rates: Vec<f64>,
        /// The factors of m, with repetition.
        monomial: Vec<usize>,
        /// Factors n + q of m.
        functions: Vec<Function>,
    },
    /// x_i' = F_i with F_i depending on variables before i in the order, and on variables outside it;
    /// stepped by an explicit Runge-Kutta method.
    Triangular {
        /// The variables i in this order.
        order: Vec<usize>,
        /// F_i, one row each.
        change: Polynomials,
        /// The method's matrix, row by row.
        a: Vec<f64>,
        /// The method's weights.
        b: Vec<f64>,
    },
    /// x' = A x + c with tr A = 0, in all variables.
    Affine {
        /// A, row by row.
        matrix: Vec<f64>,
        /// c
        vector: Vec<f64>,
    },
    /// v' = w × v + e of three variables v, w and e being functions of others, or w of |v|² too where e = 0, which is not
    /// checked: v is turned, and pushed.
    Turn {
        /// The variables v.
        rows: Vec<usize>,
        /// w and e, three rows each.
        change: Polynomials,
        /// Factors n + q of `change`.
        functions: Vec<Function>,
        /// Whether the angle θ is 2 arctan(θ/2) instead, as in Boris's method.
        is_cayley: bool,
    },
    /// Two variables by a Hamiltonian, the others frozen; stepped by symplectic Euler.
    Plane {
        /// The Hamiltonian.
        plane: Arc<Plane>,
        /// Its frozen variables, then the two that move.
        variables: Vec<usize>,
    },
}

/// A field of n variables as the sum of pieces.
#[derive(Clone, Debug)]
pub struct Split {
    n: usize,
    pieces: Vec<Piece>,
}

impl Split {
    /// A split of checked pieces.
    ///
    /// # Errors
    /// The first malformed piece, and its defect.
    pub fn new(n: usize, pieces: Vec<Piece>) -> Result<Self, Malformed> {
        if n >= 1 << 31 {
            return Err(Malformed::TooLarge);
        }
        let mut places = vec![NOWHERE; n];
        for (piece, content) in pieces.iter().enumerate() {
            check(content, &mut places).map_err(|defect| Malformed::Piece {
                piece,
                defect: Box::new(defect),
            })?;
            places.fill(NOWHERE);
        }
        Ok(Self { n, pieces })
    }

    /// Number of variables.
    pub fn n(&self) -> usize {
        self.n
    }

    /// The pieces in their order.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Whether a variable moves evenly, as time does: trajectories that begin with the same value keep it in common.
    /// A variable of an affine piece may, but is not checked.
    pub fn is_clock(&self, variable: usize) -> bool {
        let is_even = |rows: &[usize], change: &Polynomials| {
            let row = rows.iter().position(|row| *row == variable);
            row.is_none_or(|row| change.row_factors(row).is_empty())
        };
        self.pieces.iter().all(|piece| match piece {
            Piece::Natural { rows, change, .. } => is_even(rows, change),
            Piece::Triangular { order, change, .. } => is_even(order, change),
            Piece::Shear { places, .. } => !places.contains(&variable),
            Piece::Plane { variables, .. } => !variables.contains(&variable),
            Piece::Scaling { rows, .. }
            | Piece::Exponential { rows, .. }
            | Piece::Turn { rows, .. } => !rows.contains(&variable),
            Piece::Affine { .. } => false,
        })
    }
}

impl Piece {
    /// The variables that it changes, of n.
    pub fn changes(&self, n: usize) -> Vec<usize> {
        match self {
            Self::Natural { rows, .. }
            | Self::Scaling { rows, .. }
            | Self::Exponential { rows, .. }
            | Self::Turn { rows, .. } => rows.clone(),
            Self::Shear { places, .. } => places.clone(),
            Self::Triangular {
                order: variables, ..
            }
            | Self::Plane { variables, .. } => variables.clone(),
            Self::Affine { .. } => (0..n).collect(),
        }
    }

    /// The functions among its factors.
    pub fn functions(&self) -> &[Function] {
        match self {
            Self::Natural { functions, .. }
            | Self::Shear { functions, .. }
            | Self::Scaling { functions, .. }
            | Self::Exponential { functions, .. }
            | Self::Turn { functions, .. } => functions,
            Self::Triangular { .. } | Self::Affine { .. } | Self::Plane { .. } => &[],
        }
    }
}
