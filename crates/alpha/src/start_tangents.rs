//! Tangents where a motion of the α family begins: M dφ0 = (F − M φ0)_x dx, and da0 = dφ0.

use super::slopes::AlphaSlopes;
use super::state::AlphaState;
use super::{Alpha, Reactions};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::copy;
use liouville_base::tape::{Registers, Tape};
use liouville_problem::{
    Acceleration, AccelerationTangents, BeginTangents, Directions, SensitivityModel, TangentState,
    TangentView, finite,
};

/// The tangents of the carried state where a motion begins: accelerations that follow coordinates and velocities.
#[derive(Clone, Debug)]
pub struct AlphaStartTangents {
    alpha: Alpha,
    pub(super) acceleration: AccelerationTangents,
    tape: Tape,
    registers: Registers<f64>,
}

impl AlphaStartTangents {
    /// Makes the tangents of the start of a method with these derivatives.
    pub fn new(
        alpha: &Alpha,
        (slopes, params): (&AlphaSlopes, &[f64]),
        sensitivity: SensitivityModel,
    ) -> Self {
        Self {
            acceleration: AccelerationTangents::new(alpha.model.general.clone(), sensitivity),
            alpha: alpha.clone(),
            tape: slopes.start.clone(),
            registers: slopes.start.bind(params),
        }
    }

    /// Writes those of φ.
    fn write(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        let AlphaState { y, z, phi, .. } = &state.motion;
        let (n, alpha) = (y.len(), &mut self.alpha);
        if alpha.reactions == Reactions::Position {
            let Acceleration { z_dot, lam, .. } = {
                alpha
                    .acceleration
                    .solve(&mut alpha.model.general, t, y, z)?;
                &alpha.acceleration
            };
            let of = TangentView {
                y: &state.y,
                z: &state.z,
                t: &state.t,
            };
            let (point, carried) = ([&y[..], z, z_dot, lam], &mut state.carried);
            let along = (of, directions);
            return (self.acceleration).solve((t, point), along, |direction, rate, _| {
                copy(&mut carried.row_mut(direction)[n..2 * n], rate);
            });
        }
        let mass = &mut alpha.matrix.mass;
        mass.update(&mut alpha.model.general, t, y, z)?;
        for direction in 0..directions.count() {
            let tau = directions.tau(direction, state.t[direction]);
            let (dy, dz) = (state.y.row(direction), state.z.row(direction));
            let along = [&tau[..1], dy, dz, &tau[1..]].concat();
            let out = &mut state.carried.row_mut(direction)[n..2 * n];
            let found = self
                .tape
                .eval(&mut self.registers, [&[t], y, z, phi, &along]);
            copy(out, found);
            mass.solve(out);
            finite(out, Quantity::Derivative, t)?;
        }
        Ok(())
    }
}

impl BeginTangents<AlphaState> for AlphaStartTangents {
    fn begin(
        &mut self,
        t: f64,
        directions: &mut Directions,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        self.write(t, directions, state)?;
        for direction in 0..directions.count() {
            let (a, rest) = state
                .carried
                .row_mut(direction)
                .split_at_mut(state.y.cols());
            let (phi, last) = rest.split_at_mut(a.len());
            copy(a, phi);
            last.fill(0.0);
        }
        Ok(())
    }
}
