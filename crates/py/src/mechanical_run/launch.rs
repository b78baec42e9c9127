//! A stepper, its observer and a control become a run: the one place where they meet.

use super::Begin;
use super::control::{Control, refused};
use crate::run::Run;
use liouville_base::method::{Estimating, Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::run::{self, Adaptive, Fixed, Reversible, StepControl};
use liouville_mechanics::events::DenseDetector;
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
    let control = Fixed::new(t0, (t1 - t0) / steps as f64, steps);
    paced(
        py,
        begin,
        (stepper, observer, state),
        control,
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
    let control = Adaptive::new(t0, t1, first, least);
    paced(py, begin, (stepper, observer, state), control, 0)
}

/// A run at this control, watched if that is asked for, with so many records expected.
fn paced<'py, S, P>(
    py: Python<'py>,
    begin: &Begin<'_>,
    (stepper, observer, state): (S, Observer, S::State),
    control: P,
    expected: usize,
) -> PyResult<Bound<'py, PyAny>>
where
    S: Stepper + Clone + Sync + 'static,
    S::State: Carried + Clone + Send + Sync,
    P: StepControl<S> + Sync + 'static,
{
    let every = begin.span.3;
    let width = observer.width(&state);
    let Some(watching) = &begin.watch else {
        let run = run::Run::new(stepper, observer, state, control, every, expected);
        return Run::handed(py, run, &[width]);
    };
    let path = Path::new(observer.model().clone(), watching.order);
    let (events, times) = (watching.events.clone(), watching.times.clone());
    let expected = times.as_ref().map_or(expected, Vec::len);
    let watch = DenseDetector::new(path, stepper.clone(), &state, events, times);
    let run = run::Run::watched(stepper, observer, state, control, (every, expected), watch);
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
        Control::Fixed => return launch(py, begin, stepper, observer, state),
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
    let control = Reversible::new((t0, t1), first, least, monitor, &state);
    paced(py, begin, (stepper, observer, state), control, 0)
}
