//! The pieces of a split field, with checks that their flows are explicit and preserve volume.

use super::terms::{finite, size};
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
    /// Any other.
    Tape {
        /// The function, of one group of arguments and no parameters.
        value: Arc<Tape>,
        /// Its partial derivatives.
        slopes: Arc<Tape>,
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
    /// That of an affine piece may, but is not looked at.
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
            Piece::Scaling { rows, .. } | Piece::Exponential { rows, .. } => {
                !rows.contains(&variable)
            }
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
            | Self::Exponential { rows, .. } => rows.clone(),
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
            | Self::Exponential { functions, .. } => functions,
            Self::Triangular { .. } | Self::Affine { .. } | Self::Plane { .. } => &[],
        }
    }
}

/// The place of a variable that is not in a list.
const NOWHERE: u32 = u32::MAX;

/// Tolerance of a divergence, relative to the sum of the magnitudes in it.
const ROUNDOFF: f64 = 1e-12;

/// Checks one piece; `place` becomes the place of each variable in the list of those the piece changes.
fn check(piece: &Piece, place: &mut [u32]) -> Result<(), Malformed> {
    let n = place.len();
    let functions = piece.functions();
    check_functions(functions, n)?;
    match piece {
        Piece::Natural { rows, change, .. } => {
            locate(rows, place)?;
            size("change", change.rows(), rows.len())?;
            size("variables", change.variables(), n + functions.len())?;
            uncoupled(rows, change, functions, place)
        }
        Piece::Shear {
            places,
            direction,
            change,
            ..
        } => {
            locate(places, place)?;
            size("direction", direction.len(), places.len())?;
            finite("direction", direction)?;
            size("change", change.rows(), 1)?;
            size("variables", change.variables(), n + functions.len())?;
            let is_tape = |function: &&Function| matches!(function.formula, Formula::Tape { .. });
            let tapes = functions.iter().filter(is_tape);
            still(places, tapes, place)
        }
        Piece::Scaling { rows, rate, .. } => {
            locate(rows, place)?;
            size("rate", rate.rows(), rows.len())?;
            size("variables", rate.variables(), n + functions.len())?;
            uncoupled(rows, rate, functions, place)
        }
        Piece::Exponential {
            rows,
            rates,
            monomial,
            ..
        } => {
            locate(rows, place)?;
            size("rates", rates.len(), rows.len())?;
            finite("rate", rates)?;
            inside(monomial, n + functions.len())?;
            still(rows, functions, place)?;
            let powers = rows.iter().map(|row| {
                let power = monomial.iter().filter(|place| *place == row).count();
                power as f64 + 1.0
            });
            balanced(rates.iter().zip(powers).map(|(rate, power)| rate * power))
        }
        Piece::Triangular {
            order,
            change,
            a,
            b,
        } => {
            locate(order, place)?;
            size("change", change.rows(), order.len())?;
            size("variables", change.variables(), n)?;
            triangular(order, change, place)?;
            explicit(a, b)
        }
        Piece::Affine { matrix, vector } => {
            size("matrix", matrix.len(), n * n)?;
            size("vector", vector.len(), n)?;
            finite("matrix entry", matrix)?;
            finite("vector entry", vector)?;
            balanced(matrix.iter().step_by(n + 1).copied())
        }
        Piece::Plane { plane, variables } => {
            locate(variables, place)?;
            size("variables", variables.len(), plane.frozen() + 2)
        }
    }
}

fn inside(variables: &[usize], n: usize) -> Result<(), Malformed> {
    match variables.iter().find(|variable| **variable >= n) {
        Some(&variable) => Err(Malformed::Variable { variable, n }),
        None => Ok(()),
    }
}

/// Notes the place of each of these variables.
#[allow(clippy::cast_possible_truncation)] // fewer than 2^31
fn locate(variables: &[usize], place: &mut [u32]) -> Result<(), Malformed> {
    inside(variables, place.len())?;
    for (k, &variable) in variables.iter().enumerate() {
        if place[variable] != NOWHERE {
            return Err(Malformed::Repeated { variable });
        }
        place[variable] = k as u32;
    }
    Ok(())
}

fn check_functions(functions: &[Function], n: usize) -> Result<(), Malformed> {
    for Function { places, formula } in functions {
        inside(places, n)?;
        match formula {
            Formula::Cosine { k, phase } => {
                size("wave vector", k.len(), places.len())?;
                finite("wave number", k)?;
                finite("phase", &[*phase])?;
            }
            Formula::Tape { value, slopes } => {
                for tape in [value, slopes] {
                    size("arguments", tape.inputs().len(), 2)?;
                    size("arguments", tape.inputs()[0], places.len())?;
                    size("parameters", tape.inputs()[1], 0)?;
                }
                size("value", value.outputs(), 1)?;
                size("slopes", slopes.outputs(), places.len())?;
            }
        }
    }
    Ok(())
}

/// Refuses functions of a variable that the piece changes.
fn still<'a>(
    rows: &[usize],
    functions: impl IntoIterator<Item = &'a Function>,
    place: &[u32],
) -> Result<(), Malformed> {
    let mut places = functions.into_iter().flat_map(|function| &function.places);
    match places.find(|variable| place[**variable] != NOWHERE) {
        Some(&variable) => Err(Malformed::Coupled {
            row: rows[0],
            variable,
        }),
        None => Ok(()),
    }
}

/// Refuses a rate that contains a variable of the piece, alone or in a function.
fn uncoupled(
    rows: &[usize],
    change: &Polynomials,
    functions: &[Function],
    place: &[u32],
) -> Result<(), Malformed> {
    let n = place.len();
    let changed = |variable: &usize| place[*variable] != NOWHERE;
    for (k, &row) in rows.iter().enumerate() {
        for &factor in change.row_factors(k) {
            let found = match functions.get((factor as usize).wrapping_sub(n)) {
                Some(function) => function.places.iter().copied().find(changed),
                None => Some(factor as usize).filter(changed),
            };
            if let Some(variable) = found {
                return Err(Malformed::Coupled { row, variable });
            }
        }
    }
    Ok(())
}

fn triangular(order: &[usize], change: &Polynomials, place: &[u32]) -> Result<(), Malformed> {
    for (k, &row) in order.iter().enumerate() {
        let late = |variable: &usize| {
            let place = place[*variable];
            place != NOWHERE && place as usize >= k
        };
        let factors = change.row_factors(k).iter();
        if let Some(variable) = factors.map(|factor| *factor as usize).find(late) {
            return Err(Malformed::Order { row, variable });
        }
    }
    Ok(())
}

fn explicit(a: &[f64], b: &[f64]) -> Result<(), Malformed> {
    let s = b.len();
    size("tableau", a.len(), s * s)?;
    finite("tableau entry", a)?;
    finite("weight", b)?;
    let is_implicit = |stage: &usize| {
        a[stage * s + stage..(stage + 1) * s]
            .iter()
            .any(|a| *a != 0.0)
    };
    match (0..s).find(is_implicit) {
        Some(stage) => Err(Malformed::Implicit { stage }),
        None => Ok(()),
    }
}

/// Refuses numbers whose sum is not zero to roundoff.
fn balanced(parts: impl Iterator<Item = f64>) -> Result<(), Malformed> {
    let (mut divergence, mut size) = (0.0, 0.0);
    for part in parts {
        divergence += part;
        size += part.abs();
    }
    if divergence.abs() <= ROUNDOFF * size {
        Ok(())
    } else {
        Err(Malformed::Divergence { divergence })
    }
}
