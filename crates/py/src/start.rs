//! Starts that violate their constraints, and records whose energy cannot be right.

use crate::convert::Mechanical;
use crate::errors::refused;
use liouville_mechanics::problem::{
    EnergyColumns, Kind, Model, Tolerances, Violation, energy_change,
};
use numpy::{PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The first of P states (t, y, z) that violates a constraint, with the constraint's kind and number, its value and
/// the largest allowed; None if there is none. `params` has a row for each, or one for all; tolerances are relative
/// and of coordinates that are zero.
#[pyfunction]
pub(crate) fn violation(
    py: Python<'_>,
    problem: PyRef<'_, Mechanical>,
    params: PyReadonlyArray2<'_, f64>,
    t: f64,
    start: (PyReadonlyArray2<'_, f64>, PyReadonlyArray2<'_, f64>),
    tolerances: (f64, f64),
    with_hidden: bool,
) -> PyResult<Option<(usize, &'static str, usize, f64, f64)>> {
    let (y, z) = start;
    let problem = problem.0.clone();
    let ([members, n], rows) = ([y.shape()[0], problem.n], params.shape()[0]);
    let width = problem.stage.inputs().last().copied().unwrap_or(0);
    let fits = [y.shape(), z.shape()] == [[members, n]; 2]
        && params.shape()[1] == width
        && [1, members].contains(&rows);
    if !fits {
        return Err(refused("states and params are arrays of rows"));
    }
    let (params, y, z) = (params.as_slice()?, y.as_slice()?, z.as_slice()?);
    let tolerances = Tolerances {
        relative: tolerances.0,
        floor: tolerances.1,
    };
    let found = py.detach(|| {
        let mut model: Option<Model> = None;
        (0..members).find_map(|member| {
            if member < rows {
                let own = &params[member * width..][..width];
                model = Some(Model::new(problem.clone(), own));
            }
            let at = member * n..(member + 1) * n;
            let state = (&y[at.clone()], &z[at]);
            let found = model.as_mut()?.violation(t, state, tolerances, with_hidden);
            found.map(|found| (member, found))
        })
    });
    Ok(found.map(|(member, found)| {
        let Violation {
            kind,
            index,
            value,
            limit,
        } = found;
        let kind = match kind {
            Kind::Holonomic => "constraint",
            Kind::Hidden => "hidden",
            Kind::Nonholonomic => "nonholonomic",
        };
        (member, kind, index, value, limit)
    }))
}

/// The first of k records, and in it the first member, whose energy has changed by more than its own size; None if
/// there is none. Rows have shape (k, width) or (k, P, width); `columns` are those of the energy, of the first of n
/// velocities and of the first of n momenta. With `rises` only a gain counts.
#[pyfunction]
pub(crate) fn energy_jump(
    py: Python<'_>,
    rows: PyReadonlyArrayDyn<'_, f64>,
    columns: (usize, usize, usize),
    n: usize,
    rises: bool,
) -> PyResult<Option<(usize, usize)>> {
    let (energy, v, p) = columns;
    let shape = rows.shape();
    let width = shape.last().copied().unwrap_or(0);
    if shape.len() < 2 || energy >= width || v.max(p) + n > width {
        return Err(refused("records are rows with all these columns"));
    }
    let members = shape[1..shape.len() - 1].iter().product();
    let (rows, at) = (rows.as_slice()?, EnergyColumns { n, energy, v, p });
    Ok(py.detach(|| energy_change(rows, (members, width), at, rises)))
}
