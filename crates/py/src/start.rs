//! Starts that violate their constraints.

use crate::errors::refused;
use crate::mechanical::Mechanical;
use liouville_problem::{Kind, Model, Tolerances, Violation};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Member, kind and number of a constraint, its value, and the largest allowed.
type Violated = (usize, &'static str, usize, f64, f64);

/// The first of P states (t, y, z) that violates a constraint, with the constraint's kind and number, its value and
/// the largest allowed; None if there is none. `params` has a row for each, or one for all; tolerances are relative
/// and of coordinates that are zero, with the kind of each coordinate, or none where all have one unit.
#[pyfunction]
pub(crate) fn violation(
    py: Python<'_>,
    problem: PyRef<'_, Mechanical>,
    params: PyReadonlyArray2<'_, f64>,
    t: f64,
    start: (PyReadonlyArray2<'_, f64>, PyReadonlyArray2<'_, f64>),
    tolerances: (f64, f64, Vec<usize>),
    with_hidden: bool,
) -> PyResult<Option<Violated>> {
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
    let (relative, floor, kinds) = tolerances;
    if ![0, n].contains(&kinds.len()) || kinds.iter().any(|kind| *kind > n) {
        return Err(refused("there is a kind for each coordinate, or none"));
    }
    let tolerances = Tolerances {
        relative,
        floor,
        kinds: &kinds,
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
