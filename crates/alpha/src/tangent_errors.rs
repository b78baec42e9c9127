//! Errors of tangents in random directions, where errors control the steps: the estimate of the motion,
//!
//!     h² P (c (δa1 − δa0) + c_A (δA1 − δA0)),
//!
//! with P held, by a tolerance of each tangent's own, see [`liouville_problem::TangentSizes`].
//!
//! Where δa changes by a hundred times what the steps before let expect a force begins or ends within the step. The
//! velocity is off then by the estimate over h, for as long as the time scale |δy|/|δv|, but no longer than the longest
//! step so far or a thousand of these.

use super::linear_step::{LinearAlpha, carried};
use super::start_tangents::AlphaStartTangents;
use super::{Alpha, AlphaState};
use liouville_base::checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::{add_scaled, copy};
use liouville_base::method::{Estimating, Tolerance};
use liouville_problem::{Mass, MechanicalStart, RandomTangents, SensitivityModel, TangentStep};

/// A change of δa/h by so many times that of the steps before is none of a smooth motion.
const SUDDEN: f64 = 100.0;
/// The part of the change of a step that the next one counts as its own at least.
const KEPT: f64 = 0.5;
/// An error of the velocity is held against the positions for so many steps, or for the longest so far.
const HELD: f64 = 1000.0;
/// The power of h with which that error falls.
const ORDER: f64 = 2.0;

/// Random tangents, and what their errors are found by.
#[derive(Clone, Debug)]
pub(super) struct TangentErrors {
    pub(super) tangents: RandomTangents<MechanicalStart<AlphaStartTangents>, AlphaState>,
    sensitivity: SensitivityModel,
    tolerance: Tolerance,
    mass: Mass,
    /// The local error of a tangent.
    local: Vec<f64>,
    /// By direction, what δa changes by.
    changes: Vec<Change>,
}

/// ‖P (c (δa1 − δa0) + …)‖/h of the steps that stand, of late, and of the last, which may yet be undone: none is below 0.
#[derive(Clone, Copy, Debug)]
struct Change {
    of_late: f64,
    last: f64,
}

const NO_CHANGE: Change = Change {
    of_late: -1.0,
    last: -1.0,
};

impl TangentErrors {
    /// The errors of a method that estimates its own, for a motion with these parameters.
    pub(super) fn new(
        alpha: &Alpha,
        starts: AlphaStartTangents,
        motion: &AlphaState,
        params: &[f64],
    ) -> Option<Self> {
        let (tolerance, n) = (alpha.tolerance.clone()?, motion.y.len());
        let sensitivity = starts.acceleration.sensitivity.clone();
        let model = alpha.model.general.clone();
        let starts = MechanicalStart::new(model, sensitivity.clone(), starts);
        let at = (motion, params);
        let tangents = RandomTangents::new(starts, at, [n, n, carried(n)], &tolerance);
        Some(Self {
            changes: vec![NO_CHANGE; tangents.directions.count()],
            tangents,
            sensitivity,
            mass: Mass::new(&alpha.model.general),
            tolerance,
            local: vec![0.0; n],
        })
    }

    /// Lets the next step begin a motion.
    pub(super) fn forget(&mut self) {
        self.tangents.forget();
        self.changes.fill(NO_CHANGE);
    }

    /// Leaves out the last step, which was rejected or failed.
    pub(super) fn undo(&mut self) {
        self.tangents.undo();
        for change in &mut self.changes {
            change.last = NO_CHANGE.last;
        }
    }

    /// Begins a step from a motion: the one before stands.
    ///
    /// # Errors
    /// A derivative where the motion begins that is not finite, or a singular matrix.
    pub(super) fn begin(&mut self, t: f64, motion: &AlphaState) -> Result<(), StepError> {
        for Change { of_late, last } in &mut self.changes {
            if *last >= 0.0 {
                *of_late = last.max(KEPT * *of_late);
            }
            *last = NO_CHANGE.last;
        }
        self.tangents.begin(t, motion)
    }

    /// Follows a step to its end, where it was linearised, and measures the errors.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular mass.
    pub(super) fn follow(
        &mut self,
        (alpha, linear): (&mut Alpha, &mut LinearAlpha),
        (t, h): (f64, f64),
        end: &AlphaState,
    ) -> Result<(), StepError> {
        self.tangents.after.motion.clone_from(end);
        (self.mass).update(&mut alpha.model.general, t + h, &end.y, &end.z)?;
        for direction in 0..self.tangents.directions.count() {
            let RandomTangents {
                directions,
                before,
                after,
                sizes,
                ..
            } = &mut self.tangents;
            linear.push(alpha, (t, h), (&*directions, direction), (before, after))?;
            let tau = directions.tau(direction, 0.0);
            let at = (t + h, [&end.y[..], &end.z, &alpha.kept[1].lam]);
            let ends = [&*before, &*after];
            let step = TangentStep {
                h,
                y: ends.map(|state| state.y.row(direction)),
                v: ends.map(|state| state.z.row(direction)),
                parts: sizes.parts(&mut self.mass, &mut self.sensitivity, at, tau),
            };
            if sizes.measure(step, &mut self.tolerance) > 0.0 {
                let n = self.local.len();
                copy(&mut self.local, &after.carried.row(direction)[..n]);
                write_error(alpha, h, linear.moves(n), &mut self.local);
                let error = self.tolerance.weigh(step.y, self.local.iter().copied());
                let error = if error.is_nan() { f64::INFINITY } else { error };
                let Change { of_late, last } = &mut self.changes[direction];
                *last = sizes.norm(&self.local) / h.abs().powi(3);
                let is_sudden = *of_late >= 0.0 && *last > SUDDEN * *of_late;
                let held = step
                    .time_scale(sizes)
                    .min(sizes.longest().max(HELD * h.abs()));
                let largest = &mut self.tangents.largest;
                if is_sudden && held > h.abs() {
                    largest.raise(error * held / h.abs(), ORDER);
                } else {
                    largest.raise(error, alpha.error_order());
                }
            }
        }
        Ok(())
    }
}

/// Writes the local error of a tangent in the place of δa1, given δa0 and the tangents of the unknowns.
fn write_error(alpha: &mut Alpha, h: f64, [da, unknowns]: [&[f64]; 2], out: &mut [f64]) {
    let n = out.len();
    let [constant, of_reactions] = alpha.error_weights();
    add_scaled(out, -1.0, da);
    for x in &mut *out {
        *x *= constant;
    }
    if alpha.solver.is_paired() {
        add_scaled(out, -of_reactions, &unknowns[n..2 * n]);
        add_scaled(out, of_reactions, &unknowns[2 * n..3 * n]);
    }
    for x in &mut *out {
        *x *= h * h;
    }
    alpha.matrix.project(&alpha.model, out);
}

checkpoint!(Change { of_late, last });
checkpoint!(TangentErrors { tangents, changes });
