//! Starts that violate their constraints, and records whose energy cannot be right.

use crate::errors::refused;
use crate::mechanical::Mechanical;
use liouville_mechanics::problem::{
    self, EnergyColumns, Kind, KineticColumns, Model, Tolerances, Violation,
};
use numpy::{PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Member, kind and number of a constraint, its value, and the largest allowed.
type Violated = (usize, &'static str, usize, f64, f64);

/// Record, member, the energy at the start, and of a jump its part of the energy's size.
type Changed = (usize, usize, f64, Option<f64>);

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

/// The first of k records whose energy has changed by more than its own size, else the record before a jump: with its
/// member, the energy at the start, and of a jump its part of the energy's size; None if there is neither. Rows have
/// shape (k, width) or (k, P, width). `kinetic` is its column, or those of the first of n velocities and momenta with
/// n. `start` has the energies at the start of all members; with `rises` only a gain counts.
#[pyfunction]
#[pyo3(signature = (rows, energy, kinetic, start, rises))]
pub(crate) fn energy_change(
    py: Python<'_>,
    rows: PyReadonlyArrayDyn<'_, f64>,
    energy: usize,
    kinetic: KineticAt,
    start: Option<Vec<f64>>,
    rises: bool,
) -> PyResult<Option<Changed>> {
    let shape = rows.shape();
    let width = shape.last().copied().unwrap_or(0);
    let (kinetic, end) = match kinetic {
        KineticAt::Recorded(at) => (KineticColumns::Recorded(at), at + 1),
        KineticAt::Product(v, p, n) => (KineticColumns::Product { v, p, n }, v.max(p) + n),
    };
    if shape.len() < 2 || energy >= width || end > width {
        return Err(refused("records are rows with all these columns"));
    }
    let members: usize = shape[1..shape.len() - 1].iter().product();
    if start.as_ref().is_some_and(|start| start.len() != members) {
        return Err(refused("each member has one energy at the start"));
    }
    let (rows, at) = (rows.as_slice()?, EnergyColumns { energy, kinetic });
    let found =
        py.detach(|| problem::energy_change(rows, (members, width), at, start.as_deref(), rises));
    Ok(found.map(|found| (found.record, found.member, found.first, found.jump)))
}

/// Columns of the kinetic energy, or of the first of n velocities and momenta with n.
#[derive(FromPyObject)]
pub(crate) enum KineticAt {
    Product(usize, usize, usize),
    Recorded(usize),
}
