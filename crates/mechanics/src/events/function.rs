//! Values of an event's function: on the interpolated trajectory, and at states.

use super::event::Event;
use liouville_base::error::StepError;
use liouville_problem::{Carried, Dynamics, Path, Point};

/// An event's function on the interpolated trajectory.
pub(super) fn interpolated<M: Dynamics>(
    path: &mut Path<M>,
    event: &mut Event,
    t: f64,
) -> Result<f64, StepError> {
    path.move_to(t);
    if event.needs_lam {
        path.solve_there()?;
    }
    let Point { y, z, .. } = path.point();
    event.at(t, (y, z), path.lam())
}

/// An event's function at a state.
pub(super) fn at<M: Dynamics>(
    path: &mut Path<M>,
    event: &mut Event,
    t: f64,
    state: &impl Carried,
) -> Result<f64, StepError> {
    if event.needs_lam {
        path.solve(t, state)?;
    }
    event.at(t, (state.y(), state.z()), path.lam())
}
