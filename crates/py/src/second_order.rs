//! Systems in their special forms, as the front end hands them over.

use crate::convert::{Made, Recipe, item, optional, pattern, tape_of};
use crate::errors::refused;
use crate::mechanical::Mechanical;
use liouville_problem::SecondOrderPatterns;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A mechanical system as the α methods step it.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct SecondOrder(pub(crate) Arc<liouville_problem::SecondOrder>, Made);

#[pymethods]
impl SecondOrder {
    /// Tapes and patterns by name; there is no "power" where no force puts energy in.
    #[new]
    fn new(
        problem: &Bound<'_, Mechanical>,
        tapes: &Bound<'_, PyDict>,
        patterns: &Bound<'_, PyDict>,
        power_of_lam: bool,
    ) -> PyResult<Self> {
        let tape = |name: &str| tape_of(tapes, name);
        let pattern = |name: &str| pattern(&item(patterns, name)?);
        let power = optional(tapes, "power", tape)?;
        let made = Made::of(tapes.py(), (problem, tapes, patterns, power_of_lam))?;
        let system = liouville_problem::SecondOrder {
            mechanical: problem.get().0.clone(),
            residual: tape("residual")?,
            jacobian: tape("jacobian")?,
            reaction: tape("reaction")?,
            reaction_jacobian: tape("reaction_jacobian")?,
            power,
            power_of_lam,
            patterns: SecondOrderPatterns {
                mass: pattern("mass")?,
                j_y: pattern("j_y")?,
                j_z: pattern("j_z")?,
                w_y: pattern("w_y")?,
                n_y: pattern("n_y")?,
            },
        };
        Ok(Self(Arc::new(system.checked().map_err(refused)?), made))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.1.again::<Self>(py)
    }
}

/// A mechanical system as RATTLE steps it.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Separable(pub(crate) Arc<liouville_problem::Separable>, Made);

#[pymethods]
impl Separable {
    /// Tapes by name.
    #[new]
    fn new(problem: &Bound<'_, Mechanical>, tapes: &Bound<'_, PyDict>) -> PyResult<Self> {
        let tape = |name: &str| tape_of(tapes, name);
        let made = Made::of(tapes.py(), (problem, tapes))?;
        let system = liouville_problem::Separable {
            mechanical: problem.get().0.clone(),
            force: tape("force")?,
            constraint: tape("constraint")?,
            gradient: tape("gradient")?,
        };
        Ok(Self(Arc::new(system.checked().map_err(refused)?), made))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.1.again::<Self>(py)
    }
}
