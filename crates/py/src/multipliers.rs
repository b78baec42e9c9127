//! Multipliers of a mechanical system at a point, and whether they can be told apart there.

use crate::errors;
use crate::mechanical::Mechanical;
use liouville_problem::{Dynamics, Model};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The first member, a row of params and of y each, of which some gradients of holonomic constraints are dependent: of
/// length one, one has no part of more than `cutoff` that is orthogonal to the others. None if there is none.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // arguments of a Python function
pub(crate) fn first_dependent(
    py: Python<'_>,
    problem: PyRef<'_, Mechanical>,
    params: PyReadonlyArray2<'_, f64>,
    t: f64,
    y: PyReadonlyArray2<'_, f64>,
    cutoff: f64,
) -> PyResult<Option<usize>> {
    let ([members, size], [rows, n]) = (
        [0, 1].map(|k| params.shape()[k]),
        [0, 1].map(|k| y.shape()[k]),
    );
    if problem.0.node_blocks.inputs() != [1, n, problem.0.m, size] || members != rows {
        return Err(errors::refused("y or params has another size"));
    }
    let (params, y, problem) = (params.as_slice()?, y.as_slice()?, problem.0.clone());
    let row = |k: usize| (&params[k * size..(k + 1) * size], &y[k * n..(k + 1) * n]);
    Ok(py.detach(|| problem.first_dependent((0..rows).map(row), t, cutoff)))
}

/// λ of the equations of accelerations at (t, y, z), or the error.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // arguments of a Python function
pub(crate) fn multipliers<'py>(
    py: Python<'py>,
    problem: PyRef<'py, Mechanical>,
    params: PyReadonlyArray1<'py, f64>,
    t: f64,
    y: PyReadonlyArray1<'py, f64>,
    z: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (params, y, z) = (params.as_slice()?, y.as_slice()?, z.as_slice()?);
    if problem.0.stage.inputs() != [1, y.len(), z.len(), params.len()] {
        return Err(PyValueError::new_err("y, z or params has another size"));
    }
    let mut model = Model::new(problem.0.clone(), params);
    let mut solver = Dynamics::solver(&model);
    match model.solve_lam(&mut solver, t, y, z) {
        Ok(()) => Ok(PyArray1::from_slice(py, <Model as Dynamics>::lam(&solver)).into_any()),
        Err(error) => Ok(errors::error(py, &error)?.into_any()),
    }
}
