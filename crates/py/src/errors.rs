//! Core errors as Python sees them; the names and the advice are added there.

use liouville_base::error::{Quantity, StepError};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;

/// An error of sizes or options, which only a direct call of the core can make.
pub(crate) fn refused(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Which piece of a field, or which coordinate, fails, for which member and when.
fn of_member(
    dict: &Bound<'_, PyDict>,
    (part, number): (&str, usize),
    member: usize,
    t: f64,
) -> PyResult<()> {
    dict.set_item(part, number)?;
    dict.set_item("member", member)?;
    dict.set_item("t", t)
}

/// The parts of an error at an event, and its kind.
fn of_event(dict: &Bound<'_, PyDict>, error: &StepError) -> PyResult<&'static str> {
    match error {
        StepError::Reset { event, t, missed } => {
            dict.set_item("event", event)?;
            dict.set_item("t", t)?;
            missed
                .as_ref()
                .map_or(Ok(()), |missed| of_reset(dict, missed))?;
            Ok("reset")
        }
        StepError::Undifferentiable { event, t, why } => {
            dict.set_item("event", event)?;
            dict.set_item("t", t)?;
            dict.set_item("why", why.name())?;
            Ok("no derivative")
        }
        _ => Ok(""),
    }
}

/// The constraint that a reset violates, and by how much.
fn of_reset(dict: &Bound<'_, PyDict>, missed: &(Quantity, usize, f64)) -> PyResult<()> {
    let (quantity, index, value) = missed;
    dict.set_item("quantity", quantity.name())?;
    dict.set_item("index", index)?;
    dict.set_item("value", value)
}

/// The parts of an error of a wave function, and its kind.
fn of_wave(dict: &Bound<'_, PyDict>, error: &StepError) -> PyResult<&'static str> {
    Ok(match error {
        StepError::Norm { norm, start, t } => {
            dict.set_item("norm", norm)?;
            dict.set_item("norm_at_start", start)?;
            dict.set_item("t", t)?;
            "norm"
        }
        StepError::Unresolved { share, t } => {
            dict.set_item("share", share)?;
            dict.set_item("t", t)?;
            "unresolved"
        }
        StepError::Spectrum { theta, most, t } => {
            dict.set_item("theta", theta)?;
            dict.set_item("most", most)?;
            dict.set_item("t", t)?;
            "spectrum"
        }
        _ => "",
    })
}

/// An error as a dictionary: its kind, its numbers, and its own sentence.
pub(crate) fn error<'py>(py: Python<'py>, error: &StepError) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("message", error.to_string())?;
    let kind = match error {
        StepError::NotFinite { quantity, index, t } => {
            dict.set_item("quantity", quantity.name())?;
            dict.set_item("index", index)?;
            dict.set_item("t", t)?;
            "not finite"
        }
        StepError::SingularMass { coordinate } => {
            dict.set_item("index", coordinate)?;
            "singular mass"
        }
        StepError::DependentConstraints { constraints } => {
            dict.set_item("constraints", constraints)?;
            "redundant"
        }
        StepError::Contradiction { constraint } => {
            dict.set_item("index", constraint)?;
            dict.set_item("part", "constraint")?;
            "contradiction"
        }
        StepError::SingularHidden { unknown } => {
            dict.set_item("index", unknown)?;
            "singular hidden"
        }
        StepError::SingularNewton => "singular",
        StepError::NoMultipliers => "no multipliers",
        StepError::NotConverged { iterations, size } => {
            dict.set_item("iterations", iterations)?;
            dict.set_item("size", size)?;
            "not converged"
        }
        StepError::StepTooLarge {
            h,
            coordinate,
            solved,
        } => {
            dict.set_item("index", coordinate)?;
            dict.set_item("h", h)?;
            dict.set_item("solved", solved)?;
            "step too large"
        }
        StepError::StepTooSmall { h, error } => {
            dict.set_item("h", h)?;
            dict.set_item("error", error)?;
            "step too small"
        }
        StepError::Monitor { value, rate, t } => {
            dict.set_item("value", value)?;
            dict.set_item("rate", rate)?;
            dict.set_item("t", t)?;
            "monitor"
        }
        StepError::Singular { piece, member, t } => {
            of_member(&dict, ("piece", *piece), *member, *t)?;
            "singular piece"
        }
        StepError::Function {
            piece,
            function,
            member,
            t,
        } => {
            of_member(&dict, ("piece", *piece), *member, *t)?;
            dict.set_item("function", function)?;
            "singular function"
        }
        StepError::Overflow { index, member, t } => {
            of_member(&dict, ("index", *index), *member, *t)?;
            "overflow"
        }
        StepError::Outside { index, member, t } => {
            of_member(&dict, ("index", *index), *member, *t)?;
            "outside"
        }
        StepError::Norm { .. } | StepError::Unresolved { .. } | StepError::Spectrum { .. } => {
            of_wave(&dict, error)?
        }
        StepError::Reset { .. } | StepError::Undifferentiable { .. } => of_event(&dict, error)?,
        StepError::Interrupted => "interrupted",
        StepError::NoMemory => "no memory",
        StepError::Member { member, error } => {
            let dict = self::error(py, error)?;
            dict.set_item("member", member)?;
            return Ok(dict);
        }
    };
    dict.set_item("kind", kind)?;
    Ok(dict)
}
