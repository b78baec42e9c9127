//! The trajectory of a mechanical or semi-explicit run, interpolated.

use crate::errors;
use crate::mechanical::Mechanical;
use crate::semi_explicit::SemiExplicit;
use liouville_index2::semi_explicit;
use liouville_problem::{Carried, Dynamics, Model, Path};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A system with derivatives along its trajectories.
#[derive(FromPyObject)]
pub(crate) enum Dynamical<'py> {
    Mechanical(PyRef<'py, Mechanical>),
    SemiExplicit(PyRef<'py, SemiExplicit>),
}

/// y, z and lam at `times` in the order of a run by a method of this order, of which all k steps are known:
/// t of shape (k,), y of shape (k, n) and z of shape (k, l). Returns three arrays, or the error.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // a system, a trajectory and where to look
pub(crate) fn path<'py>(
    py: Python<'py>,
    problem: Dynamical<'py>,
    params: PyReadonlyArray1<'py, f64>,
    order: usize,
    t: PyReadonlyArray1<'py, f64>,
    y: PyReadonlyArray2<'py, f64>,
    z: PyReadonlyArray2<'py, f64>,
    times: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (params, run) = (params.as_slice()?, (t, y, z));
    let inputs = match &problem {
        Dynamical::Mechanical(problem) => problem.0.stage.inputs(),
        Dynamical::SemiExplicit(problem) => problem.0.field.inputs(),
    };
    if inputs.last() != Some(&params.len()) {
        return Err(PyValueError::new_err("params has another size"));
    }
    match problem {
        Dynamical::Mechanical(problem) => {
            let model = Model::new(problem.0.clone(), params);
            along(py, model, order, &run, times.as_slice()?)
        }
        Dynamical::SemiExplicit(problem) => {
            let model = semi_explicit::SemiExplicitModel::new(problem.0.clone(), params);
            along(py, model, order, &run, times.as_slice()?)
        }
    }
}

/// Ends of steps: t, y and z.
type Ends<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

fn along<'py, M: Dynamics>(
    py: Python<'py>,
    model: M,
    order: usize,
    (t, y, z): &Ends<'py>,
    times: &[f64],
) -> PyResult<Bound<'py, PyAny>> {
    let ([n, l, _], k) = (model.sizes(), t.len());
    if k == 0 || y.shape() != [k, n] || z.shape() != [k, l] {
        return Err(PyValueError::new_err(
            "a trajectory has arrays of shape (k, n) and (k, l)",
        ));
    }
    let (t, y, z) = (t.as_slice()?, y.as_slice()?, z.as_slice()?);
    let mut path = Path::new(model, order);
    let (mut ys, mut zs, mut lams) = (Vec::new(), Vec::new(), Vec::new());
    for time in times {
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
