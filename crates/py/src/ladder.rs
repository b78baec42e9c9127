//! The methods for the Schrödinger equation that are coefficients of shears, as Python sees them.

use liouville_base::tableau::{Ladder, Purpose, Stable};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// All methods of the ladder: what they are made for, their coefficients, and their largest errors
/// up to fractions of theta.
#[pyfunction]
pub(crate) fn ladder(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let methods = PyList::empty(py);
    for method in Ladder::all() {
        let dict = PyDict::new(py);
        dict.set_item("id", method.id)?;
        dict.set_item("n", method.coefficients.len())?;
        dict.set_item("stable", method.is_stable)?;
        dict.set_item("ratio", method.ratio)?;
        dict.set_item("theta", method.theta)?;
        dict.set_item("gain", method.gain)?;
        for (name, values) in [
            ("coefficients", method.coefficients.as_slice()),
            ("fractions", Ladder::fractions()),
            ("err", &method.err),
            ("dphi", &method.dphi),
            ("kappa", &method.kappa),
        ] {
            dict.set_item(name, PyArray1::from_slice(py, values))?;
        }
        methods.append(dict)?;
    }
    Ok(methods)
}

/// All methods made for stability or for their order, with their coefficients, a and b in turn.
#[pyfunction]
pub(crate) fn stability(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let methods = PyList::empty(py);
    for method in Stable::all() {
        let kind = match method.purpose {
            Purpose::Stability => "stability",
            Purpose::Order => "gray-manolopoulos",
        };
        let dict = PyDict::new(py);
        dict.set_item("kind", kind)?;
        dict.set_item("order", method.order)?;
        dict.set_item("stages", method.stages)?;
        dict.set_item("limit", method.limit)?;
        dict.set_item("gain", method.gain)?;
        let coefficients = PyArray1::from_slice(py, &method.coefficients);
        dict.set_item("coefficients", coefficients)?;
        methods.append(dict)?;
    }
    Ok(methods)
}
