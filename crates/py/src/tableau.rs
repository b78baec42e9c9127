//! Coefficients of the methods, as Python sees them.

use liouville_base::tableau::{Force, Scheme, Spark};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Coefficients of the SPARK method with s stages at these points, by their letters.
#[pyfunction]
pub(crate) fn spark_tableau<'py>(
    py: Python<'py>,
    stages: usize,
    points: &str,
) -> PyResult<Bound<'py, PyDict>> {
    coefficients(py, &spark_named(stages, points)?)
}

/// The SPARK method with this number of stages, at the points of this name.
pub(crate) fn spark_named(stages: usize, points: &str) -> PyResult<Spark> {
    if stages == 0 {
        return Err(PyValueError::new_err(
            "a SPARK method has at least one stage",
        ));
    }
    match points {
        "gauss" => Ok(Spark::gauss(stages)),
        "radau" => Ok(Spark::radau(stages)),
        other => Err(PyValueError::new_err(format!(
            "there are no points {other:?}"
        ))),
    }
}

/// Coefficients of the Lobatto pair with S stages and these coefficients of the forces, by their letters.
#[pyfunction]
pub(crate) fn lobatto_pair<'py>(
    py: Python<'py>,
    stages: usize,
    force: &str,
) -> PyResult<Bound<'py, PyDict>> {
    coefficients(py, &lobatto_named(stages, force)?)
}

/// The Lobatto pair whose forces have the coefficients of this name.
pub(crate) fn lobatto_named(stages: usize, force: &str) -> PyResult<Spark> {
    if stages < 2 {
        return Err(PyValueError::new_err(
            "a Lobatto pair has at least two stages",
        ));
    }
    let force = Force::named(force)
        .ok_or_else(|| PyValueError::new_err(format!("there is no Lobatto III{force}")))?;
    Ok(Spark::lobatto(stages, force))
}

fn coefficients<'py>(py: Python<'py>, tableau: &Spark) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, matrix) in [
        ("a_v", &tableau.a_v),
        ("a_f", &tableau.a_f),
        ("a_r", &tableau.a_r),
        ("mu_v", &tableau.mu_v),
        ("mu_f", &tableau.mu_f),
        ("mu_bar", &tableau.mu_bar),
        ("mu_hat", &tableau.mu_hat),
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
