//! Start values moved onto their constraints, and constraints that others imply.

use crate::convert::{self, pattern};
use crate::errors;
use liouville_base::linalg::{self, Matrix};
use liouville_base::tape::Tape;
use liouville_problem::Projection;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Tapes of c, `c_x` and the metric.
type Tapes<'py> = (
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
    PyRef<'py, convert::Tape>,
);

fn projection(
    tapes: &Tapes<'_>,
    patterns: &(Bound<'_, PyAny>, Bound<'_, PyAny>),
) -> PyResult<Projection> {
    let (residual, jacobian, metric) = tapes;
    Ok(Projection {
        residual: Tape::clone(&residual.0),
        jacobian: Tape::clone(&jacobian.0),
        pattern: pattern(&patterns.0)?,
        metric: Tape::clone(&metric.0),
        metric_pattern: pattern(&patterns.1)?,
    })
}

/// The point nearest to `x` that meets a projection's equations, or the error of finding it; patterns are those of
/// `c_x` and of the metric.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    tapes: Tapes<'py>,
    patterns: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    x: PyReadonlyArray1<'py, f64>,
    held: PyReadonlyArray1<'py, f64>,
    params: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let projection = projection(&tapes, &patterns)?;
    let (x, held, params) = (x.as_slice()?, held.as_slice()?, params.as_slice()?);
    match liouville_problem::project(&projection, x, held, params) {
        Ok(x) => Ok(PyArray1::from_vec(py, x).into_any()),
        Err(error) => Ok(errors::error(py, &error)?.into_any()),
    }
}

/// The least changes of `x`, a row each, that change c by the rows of `rates`, or the error of finding them.
#[pyfunction]
pub(crate) fn project_tangents<'py>(
    py: Python<'py>,
    tapes: Tapes<'py>,
    patterns: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    x: PyReadonlyArray1<'py, f64>,
    held: PyReadonlyArray1<'py, f64>,
    params: PyReadonlyArray1<'py, f64>,
    rates: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let projection = projection(&tapes, &patterns)?;
    let (x, held, params) = (x.as_slice()?, held.as_slice()?, params.as_slice()?);
    if rates.shape()[1] != projection.pattern.shape().0 {
        return Err(errors::refused("rates have a column for each equation"));
    }
    match liouville_problem::project_tangents(&projection, (x, held, params), rates.as_slice()?) {
        Ok(moves) => {
            let shape = [rates.shape()[0], x.len()];
            Ok(PyArray1::from_vec(py, moves).reshape(shape)?.into_any())
        }
        Err(error) => Ok(errors::error(py, &error)?.into_any()),
    }
}

/// The multipliers that take a cotangent of a point moved onto its equations to one of the point, or the error of
/// finding them.
#[pyfunction]
pub(crate) fn project_cotangents<'py>(
    py: Python<'py>,
    tapes: Tapes<'py>,
    patterns: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    x: PyReadonlyArray1<'py, f64>,
    held: PyReadonlyArray1<'py, f64>,
    params: PyReadonlyArray1<'py, f64>,
    of_x: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let projection = projection(&tapes, &patterns)?;
    let (x, held, params) = (x.as_slice()?, held.as_slice()?, params.as_slice()?);
    if of_x.len() != x.len() {
        return Err(errors::refused("a cotangent has the size of the point"));
    }
    let at = (x, held, params);
    match liouville_problem::project_cotangents(&projection, at, of_x.as_slice()?) {
        Ok(multipliers) => Ok(PyArray1::from_vec(py, multipliers).into_any()),
        Err(error) => Ok(errors::error(py, &error)?.into_any()),
    }
}

/// The rows of a matrix that are independent of one another, of dependent ones the first; the least part of a kept row
/// that is its own, and the largest of another: those not longer than `cutoff` count as roundoff.
#[pyfunction]
pub(crate) fn independent_rows(
    matrix: PyReadonlyArray2<'_, f64>,
    cutoff: f64,
) -> (Vec<usize>, f64, f64) {
    let (rows, cols) = (matrix.shape()[0], matrix.shape()[1]);
    let values = matrix.as_array();
    let own = Matrix::from_fn(rows, cols, |i, j| values[[i, j]]);
    let found = linalg::independent_rows(own, cutoff);
    (found.kept, found.least, found.left)
}
