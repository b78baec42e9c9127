//! Core errors as Python sees them; the names and the advice are added there.

use liouville_base::error::StepError;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;

/// An error of sizes or options, which only a direct call of the core can make.
pub(crate) fn refused(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
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
        StepError::SingularHidden { unknown } => {
            dict.set_item("index", unknown)?;
            "singular hidden"
        }
        StepError::SingularNewton => "singular",
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
            dict.set_item("piece", piece)?;
            dict.set_item("member", member)?;
            dict.set_item("t", t)?;
            "singular piece"
        }
        StepError::Overflow { index, member, t } => {
            dict.set_item("index", index)?;
            dict.set_item("member", member)?;
            dict.set_item("t", t)?;
            "overflow"
        }
        StepError::Norm { norm, start, t } => {
            dict.set_item("norm", norm)?;
            dict.set_item("norm_at_start", start)?;
            dict.set_item("t", t)?;
            "norm"
        }
        StepError::Spectrum { theta, most, t } => {
            dict.set_item("theta", theta)?;
            dict.set_item("most", most)?;
            dict.set_item("t", t)?;
            "spectrum"
        }
        StepError::Reset { event, t, missed } => {
            dict.set_item("event", event)?;
            dict.set_item("t", t)?;
            if let Some((quantity, index, value)) = missed {
                dict.set_item("quantity", quantity.name())?;
                dict.set_item("index", index)?;
                dict.set_item("value", value)?;
            }
            "reset"
        }
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
