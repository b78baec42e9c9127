//! Mechanical systems in.

use crate::convert::{Made, Recipe, item, optional, pattern, tape_of};
use crate::errors::refused;
use liouville_mechanics::run::Pools;
use liouville_problem::{
    Nonholonomic, NonholonomicPatterns, Patterns, Redundant, SensitivityPatterns,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, OnceLock};

/// A mechanical system in the core's terms, and what its runs have left for the next.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Mechanical(
    pub(crate) Arc<liouville_problem::Mechanical>,
    pub(crate) Arc<Pools>,
    Made,
);

#[pymethods]
impl Mechanical {
    /// Tapes by name; patterns by name as (rows, columns, row of each entry, column of each entry). There
    /// is no "nonholonomic" where the system has no such constraint. With "reactions" of all constraints, `left_out`
    /// says which of them have no other tapes.
    #[new]
    #[pyo3(signature = (n, m, is_linear, tapes, patterns, left_out = Vec::new()))]
    fn new(
        n: usize,
        m: usize,
        is_linear: bool,
        tapes: &Bound<'_, PyDict>,
        patterns: &Bound<'_, PyDict>,
        left_out: Vec<usize>,
    ) -> PyResult<Self> {
        let tape = |name: &str| tape_of(tapes, name);
        let pattern = |name: &str| pattern(&item(patterns, name)?);
        let v_z = optional(patterns, "v_z", pattern)?;
        let nonholonomic = if tapes.contains("nonholonomic")? {
            let at = NonholonomicPatterns {
                k_y: pattern("k_y")?,
                k_z: pattern("k_z")?,
                r_y: pattern("rn_y")?,
                r_z: pattern("rn_z")?,
                r_nu: pattern("rn_nu")?,
                w_y: pattern("w_y")?,
            };
            Some(Box::new(Nonholonomic {
                l: at.k_z.shape().0,
                values: tape("nonholonomic")?,
                blocks: tape("nonholonomic_blocks")?,
                hidden: tape("nonholonomic_hidden")?,
                patterns: at,
            }))
        } else {
            None
        };
        let redundant = if tapes.contains("reactions")? {
            Some(Box::new(Redundant {
                reactions: tape("reactions")?,
                pattern: pattern("reactions")?,
                left_out: left_out.clone(),
            }))
        } else {
            None
        };
        let made = Made::of(tapes.py(), (n, m, is_linear, tapes, patterns, left_out))?;
        let system = liouville_problem::Mechanical {
            n,
            m,
            is_linear,
            stage: tape("stage")?,
            stage_blocks: tape("stage_blocks")?,
            stage_jacobian: tape("stage_jacobian")?,
            node: tape("node")?,
            node_blocks: tape("node_blocks")?,
            node_jacobian: tape("node_jacobian")?,
            end: tape("end")?,
            acceleration: tape("acceleration")?,
            patterns: Patterns {
                p_z: pattern("p_z")?,
                v_z,
                p_y: pattern("p_y")?,
                f_y: pattern("f_y")?,
                f_z: pattern("f_z")?,
                v_y: pattern("v_y")?,
                g_y: pattern("g_y")?,
                r_lam: pattern("r_lam")?,
                r_y: pattern("r_y")?,
            },
            nonholonomic,
            redundant,
            schur_plan: OnceLock::new(),
            mass_plan: OnceLock::new(),
            compensated_g: OnceLock::new(),
        };
        let system = system.checked().map_err(refused)?;
        Ok(Self(Arc::new(system), Arc::default(), made))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.2.again::<Self>(py)
    }
}

/// Derivatives of a mechanical system by time and parameters, and of its accelerations.
#[pyclass(frozen, module = "liouville._core")]
#[derive(Clone)]
pub(crate) struct Sensitivity(pub(crate) Arc<liouville_problem::Sensitivity>, Made);

#[pymethods]
impl Sensitivity {
    /// Tapes and patterns by name; there is no "v_tau" where v is z, and no "nonholonomic" where
    /// the system has no such constraint.
    #[new]
    fn new(
        problem: &Bound<'_, Mechanical>,
        tapes: &Bound<'_, PyDict>,
        patterns: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let tape = |name: &str| tape_of(tapes, name);
        let pattern = |name: &str| pattern(&item(patterns, name)?);
        let v_tau = optional(patterns, "v_tau", pattern)?;
        let made = Made::of(tapes.py(), (problem, tapes, patterns))?;
        let sensitivity = liouville_problem::Sensitivity {
            mechanical: problem.get().0.clone(),
            stage: tape("stage")?,
            node: tape("node")?,
            hidden: tape("hidden")?,
            motion: tape("motion")?,
            nonholonomic: optional(tapes, "nonholonomic", tape)?,
            patterns: SensitivityPatterns {
                p_tau: pattern("p_tau")?,
                f_tau: pattern("f_tau")?,
                v_tau,
                g_tau: pattern("g_tau")?,
                r_tau: pattern("r_tau")?,
                w_y: pattern("w_y")?,
                w_tau: pattern("w_tau")?,
                motion: [
                    pattern("motion_y")?,
                    pattern("motion_z")?,
                    pattern("motion_tau")?,
                ],
                rate: [pattern("rate_y")?, pattern("rate_z")?, pattern("rate_tau")?],
                nonholonomic: if patterns.contains("k_tau")? {
                    Some([pattern("k_tau")?, pattern("rn_tau")?])
                } else {
                    None
                },
            },
        };
        Ok(Self(
            Arc::new(sensitivity.checked().map_err(refused)?),
            made,
        ))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Recipe<'py> {
        self.1.again::<Self>(py)
    }
}
