//! A stepper, its observer and a pace become a run: the one place where they meet.

use super::Begin;
use crate::run::Run;
use liouville_core::method::{Estimating, Stepper, Symmetric};
use liouville_core::problem::mechanical::Observer;
use liouville_core::problem::{Monitor, Observe};
use liouville_core::run::{self, Controlled, Equal, Reversible};
use pyo3::prelude::*;

/// A run by equal steps.
pub(super) fn launch<'py, S>(
    py: Python<'py>,
    begin: &Begin<'_>,
    stepper: S,
    observer: Observer,
    state: S::State,
) -> PyResult<Bound<'py, PyAny>>
where
    S: Stepper + Sync + 'static,
    S::State: Send + Sync,
    Observer: Observe<S::State>,
{
    let (t0, t1, steps, every) = begin.span;
    let width = observer.width(&state);
    let pace = Equal::new(t0, (t1 - t0) / steps as f64, steps);
    let expected = steps / every + 2;
    let run = run::Run::new(stepper, observer, state, pace, every, expected);
    Run::handed(py, run, &[width])
}

/// A run whose steps are controlled by their errors, from the first on, none below `least`.
pub(super) fn launch_controlled<'py, S>(
    py: Python<'py>,
    begin: &Begin<'_>,
    stepper: S,
    observer: Observer,
    state: S::State,
    (first, least): (f64, f64),
) -> PyResult<Bound<'py, PyAny>>
where
    S: Estimating + Sync + 'static,
    S::State: Send + Sync,
    Observer: Observe<S::State>,
{
    let (t0, t1, _, every) = begin.span;
    let width = observer.width(&state);
    let pace = Controlled::new(t0, t1, first, least);
    let run = run::Run::new(stepper, observer, state, pace, every, 0);
    Run::handed(py, run, &[width])
}

/// A run whose steps follow a monitor reversibly, from the first on, none below `least`.
pub(super) fn launch_reversible<'py, S, M>(
    py: Python<'py>,
    begin: &Begin<'_>,
    stepper: S,
    observer: Observer,
    state: S::State,
    monitor: M,
    (first, least): (f64, f64),
) -> PyResult<Bound<'py, PyAny>>
where
    S: Symmetric + Sync + 'static,
    S::State: Send + Sync,
    M: Monitor<S::State> + Sync + 'static,
    Observer: Observe<S::State>,
{
    let (t0, t1, _, every) = begin.span;
    let width = observer.width(&state);
    let pace = Reversible::new((t0, t1), first, least, monitor, &state);
    let run = run::Run::new(stepper, observer, state, pace, every, 0);
    Run::handed(py, run, &[width])
}
