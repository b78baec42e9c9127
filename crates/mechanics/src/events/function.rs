//! Values of an event's function: on the interpolated trajectory, and at states.

use super::event::Event;
use liouville_base::error::StepError;
use liouville_base::run::NOISE;
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

/// How much roundoff of a state may change an event's function; nothing is known of one that depends on multipliers.
pub(super) fn noise<M: Dynamics>(
    path: &mut Path<M>,
    event: &mut Event,
    t: f64,
    state: &impl Carried,
) -> Result<f64, StepError> {
    let mut noise: f64 = 0.0;
    if event.needs_lam {
        return Ok(noise);
    }
    let mut first = None;
    for part in [0.0, NOISE, -NOISE] {
        path.move_near(t, state, [part, part]);
        let Point { y, z, .. } = path.point();
        let value = event.at(t, (y, z), path.lam())?;
        noise = noise.max((value - *first.get_or_insert(value)).abs());
    }
    Ok(noise)
}
