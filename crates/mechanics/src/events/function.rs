//! Values of an event's function: on the interpolated trajectory, at states, and near the start of a run.

use super::event::Event;
use super::partial::PartialStep;
use super::search::Node;
use super::{NOISE, SAMPLES};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_problem::{Carried, Dynamics, Path, Point};

/// A start on an event is left for this part of the first step, as a power of 2, or more.
const LEAVING: i32 = -24;

/// An event's function on the interpolated trajectory.
pub(super) fn rough<M: Dynamics>(
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

/// The start of a run for an event: where its function is nothing but roundoff, shortly after it.
pub(super) fn leaving<State: Carried + Checkpoint, M: Dynamics>(
    path: &mut Path<M>,
    partial: &PartialStep<State>,
    event: &mut Event,
    start: Node,
) -> Result<Node, StepError> {
    let slope = (event.samples[0] - start.value).abs() * SAMPLES as f64;
    let mut noise = NOISE * slope * (partial.t / partial.h).abs().max(1.0);
    for parts in [[NOISE, NOISE], [NOISE, -NOISE]] {
        path.move_near(partial.t, &partial.start, parts);
        if event.needs_lam {
            path.solve_there()?;
        }
        let Point { y, z, .. } = path.point();
        let value = event.at(partial.t, (y, z), path.lam())?;
        noise = noise.max((value - start.value).abs());
    }
    if start.value.abs() > noise {
        return Ok(start);
    }
    for power in LEAVING..0 {
        let x = f64::from(power).exp2() / SAMPLES as f64;
        let value = rough(path, event, partial.t + x * partial.h)?;
        if value.abs() > 2.0 * noise {
            return Ok(Node {
                x,
                value,
                is_exact: false,
            });
        }
    }
    Ok(Node {
        value: 0.0,
        ..start
    })
}
