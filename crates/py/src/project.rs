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

/// Solutions with the matrix of a correction at `x`, or with its transpose, for right-hand sides of momenta and
/// equations, a row each; or the error of finding them.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // those of `project`, and two
pub(crate) fn project_linear<'py>(
    py: Python<'py>,
    tapes: Tapes<'py>,
    patterns: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    x: PyReadonlyArray1<'py, f64>,
    held: PyReadonlyArray1<'py, f64>,
    params: PyReadonlyArray1<'py, f64>,
    rows: PyReadonlyArray2<'py, f64>,
    is_transposed: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let projection = projection(&tapes, &patterns)?;
    let (x, held, params) = (x.as_slice()?, held.as_slice()?, params.as_slice()?);
    if rows.shape()[1] != x.len() + projection.pattern.shape().0 {
        return Err(errors::refused(
            "rows have a column for each unknown and each equation",
        ));
    }
    let (mut found, at) = (rows.as_slice()?.to_vec(), (x, held, params));
    match liouville_problem::project_linear(&projection, at, &mut found, is_transposed) {
        Ok(()) => {
            let shape = [rows.shape()[0], rows.shape()[1]];
            Ok(PyArray1::from_vec(py, found).reshape(shape)?.into_any())
        }
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
