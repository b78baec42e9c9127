//! The composition schemes, as Python sees them.

use liouville_base::tableau::Scheme;
use liouville_base::tableau::composition::Weights;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// All schemes by name: order, kind, source, the digits they are defined by, and their maps as
/// (whether it is the adjoint, fraction of the step).
#[pyfunction]
pub(crate) fn compositions(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let schemes = PyDict::new(py);
    for scheme in Scheme::all() {
        let dict = PyDict::new(py);
        let digits = PyDict::new(py);
        let kind = match scheme.weights {
            Weights::Basic => "basic",
            Weights::Symmetric { gammas } => {
                digits.set_item("gammas", gammas.to_vec())?;
                "symmetric"
            }
            Weights::Adjoint { a, b } => {
                digits.set_item("a", a.to_vec())?;
                digits.set_item("b", b.to_vec())?;
                "adjoint"
            }
        };
        dict.set_item("order", scheme.order)?;
        dict.set_item("kind", kind)?;
        dict.set_item("source", scheme.source)?;
        dict.set_item("digits", digits)?;
        dict.set_item("flows", scheme.flows())?;
        schemes.set_item(scheme.name, dict)?;
    }
    Ok(schemes)
}
