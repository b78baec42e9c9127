//! Checks that the flows of pieces are explicit and preserve volume.

use super::terms::{finite, size};
use super::{Formula, Function, Malformed, Piece, Polynomials};

/// The place of a variable that is not in a list.
pub(super) const NOWHERE: u32 = u32::MAX;

/// Tolerance of a divergence, relative to the sum of the magnitudes in it.
const ROUNDOFF: f64 = 1e-12;

/// Checks one piece; `place` becomes the place of each variable in the list of those the piece changes.
pub(super) fn check(piece: &Piece, place: &mut [u32]) -> Result<(), Malformed> {
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
        Piece::Turn {
            rows,
            change,
            functions,
            ..
        } => {
            locate(rows, place)?;
            size("rows", rows.len(), 3)?;
            size("change", change.rows(), 6)?;
            size("variables", change.variables(), n + functions.len())?;
            turning(rows, change, functions, place)
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
            Formula::Tape {
                value,
                slopes,
                output,
            } => {
                for tape in [value, slopes] {
                    size("arguments", tape.inputs().len(), 2)?;
                    size("arguments", tape.inputs()[0], places.len())?;
                    size("parameters", tape.inputs()[1], 0)?;
                }
                inside(&[*output], value.outputs())?;
                size("slopes", slopes.outputs(), value.outputs() * places.len())?;
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

/// Refuses a turn whose w or e contains a variable of it, but for functions of all of them in a w without e.
fn turning(
    rows: &[usize],
    change: &Polynomials,
    functions: &[Function],
    place: &[u32],
) -> Result<(), Malformed> {
    let n = place.len();
    let is_pushed = (3..6).any(|row| change.row(row).next().is_some());
    let is_of_size = |function: &Function| {
        let own = function.places.iter().filter(|v| place[**v] != NOWHERE);
        !is_pushed && own.count() == rows.len()
    };
    let others: Vec<Function> = (functions.iter().filter(|f| !is_of_size(f)).cloned()).collect();
    still(rows, &others, place)?;
    let factors = (0..6).flat_map(|row| change.row_factors(row));
    let mut variables = factors.map(|factor| *factor as usize).filter(|v| *v < n);
    match variables.find(|variable| place[*variable] != NOWHERE) {
        Some(variable) => Err(Malformed::Coupled {
            row: rows[0],
            variable,
        }),
        None => Ok(()),
    }
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
