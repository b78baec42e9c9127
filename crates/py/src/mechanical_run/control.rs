//! What decides on the steps, as Python says it.

use crate::convert;
use liouville_base::method::Tolerance;
use liouville_base::tape::Tape;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// What decides on the steps.
pub(super) enum Control {
    /// Their number.
    Fixed,
    /// Their errors; the first step is 0 where the method is to choose it.
    Error {
        tolerance: Tolerance,
        first: f64,
        least: f64,
    },
    /// A monitor of the state, by a rule that can be reversed.
    Reversible {
        first: f64,
        least: f64,
        monitor: Option<(Tape, bool)>,
    },
}

impl Control {
    pub(super) fn read(control: Option<&Bound<'_, PyTuple>>) -> PyResult<Self> {
        let Some(control) = control else {
            return Ok(Self::Fixed);
        };
        match control.get_item(0)?.extract::<String>()?.as_str() {
            "error" => {
                let (_, rtol, atol, first, least): (
                    String,
                    f64,
                    PyReadonlyArray1<'_, f64>,
                    f64,
                    f64,
                ) = control.extract()?;
                let tolerance = Tolerance {
                    rtol,
                    atol: atol.as_slice()?.to_vec(),
                };
                Ok(Self::Error {
                    tolerance,
                    first,
                    least,
                })
            }
            "reversible" => {
                type Monitor<'py> = Option<(PyRef<'py, convert::Tape>, bool)>;
                let (_, first, least, monitor): (String, f64, f64, Monitor<'_>) =
                    control.extract()?;
                let monitor = monitor.map(|(tape, of_z_dot)| (Tape::clone(&tape.0), of_z_dot));
                Ok(Self::Reversible {
                    first,
                    least,
                    monitor,
                })
            }
            other => Err(refused(other)),
        }
    }

    /// Refuses a tolerance of another size than the problem.
    pub(super) fn check(&self, n: usize) -> PyResult<()> {
        match self {
            Self::Error { tolerance, .. } if tolerance.atol.len() != n => {
                Err(PyValueError::new_err(format!("atol has size {n}")))
            }
            _ => Ok(()),
        }
    }
}

/// A control that a method does not have.
pub(super) fn refused(name: &str) -> PyErr {
    PyValueError::new_err(format!("this method has no control {name:?}"))
}
