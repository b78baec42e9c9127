//! A stepper, its observer and a pace become a run: the one place where they meet.

use super::Begin;
use super::control::{Control, refused};
use crate::run::Run;
use liouville_base::method::{Estimating, Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::run::{self, Controlled, Equal, Pace, Reversible};
use liouville_mechanics::events::Watcher;
use liouville_mechanics::problem::{Carried, MechanicalMonitor, Observer, Path, TimeScale, Traced};
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

/// A run by equal steps, or by steps that follow a monitor reversibly.
pub(super) fn launch_symmetric<'py, S>(
    py: Python<'py>,
    begin: &Begin<'_>,
    stepper: S,
    observer: Observer,
    state: S::State,
) -> PyResult<Bound<'py, PyAny>>
where
    S: Symmetric + Clone + Sync + 'static,
    S::State: Carried + Clone + Send + Sync,
{
    let (first, least, monitor) = match &begin.control {
        Control::Equal => return launch(py, begin, stepper, observer, state),
        Control::Error { .. } => return Err(refused("error")),
        Control::Reversible {
            first,
            least,
            monitor,
        } => (*first, *least, monitor),
    };
    let (t0, t1, ..) = begin.span;
    let model = observer.model().clone();
    let monitor = match monitor {
        Some((tape, of_acceleration)) => MechanicalMonitor::Traced(Box::new(Traced::new(
            model,
            begin.params,
            tape.clone(),
            *of_acceleration,
        ))),
        None => MechanicalMonitor::Own(Box::new(TimeScale::new(
            model,
            (t0, begin.start[0], begin.start[1]),
            first,
        ))),
    };
    let pace = Reversible::new((t0, t1), first, least, monitor, &state);
    paced(py, begin, (stepper, observer, state), pace, 0)
}
