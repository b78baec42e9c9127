//! Errors of tangents in random directions, where errors control the steps: the estimate of the motion,
//!
//!     h² P (c (δa1 − δa0) + c_A (δA1 − δA0)),
//!
//! with P held, by a tolerance of each tangent's own, see [`TangentSizes`].

use super::tangent::{AlphaStartTangents, LinearAlpha, carried};
use super::{Alpha, AlphaState};
use liouville_base::checkpoint;
use liouville_base::error::StepError;
use liouville_base::linalg::add_scaled;
use liouville_base::method::Tolerance;
use liouville_problem::{
    Mass, MechanicalStart, RandomTangents, SensitivityModel, TangentSizes, TangentStep,
};

/// The errors of tangents, and the largest of the last step.
#[derive(Clone, Debug)]
pub(super) struct TangentErrors {
    tangents: RandomTangents<MechanicalStart<AlphaStartTangents>, AlphaState>,
    sensitivity: SensitivityModel,
    sizes: TangentSizes,
    tolerance: Tolerance,
    mass: Mass,
    error: f64,
}

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
        Some(Self {
            tangents: RandomTangents::new(starts, motion, [n, n, carried(n)], params),
            sensitivity,
            sizes: TangentSizes::new(&tolerance),
            mass: Mass::new(&alpha.model.general),
            tolerance,
            error: f64::INFINITY,
        })
    }

    /// The largest error of the last step, in units of the tolerance.
    pub(super) fn largest(&self) -> f64 {
        self.error
    }

    /// Lets the next step begin a motion.
    pub(super) fn forget(&mut self) {
        self.tangents.forget();
    }

    /// Leaves out the last step, which was rejected or failed.
    pub(super) fn undo(&mut self) {
        self.tangents.undo();
        self.sizes.undo();
    }

    /// Begins a step from a motion: the one before stands.
    ///
    /// # Errors
    /// A derivative where the motion begins that is not finite, or a singular matrix.
    pub(super) fn begin(&mut self, t: f64, motion: &AlphaState) -> Result<(), StepError> {
        self.sizes.begin();
        self.error = 0.0;
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
        let RandomTangents {
            directions,
            before,
            after,
            ..
        } = &mut self.tangents;
        after.motion.clone_from(end);
        (self.mass).update(&mut alpha.model.general, t + h, &end.y, &end.z)?;
        for direction in 0..directions.count() {
            linear.push(alpha, (t, h), (&*directions, direction), (before, after))?;
            let tau = directions.tau(direction, 0.0);
            let at = (t + h, [&end.y[..], &end.z, &alpha.kept[1].lam]);
            let parts = (self.sizes).parts(&mut self.mass, &mut self.sensitivity, at, tau);
            let ends = [&*before, &*after].map(|state| {
                let rows = [&state.y, &state.z, &state.carried];
                rows.map(|rows| rows.row(direction))
            });
            let of = (&mut self.sizes, &mut self.tolerance);
            let error = error(of, alpha, (h, ends, parts), linear.moves(end.y.len()));
            self.error = self.error.max(error);
        }
        Ok(())
    }
}

/// The error of a tangent, with those of y, z and what is carried at the ends of a step, ‖u‖ and ‖a‖, and with δa0 and
/// the tangents of the unknowns.
fn error(
    (sizes, tolerance): (&mut TangentSizes, &mut Tolerance),
    alpha: &mut Alpha,
    (h, ends, parts): (f64, [[&[f64]; 3]; 2], [f64; 2]),
    [da, unknowns]: [&[f64]; 2],
) -> f64 {
    let [y, v] = [0, 1].map(|part| ends.map(|end| end[part]));
    let step = TangentStep { h, y, v, parts };
    if sizes.measure(step, tolerance) == 0.0 {
        return 0.0;
    }
    let n = da.len();
    let [constant, of_reactions] = alpha.error_weights();
    let mut local: Vec<f64> = ends[1][2][..n].to_vec();
    add_scaled(&mut local, -1.0, da);
    for x in &mut local {
        *x *= constant;
    }
    if alpha.solver.is_paired() {
        add_scaled(&mut local, -of_reactions, &unknowns[n..2 * n]);
        add_scaled(&mut local, of_reactions, &unknowns[2 * n..3 * n]);
    }
    for x in &mut local {
        *x *= h * h;
    }
    alpha.matrix.project(&alpha.model, &mut local);
    let error = tolerance.weigh(y, local.iter().copied());
    if error.is_nan() { f64::INFINITY } else { error }
}

checkpoint!(TangentErrors { tangents, sizes });
