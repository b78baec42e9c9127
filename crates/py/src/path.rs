//! The trajectory of a mechanical run, interpolated.

use crate::convert::Mechanical;
use crate::errors;
use liouville_mechanics::problem::{Carried, Model, Path};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// y, z and lam at `times` in the order of a run by a method of this order, of which all k steps are known:
/// t of shape (k,), y and z of shape (k, n). Returns three arrays, or the error.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // a system, a trajectory and where to look
pub(crate) fn mechanical_path<'py>(
    py: Python<'py>,
    problem: &Mechanical,
    params: PyReadonlyArray1<'py, f64>,
    order: usize,
    t: PyReadonlyArray1<'py, f64>,
    y: PyReadonlyArray2<'py, f64>,
    z: PyReadonlyArray2<'py, f64>,
    times: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (n, k) = (problem.0.n, t.len());
    let fits = k > 0 && y.shape() == [k, n] && z.shape() == [k, n];
    if !fits || params.len() != problem.0.stage.inputs()[3] {
        return Err(PyValueError::new_err(
            "a trajectory has arrays of shape (k, n)",
        ));
    }
    let (t, y, z) = (t.as_slice()?, y.as_slice()?, z.as_slice()?);
    let mut path = Path::new(Model::new(problem.0.clone(), params.as_slice()?), order);
    let (mut ys, mut zs, mut lams) = (Vec::new(), Vec::new(), Vec::new());
    for time in times.as_slice()? {
        let found = path
            .follow(*time, t, (y, z))
            .and_then(|()| path.solve_there());
        if let Err(error) = found {
            return Ok(errors::error(py, &error)?.into_any());
        }
        ys.extend_from_slice(path.point().y());
        zs.extend_from_slice(path.point().z());
        lams.extend_from_slice(path.lam());
    }
    let rows = |values: Vec<f64>| -> PyResult<Bound<'py, PyArray2<f64>>> {
        let width = values.len() / times.len().max(1);
        PyArray1::from_vec(py, values).reshape([times.len(), width])
    };
    let arrays = (rows(ys)?, rows(zs)?, rows(lams)?);
    Ok(arrays.into_pyobject(py)?.into_any())
}
