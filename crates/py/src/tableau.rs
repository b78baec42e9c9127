//! Coefficients of the methods, as Python sees them.

use liouville_core::tableau::{GaussLobatto, Scheme};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Coefficients of the s-stage Gauss–Lobatto SPARK method, by their letters.
#[pyfunction]
pub(crate) fn gauss_lobatto(py: Python<'_>, stages: usize) -> PyResult<Bound<'_, PyDict>> {
    if stages == 0 {
        return Err(PyValueError::new_err(
            "a SPARK method has at least one stage",
        ));
    }
    let tableau = GaussLobatto::new(stages);
    let dict = PyDict::new(py);
    for (name, matrix) in [
        ("a", &tableau.a),
        ("a_bar", &tableau.a_bar),
        ("a_hat", &tableau.a_hat),
    ] {
        let shape = [matrix.rows(), matrix.cols()];
        dict.set_item(
            name,
            PyArray1::from_slice(py, matrix.flat()).reshape(shape)?,
        )?;
    }
    for (name, vector) in [
        ("b", &tableau.b),
        ("c", &tableau.c),
        ("b_hat", &tableau.b_hat),
        ("c_hat", &tableau.c_hat),
    ] {
        dict.set_item(name, PyArray1::from_slice(py, vector))?;
    }
    Ok(dict)
}

/// The composition scheme of this name.
pub(crate) fn scheme_named(name: &str) -> PyResult<&'static Scheme> {
    Scheme::named(name).ok_or_else(|| PyValueError::new_err(format!("there is no scheme {name:?}")))
}
