//! A stepper, its observer and a pace become a run: the one place where they meet.

use super::Begin;
use crate::run::Run;
use liouville_core::method::{Estimating, Stepper};
use liouville_core::problem::Observe;
use liouville_core::problem::mechanical::{Carried, Observer, Path};
use liouville_core::run::{self, Controlled, Equal, Pace, Watcher};
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
    S: Stepper + Clone + Sync + 'static,
    S::State: Carried + Clone + Send + Sync,
{
    let (t0, t1, steps, every) = begin.span;
    let pace = Equal::new(t0, (t1 - t0) / steps as f64, steps);
    paced(
        py,
        begin,
        (stepper, observer, state),
        pace,
        steps / every + 2,
    )
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
    S: Estimating + Clone + Sync + 'static,
    S::State: Carried + Clone + Send + Sync,
{
    let (t0, t1, ..) = begin.span;
    let pace = Controlled::new(t0, t1, first, least);
    paced(py, begin, (stepper, observer, state), pace, 0)
}

/// A run at this pace, watched if that is asked for, with so many records expected.
fn paced<'py, S, P>(
    py: Python<'py>,
    begin: &Begin<'_>,
    (stepper, observer, state): (S, Observer, S::State),
    pace: P,
    expected: usize,
) -> PyResult<Bound<'py, PyAny>>
where
    S: Stepper + Clone + Sync + 'static,
    S::State: Carried + Clone + Send + Sync,
    P: Pace<S> + Sync + 'static,
{
    let every = begin.span.3;
    let width = observer.width(&state);
    let Some(watching) = &begin.watch else {
        let run = run::Run::new(stepper, observer, state, pace, every, expected);
        return Run::handed(py, run, &[width]);
    };
    let path = Path::new(observer.model().clone(), watching.order);
    let (events, times) = (watching.events.clone(), watching.times.clone());
    let expected = times.as_ref().map_or(expected, Vec::len);
    let watch = Watcher::new(path, stepper.clone(), &state, events, times);
    let run = run::Run::watched(stepper, observer, state, pace, (every, expected), watch);
    Run::handed(py, run, &[width])
}
