//! Start values moved onto their constraints, and constraints that others imply.

use crate::convert::{self, pattern};
use crate::errors;
use liouville_base::linalg::{self, Matrix};
use liouville_base::tape::Tape;
use liouville_problem::Projection;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The point nearest to `x` that meets a projection's equations, or the error of finding it.
///
/// Tapes of c, `c_x` and the metric; patterns of the last two.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    tapes: (
        PyRef<'py, convert::Tape>,
        PyRef<'py, convert::Tape>,
        PyRef<'py, convert::Tape>,
    ),
    patterns: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    x: PyReadonlyArray1<'py, f64>,
    held: PyReadonlyArray1<'py, f64>,
    params: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (residual, jacobian, metric) = tapes;
    let (x, held, params) = (x.as_slice()?, held.as_slice()?, params.as_slice()?);
    let projection = Projection {
        residual: Tape::clone(&residual.0),
        jacobian: Tape::clone(&jacobian.0),
        pattern: pattern(&patterns.0)?,
        metric: Tape::clone(&metric.0),
        metric_pattern: pattern(&patterns.1)?,
    };
    match liouville_problem::project(&projection, x, held, params) {
        Ok(x) => Ok(PyArray1::from_vec(py, x).into_any()),
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
