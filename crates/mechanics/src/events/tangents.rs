//! Tangents of events: of when they are met, of the states there, and of those after resets.
//!
//! With ũ and t̃ the tangents after a part of a step of a length that is held, and w the derivative by that length,
//!
//!     du = ũ + κ w,   dt = t̃ + κ,   κ = −(e_x x̃)/(e_y w_y + e_z w_z + e_t),
//!
//! as de = 0. The derivative by the length is a direction of its own, the last of a state's, which begins from zero with
//! each step. The step after an event ends at the end of the step that it has cut: its length takes up the change of the event's
//! time. At a given time κ is −t̃.

use super::linear_reset::LinearReset;
use super::slopes::{FollowEvents, Meeting, SlopesModel};
use super::times::Given;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, add_scaled, dot};
use liouville_problem::{BeginTangents, Carried, Directions, RateTangents, Side, TangentState};

/// Derivatives of a motion at its points and through its resets, and of the state that its method carries after these.
pub struct MotionDerivatives<S> {
    /// Derivatives of the rates and multipliers at a point.
    pub point: Box<dyn RateTangents>,
    /// Of resets.
    pub reset: Box<dyn LinearReset>,
    /// Of what the method carries besides, if anything.
    pub carried: Option<Box<dyn BeginTangents<S>>>,
}

/// Finds the tangents of events in some directions.
pub struct TangentEvents<S> {
    events: Vec<SlopesModel>,
    of: MotionDerivatives<S>,
    /// All that a state has, the last of them that of the length of a step.
    directions: Directions,
    /// Tangents of λ, a row for each direction.
    lam: Matrix,
    /// The start of the run, and its tangents.
    start: (f64, Vec<f64>),
    /// A direction of (t, y, z, λ, θ).
    along: Vec<f64>,
}

impl<S: Carried> TangentEvents<S> {
    /// Tangents of these events, along a run from `start` with so many multipliers, in these directions and in that of
    /// the length of a step, which comes last.
    pub fn new(
        events: Vec<SlopesModel>,
        of: MotionDerivatives<S>,
        directions: Directions,
        (start, multipliers): (f64, usize),
    ) -> Self {
        let of_start = (0..directions.count()).map(|k| directions.tau[(k, 0)]);
        Self {
            events,
            of,
            lam: Matrix::zeros(directions.count(), multipliers),
            start: (start, of_start.collect()),
            directions,
            along: Vec::new(),
        }
    }

    /// Finds the tangents of λ in all directions, which `lam` has then.
    fn solve(&mut self, t: f64, state: &TangentState<S>) -> Result<(), StepError> {
        let Some(of) = state.tangents() else {
            return Ok(());
        };
        let along = (of, &mut self.directions);
        let at = (t, state.y(), state.z());
        self.of.point.multipliers(at, along, &mut self.lam)
    }

    /// Writes a direction of (t, y, z, λ, θ), where λ has so many numbers.
    fn set_along(&mut self, direction: usize, state: &TangentState<S>, multipliers: usize) {
        let along = &mut self.along;
        along.clear();
        along.push(state.t[direction]);
        along.extend_from_slice(state.y.row(direction));
        along.extend_from_slice(state.z.row(direction));
        // of redundant constraints there are more, which no event depends on
        let own = self.lam.row(direction);
        along.extend((0..multipliers).map(|k| own.get(k).copied().unwrap_or(0.0)));
        along.extend_from_slice(&self.directions.tau.row(direction)[1..]);
    }

    /// Makes the last direction the derivative along the motion on one side; nothing goes on from there but by a reset.
    fn set_flow(
        &mut self,
        (t, side): (f64, Side),
        state: &mut TangentState<S>,
    ) -> Result<(), StepError> {
        let last = self.directions.count() - 1;
        let TangentState {
            motion,
            y,
            z,
            t: dt,
            ..
        } = state;
        let out = [y.row_mut(last), z.row_mut(last)];
        let at = (t, motion.y(), motion.z());
        self.of.point.flow(at, side, out)?;
        dt[last] = 1.0;
        Ok(())
    }

    /// The tangent of the time `t` of a step's end, where no event has moved it.
    fn held(&self, direction: usize, t: f64) -> f64 {
        let (start, of_start) = &self.start;
        of_start[direction] + self.directions.stretch[direction] * (t - start)
    }

    /// Adds so many times the derivative by the length of a step to each direction.
    fn move_by(&self, size: impl Fn(usize, &TangentState<S>) -> f64, state: &mut TangentState<S>) {
        let last = self.directions.count() - 1;
        for direction in 0..last {
            let size = size(direction, state);
            if size == 0.0 {
                continue;
            }
            for rows in [&mut state.y, &mut state.z, &mut state.carried] {
                let n = rows.cols();
                let (head, tail) = rows.flat_mut().split_at_mut(last * n);
                add_scaled(&mut head[direction * n..(direction + 1) * n], size, tail);
            }
            state.t[direction] += size * state.t[last];
        }
    }
}

impl<S: Carried + Send + Sync> FollowEvents<TangentState<S>> for TangentEvents<S> {
    fn begin(&mut self, state: &mut TangentState<S>) {
        let last = self.directions.count() - 1;
        for rows in [&mut state.y, &mut state.z, &mut state.carried] {
            rows.row_mut(last).fill(0.0);
        }
        state.t[last] = 0.0;
    }

    fn align(&mut self, t: f64, state: &mut TangentState<S>) {
        if self.events.is_empty() {
            return;
        }
        let last = self.directions.count() - 1;
        // of directions that the events leave alone nothing changes but roundoff
        let size =
            |k: usize, state: &TangentState<S>| (self.held(k, t) - state.t[k]) / state.t[last];
        self.move_by(size, state);
    }

    fn meet(&mut self, met: Meeting<'_>, state: &mut TangentState<S>) -> Result<(), StepError> {
        let (t, last) = (met.t, self.directions.count() - 1);
        if met.part == 0.0 {
            self.set_flow((t, Side::Before(met.h)), state)?;
        }
        if met.needs_lam {
            self.solve(t, state)?;
        }
        let motion = (state.y().to_vec(), state.z().to_vec());
        let point = (t, [&motion.0[..], &motion.1, met.lam]);
        let gradient = self.events[met.event].gradient(point)?.to_vec();
        self.set_along(last, state, met.lam.len());
        let slope = dot(&gradient, &self.along);
        met.check(slope / state.t[last])?;
        for direction in 0..last {
            self.set_along(direction, state, met.lam.len());
            let size = -dot(&gradient, &self.along) / slope;
            let own = |k: usize, _: &TangentState<S>| if k == direction { size } else { 0.0 };
            self.move_by(own, state);
        }
        Ok(())
    }

    #[allow(clippy::float_cmp)] // 0 is the start of the step
    fn hold(&mut self, at: Given, state: &mut TangentState<S>) -> Result<(), StepError> {
        let last = self.directions.count() - 1;
        if at.is_after || at.part == 0.0 {
            self.set_flow((at.t, Side::After(at.h)), state)?;
        }
        let held = |k: usize| {
            if at.is_of_step {
                self.held(k, at.t)
            } else {
                0.0
            }
        };
        let size = |k: usize, state: &TangentState<S>| (held(k) - state.t[k]) / state.t[last];
        self.move_by(size, state);
        Ok(())
    }

    fn reset(
        &mut self,
        (index, t): (usize, f64),
        lam: &[f64],
        (before, after): (&TangentState<S>, &mut TangentState<S>),
    ) -> Result<(), StepError> {
        let point = (t, [before.y(), before.z(), lam]);
        self.solve(t, before)?;
        let ends = [after.motion.y(), after.motion.z()];
        self.of.reset.make(&mut self.events[index], point, ends)?;
        for direction in 0..self.directions.count() {
            self.set_along(direction, before, lam.len());
            let (along, slopes) = (&self.along, &mut self.events[index]);
            let out = [after.y.row_mut(direction), after.z.row_mut(direction)];
            self.of.reset.push(slopes, point, along, out)?;
            after.t[direction] = before.t[direction];
        }
        match &mut self.of.carried {
            Some(carried) => carried.begin(t, &mut self.directions, after),
            None => Ok(()),
        }
    }

    fn record(
        &mut self,
        t: f64,
        state: &TangentState<S>,
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        self.solve(t, state)?;
        for direction in 0..self.directions.count() - 1 {
            row.push(state.t[direction]);
            row.extend_from_slice(state.y.row(direction));
            row.extend_from_slice(state.z.row(direction));
            row.extend_from_slice(self.lam.row(direction));
        }
        Ok(())
    }
}
