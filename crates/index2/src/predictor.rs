//! Start values of the stages, from the polynomials of degree s − 1 through V_i and Z_i of the step before.
//!
//! CollocationStages have an error of order h^s that ends of steps have not: polynomials through both would feel it.

use super::stages::CollocationStages;
use liouville_base::linalg::copy;
use liouville_base::newton::{self, Polynomial};

/// A predictor of the curves V and Z.
pub(super) fn predictor(stages: &CollocationStages) -> newton::Predictor {
    let c = &stages.c;
    let curve = |width| Polynomial::new(c, c, width);
    newton::Predictor::new(vec![curve(stages.v.cols()), curve(stages.z.cols())])
}

/// Writes the extrapolated unknowns, and the last velocity before; says whether there was a step to extrapolate.
pub(super) fn extrapolate(
    held: &mut newton::Predictor,
    stages: &mut CollocationStages,
    slope: &mut [f64],
    h: f64,
) -> bool {
    let is_held = held.update_weights(h);
    if is_held {
        let last = if held.is_undone() {
            0
        } else {
            stages.count() - 1
        };
        copy(slope, held.curves[0].values.row(last));
        held.curves[0].extrapolate(stages.v.flat_mut());
        held.curves[1].extrapolate(stages.z.flat_mut());
    }
    is_held
}

/// Keeps the stages of a finished step.
pub(super) fn keep(held: &mut newton::Predictor, stages: &CollocationStages, h: f64) {
    copy(held.curves[0].values.flat_mut(), stages.v.flat());
    copy(held.curves[1].values.flat_mut(), stages.z.flat());
    held.hold(h);
}
