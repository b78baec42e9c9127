//! Methods for Schrödinger equations, by the attributes of their dataclasses.

use crate::convert::Values;
use crate::errors::refused;
use crate::operator::Hamiltonian;
use liouville_waves::method::{
    BegunRun, Driven, Eigenpairs, Looks, MagnusTolerance, ShearProgram, SplitTolerance, TermBounds,
    Windows,
};
use liouville_waves::run::{self, Method};
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::sync::Arc;

/// A method, by the attributes of its dataclass; `norm_tol` is how far the norm may be off.
#[derive(FromPyObject)]
pub(crate) enum WaveMethod<'py> {
    Shears {
        coefficients: Values<'py>,
        shift: f64,
        norm_tol: f64,
    },
    Chebyshev {
        bounds: (f64, f64),
        rate: f64,
        norm_tol: f64,
        windows: Vec<usize>,
    },
    Diagonal {
        energies: Values<'py>,
        real: Values<'py>,
        imaginary: Values<'py>,
        norm_tol: f64,
    },
    Lanczos {
        dimension: usize,
        rate: f64,
        norm_tol: f64,
    },
    Processed {
        order: usize,
        stages: usize,
        shift: f64,
        theta: f64,
        norm_tol: f64,
    },
    Magnus {
        scheme: (usize, usize),
        coefficients: Values<'py>,
        theta: f64,
        norm_tol: f64,
        parts: Parts,
    },
    MagnusSteps {
        scheme: (usize, usize),
        rate: f64,
        tol: f64,
        norm_tol: f64,
        parts: Parts,
        breaks: Vec<f64>,
    },
    MagnusSeries {
        scheme: (usize, usize),
        rate: f64,
        norm_tol: f64,
        parts: Parts,
    },
    Driven(DrivenMethod),
    SplitSteps(SplitMethod),
    Splitting {
        scheme: String,
        norm_tol: f64,
    },
}

/// A split operator to a tolerance.
#[derive(FromPyObject)]
pub(crate) struct SplitMethod {
    scheme: String,
    order: usize,
    rate: f64,
    beta: f64,
    energy: f64,
    first: f64,
    longest: f64,
    /// Parts of the wave numbers, and the longest step of each.
    bands: Vec<(f64, f64)>,
    breaks: Vec<f64>,
    /// Start and end of the run, times of samples and others, and densities, at which functions of time are looked at.
    looks: (f64, f64, Vec<f64>, Vec<f64>, Vec<f64>),
    norm_tol: f64,
    begun: Option<Py<SplitBeginning>>,
}

/// The beginning of a run by a split operator: the pairs of transforms that it took, the time that it reached, and the next step.
#[pyclass(frozen, module = "liouville._core")]
pub(crate) struct SplitBeginning(pub(crate) run::Beginning);

#[pymethods]
impl SplitBeginning {
    #[getter]
    fn pairs(&self) -> usize {
        self.0.flows
    }

    #[getter]
    fn reached(&self) -> f64 {
        self.0.reached
    }

    #[getter]
    fn next(&self) -> f64 {
        self.0.next
    }

    /// A copy of it is none: another run begins anew.
    fn __reduce__(own: PyRef<'_, Self>) -> (Py<PyType>, ()) {
        (own.py().None().bind(own.py()).get_type().unbind(), ())
    }
}

impl SplitMethod {
    pub(crate) fn read(self, hamiltonian: &Hamiltonian) -> PyResult<Method> {
        let (start, end, knots, outputs, densities) = self.looks;
        let looks = Looks {
            span: (start, end),
            knots,
            outputs,
            densities,
        };
        let tolerance = SplitTolerance {
            looks,
            order: self.order,
            rate: self.rate,
            beta: self.beta,
            energy: self.energy,
            first: self.first,
            longest: self.longest,
            bands: self.bands,
            breaks: self.breaks,
        };
        let (norm, tolerance) = (self.norm_tol, Some(tolerance));
        let begun = self.begun.map(|own| own.get().0.begun.clone());
        let begun = begun.unwrap_or_default();
        let found = Method::splitting(&self.scheme, &hamiltonian.inner, norm, tolerance, begun);
        found.map_err(refused)
    }
}

/// Series in time for H(t).
#[derive(FromPyObject)]
pub(crate) struct DrivenMethod {
    parts: Parts,
    breaks: Vec<f64>,
    rate: f64,
    norm_tol: f64,
    by_differences: bool,
}

impl DrivenMethod {
    pub(crate) fn read(self) -> Driven {
        Driven {
            bounds: term_bounds(self.parts),
            by_differences: self.by_differences,
            breaks: self.breaks,
            rate: self.rate,
            tolerance: self.norm_tol,
        }
    }
}

/// An interval of energies.
type Bounds = (f64, f64);

/// The parts of H(t): how many terms each has, bounds of each and of H, a grid of weights with bounds at its corners, and
/// start, end, knots and outputs of the run.
type Parts = (
    Vec<usize>,
    Vec<Bounds>,
    Option<Bounds>,
    Vec<Vec<f64>>,
    Vec<Bounds>,
    (f64, f64, Vec<f64>, Vec<f64>),
);

fn term_bounds((groups, parts, given, axes, corners, run): Parts) -> TermBounds {
    let (start, end, knots, outputs) = run;
    TermBounds {
        groups,
        parts,
        given,
        axes,
        corners,
        span: (start, end),
        knots,
        outputs,
        ..TermBounds::default()
    }
}

/// Energies, and eigenvectors as rows of real and imaginary parts.
fn eigenpairs(parts: [Values<'_>; 3]) -> PyResult<Eigenpairs> {
    let [energies, real, imaginary] = parts.map(|part| part.as_slice().map(<[f64]>::to_vec));
    let levels = Eigenpairs::new(energies?, real?, imaginary?);
    levels.ok_or_else(|| refused("each level has an energy and a vector as long"))
}

impl WaveMethod<'_> {
    /// The method, for runs of this Hamiltonian.
    pub(crate) fn read(self, hamiltonian: &Hamiltonian) -> PyResult<Method> {
        let found = match self {
            Self::Shears {
                coefficients,
                shift,
                norm_tol: tolerance,
            } => Method::Shears {
                program: run::shears(coefficients.as_slice()?),
                shift,
                tolerance,
            },
            Self::Chebyshev {
                bounds,
                rate,
                norm_tol: tolerance,
                windows,
            } => Method::Chebyshev {
                bounds,
                rate,
                tolerance,
                windows: Windows::new(windows),
            },
            Self::Diagonal {
                energies,
                real,
                imaginary,
                norm_tol: tolerance,
            } => Method::Diagonal {
                levels: Arc::new(eigenpairs([energies, real, imaginary])?),
                tolerance,
            },
            Self::Lanczos {
                dimension,
                rate,
                norm_tol: tolerance,
            } => Method::Lanczos {
                dimension,
                rate,
                tolerance,
            },
            Self::Processed {
                order,
                stages,
                shift,
                theta,
                norm_tol,
            } => Method::processed((order, stages), shift, theta, norm_tol).map_err(refused)?,
            Self::Magnus {
                scheme,
                coefficients,
                theta,
                norm_tol: tolerance,
                parts,
            } => Method::Magnus {
                nodes: run::nodes(scheme).map_err(refused)?,
                exponential: ShearProgram {
                    program: run::shears(coefficients.as_slice()?),
                    theta,
                    tolerance,
                },
                bounds: term_bounds(parts),
            },
            Self::MagnusSteps {
                scheme,
                rate,
                tol: whole,
                norm_tol: norm,
                parts,
                breaks,
            } => Method::MagnusSteps {
                nodes: run::nodes(scheme).map_err(refused)?,
                tolerance: MagnusTolerance { rate, whole, norm },
                bounds: term_bounds(parts),
                breaks,
            },
            Self::MagnusSeries {
                scheme,
                rate,
                norm_tol: tolerance,
                parts,
            } => Method::MagnusSeries {
                nodes: run::nodes(scheme).map_err(refused)?,
                rate,
                tolerance,
                bounds: term_bounds(parts),
            },
            Self::Driven(driven) => Method::Driven {
                driven: driven.read(),
                times: Vec::new(),
            },
            Self::SplitSteps(method) => method.read(hamiltonian)?,
            Self::Splitting { scheme, norm_tol } => {
                let (begun, own) = (BegunRun::default(), &hamiltonian.inner);
                Method::splitting(&scheme, own, norm_tol, None, begun).map_err(refused)?
            }
        };
        Ok(found)
    }
}
