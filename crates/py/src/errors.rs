//! Core errors as Python sees them; the names and the advice are added there.

use liouville_base::error::Trouble;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;

/// Something malformed, which only a direct call of the core can hand over.
pub(crate) fn refused(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A trouble as a dictionary: its kind, its numbers, and its own sentence.
pub(crate) fn trouble<'py>(py: Python<'py>, trouble: &Trouble) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("message", trouble.to_string())?;
    let kind = match trouble {
        Trouble::NotFinite { quantity, index, t } => {
            dict.set_item("quantity", quantity.name())?;
            dict.set_item("index", index)?;
            dict.set_item("t", t)?;
            "not finite"
        }
        Trouble::SingularMass { coordinate } => {
            dict.set_item("index", coordinate)?;
            "singular mass"
        }
        Trouble::Redundant { constraints } => {
            dict.set_item("constraints", constraints)?;
            "redundant"
        }
        Trouble::SingularHidden { unknown } => {
            dict.set_item("index", unknown)?;
            "singular hidden"
        }
        Trouble::SingularNewton => "singular",
        Trouble::NotConverged { iterations, size } => {
            dict.set_item("iterations", iterations)?;
            dict.set_item("size", size)?;
            "not converged"
        }
        Trouble::StepTooSmall { h, error } => {
            dict.set_item("h", h)?;
            dict.set_item("error", error)?;
            "step too small"
        }
        Trouble::Monitor { value, rate, t } => {
            dict.set_item("value", value)?;
            dict.set_item("rate", rate)?;
            dict.set_item("t", t)?;
            "monitor"
        }
        Trouble::Singular { piece, member, t } => {
            dict.set_item("piece", piece)?;
            dict.set_item("member", member)?;
            dict.set_item("t", t)?;
            "singular piece"
        }
        Trouble::Overflow { index, member, t } => {
            dict.set_item("index", index)?;
            dict.set_item("member", member)?;
            dict.set_item("t", t)?;
            "overflow"
        }
        Trouble::Norm { norm, start, t } => {
            dict.set_item("norm", norm)?;
            dict.set_item("norm_at_start", start)?;
            dict.set_item("t", t)?;
            "norm"
        }
        Trouble::Spectrum { theta, most, t } => {
            dict.set_item("theta", theta)?;
            dict.set_item("most", most)?;
            dict.set_item("t", t)?;
            "spectrum"
        }
        Trouble::Interrupted => "interrupted",
        Trouble::Member { member, trouble } => {
            let dict = self::trouble(py, trouble)?;
            dict.set_item("member", member)?;
            return Ok(dict);
        }
    };
    dict.set_item("kind", kind)?;
    Ok(dict)
}
