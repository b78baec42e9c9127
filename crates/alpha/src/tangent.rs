//! Steps of the α family with their tangents.
//!
//! With x = (t0, h, y0, z0, a0, φ0, θ), u the unknowns (φ1, A0, A1, Λ0, Λ1) of a step, E(x, u) = 0 its equations and
//! e(x, u) = (y1, z1, a1) its end,
//!
//!     E_u du = −E_x dx,   de = e_x dx + e_u du,
//!
//! at the solution that the step has found. Where the size of the steps changes, a0 is φ0 + r (a0 − φ0) of the step
//! before, with r = h/h₀ the ratio of the sizes and dr = r (dh/h − dh₀/h₀): the last of these is carried along. Where a
//! motion begins M dφ0 = (F − M φ0)_x dx, and da0 = dφ0.

use super::adjoint::of_pattern;
use super::slopes::AlphaSlopes;
use super::start_tangents::AlphaStartTangents;
use super::state::AlphaState;
use super::tangent_errors::TangentErrors;
use super::{Alpha, begins_again};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Matrix, add_scaled, copy};
use liouville_base::method::{Estimating, Stats, Stepper};
use liouville_base::newton::{BlockHandle, BlockMatrix};
use liouville_base::tape::Registers;
use liouville_problem::{
    BeginTangents, Directions, LargestError, SensitivityModel, TangentState, finite,
};

/// A method of the α family at work on a state and its tangents.
#[derive(Clone, Debug)]
pub struct AlphaTangents {
    pub(super) alpha: Alpha,
    linear: LinearAlpha,
    directions: Directions,
    /// The tangents where a motion begins.
    starts: AlphaStartTangents,
    before: TangentState<AlphaState>,
    /// The state as it was carried, where the step has begun again.
    carried: Option<TangentState<AlphaState>>,
    /// Of tangents in random directions: one where errors control the steps.
    errors: Vec<TangentErrors>,
}

/// The equations of a step, linearised at its solution.
#[derive(Clone, Debug)]
pub(super) struct LinearAlpha {
    slopes: AlphaSlopes,
    registers: [Registers<f64>; 3],
    matrix: BlockMatrix,
    block: BlockHandle,
    unknowns: Vec<f64>,
    along: Vec<f64>,
    right: Vec<f64>,
}

impl AlphaTangents {
    /// The method with tangents of a motion from `motion` at `t`: changes of its coordinates and velocities, a row for
    /// each direction. Accelerations follow those, unless they are `given`.
    ///
    /// # Errors
    /// A derivative at the start that is not finite, or a singular matrix.
    pub fn new(
        alpha: Alpha,
        (slopes, params): (AlphaSlopes, &[f64]),
        (sensitivity, mut directions): (SensitivityModel, Directions),
        (t, motion, is_given): (f64, AlphaState, bool),
        (y, z): (Matrix, Matrix),
    ) -> Result<(Self, TangentState<AlphaState>), StepError> {
        let n = y.cols();
        let dt: Vec<f64> = (0..directions.count())
            .map(|k| directions.tau[(k, 0)])
            .collect();
        let mut state = TangentState {
            carried: Matrix::zeros(y.rows(), carried(n)),
            motion,
            y,
            z,
            t: dt,
        };
        let mut starts = AlphaStartTangents::new(&alpha, (&slopes, params), sensitivity);
        starts.begin(t, &mut directions, &mut state)?;
        if is_given {
            for direction in 0..directions.count() {
                state.carried.row_mut(direction)[..n].fill(0.0);
            }
        }
        let errors = TangentErrors::new(&alpha, starts.clone(), &state.motion, params);
        let stepper = Self {
            errors: errors.into_iter().collect(),
            starts,
            before: state.clone(),
            carried: None,
            linear: LinearAlpha::new(slopes, params),
            alpha,
            directions,
        };
        Ok((stepper, state))
    }

    /// The same for parts of steps, whose errors are not asked for.
    #[must_use]
    pub fn alone(&self) -> Self {
        Self {
            errors: Vec::new(),
            ..self.clone()
        }
    }

    /// The largest error, of the motion or of a tangent.
    fn largest(&self) -> LargestError {
        let of_tangents = self.errors.iter().map(|errors| errors.tangents.largest);
        LargestError::of(&self.alpha, of_tangents)
    }

    /// Puts back the state that a step has begun again from.
    fn restore_carried(&mut self, state: &mut TangentState<AlphaState>) {
        if let Some(carried) = self.carried.take() {
            *state = carried;
        }
    }

    fn make(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        if self.carried.is_some() {
            self.alpha.leave_cut(t, h, &mut state.motion)?;
            self.starts.begin(t, &mut self.directions, state)?;
            for errors in &mut self.errors {
                errors.forget();
            }
        }
        self.before.clone_from(state);
        for errors in &mut self.errors {
            errors.begin(t, &state.motion)?;
        }
        self.alpha.step(t, h, &mut state.motion)?;
        let followed = self.follow(t, h, state);
        followed.inspect_err(|_| {
            state.clone_from(&self.before);
            for errors in &mut self.errors {
                errors.undo();
            }
        })
    }

    /// Makes the tangents at the end of the step that was just made.
    fn follow(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        let (linear, before) = (&mut self.linear, &self.before);
        let ends = [&before.motion, &state.motion];
        linear.make(&self.alpha, (t, h), ends)?;
        for errors in &mut self.errors {
            errors.follow((&mut self.alpha, linear), (t, h), &state.motion)?;
        }
        for direction in 0..self.directions.count() {
            let along = (&self.directions, direction);
            linear.push(&self.alpha, (t, h), along, (before, state))?;
        }
        Ok(())
    }
}

impl LinearAlpha {
    fn new(slopes: AlphaSlopes, params: &[f64]) -> Self {
        let (block, matrix) = of_pattern(&slopes.pattern);
        let order = slopes.pattern.shape().0;
        let tapes = [&slopes.matrix, &slopes.equations, &slopes.end];
        Self {
            registers: tapes.map(|tape| tape.bind(params)),
            unknowns: Vec::with_capacity(order),
            along: Vec::new(),
            right: vec![0.0; order],
            slopes,
            matrix,
            block,
        }
    }

    /// Linearises the step that a method has just made between these states.
    fn make(
        &mut self,
        alpha: &Alpha,
        (t, h): (f64, f64),
        [before, after]: [&AlphaState; 2],
    ) -> Result<(), StepError> {
        self.unknowns.clear();
        append_unknowns(alpha, after, &mut self.unknowns);
        let AlphaState { y, z, phi, .. } = before;
        let point: [&[f64]; 7] = [&[t], &[h], y, z, &alpha.solver.a, phi, &self.unknowns];
        let values = self.slopes.matrix.eval(&mut self.registers[0], point);
        finite(values, Quantity::Derivative, t)?;
        self.matrix.clear();
        self.matrix.add(self.block, values, 1.0);
        (self.matrix.factor()).map_err(|_| StepError::SingularNewton)
    }

    /// Writes the tangent at the end of the step in a direction.
    pub(super) fn push(
        &mut self,
        alpha: &Alpha,
        (t, h): (f64, f64),
        (directions, direction): (&Directions, usize),
        (before, state): (&TangentState<AlphaState>, &mut TangentState<AlphaState>),
    ) -> Result<(), StepError> {
        let AlphaState { y, z, phi, .. } = &before.motion;
        let (n, ratio) = (y.len(), ratio(&before.motion, h));
        let along = &mut self.along;
        along.clear();
        along.push(before.t[direction]);
        let stretch = directions.stretch[direction];
        along.push(h * stretch);
        along.extend_from_slice(before.y.row(direction));
        along.extend_from_slice(before.z.row(direction));
        let (da, rest) = before.carried.row(direction).split_at(n);
        let (dphi, last) = rest.split_at(n);
        along.extend(da.iter().zip(dphi).map(|(a, phi)| phi + ratio * (a - phi)));
        // the ratio changes where one size does and the other not
        let apart = of_sizes(&before.motion, h) * (stretch - last[0]);
        add_scaled(&mut along[2 + 2 * n..], apart, &before.motion.a);
        add_scaled(&mut along[2 + 2 * n..], -apart, phi);
        along.extend_from_slice(dphi);
        along.extend_from_slice(&directions.tau.row(direction)[1..]);
        let [_, of_equations, of_end] = &mut self.registers;
        let (t0, h0, a, u): (&[f64], &[f64], &[f64], &[f64]) =
            (&[t], &[h], &alpha.solver.a, &self.unknowns);
        let args = [t0, h0, y, z, a, phi, u, along];
        let rates = self.slopes.equations.eval(of_equations, args);
        self.right.fill(0.0);
        add_scaled(&mut self.right, -1.0, rates);
        self.matrix.solve(&mut self.right);
        let args = [t0, h0, y, z, a, phi, u, along, &self.right];
        let ends = self.slopes.end.eval(of_end, args);
        finite(ends, Quantity::Derivative, t)?;
        copy(state.y.row_mut(direction), &ends[..n]);
        copy(state.z.row_mut(direction), &ends[n..2 * n]);
        let (a, rest) = state.carried.row_mut(direction).split_at_mut(n);
        copy(a, &ends[2 * n..]);
        copy(&mut rest[..n], &self.right[..n]);
        rest[n] = stretch;
        state.t[direction] = before.t[direction] + h * stretch;
        Ok(())
    }

    /// δa0 and the tangents of the unknowns, of the last direction.
    pub(super) fn moves(&self, n: usize) -> [&[f64]; 2] {
        [&self.along[2 + 2 * n..2 + 3 * n], &self.right]
    }
}

/// By which factor a0 − φ0 changes before a step of h.
pub(super) fn ratio(before: &AlphaState, h: f64) -> f64 {
    if before.h == 0.0 { 1.0 } else { h / before.h }
}

/// Derivative of h/h0 by the relative stretch of the step.
pub(super) fn of_sizes(before: &AlphaState, h: f64) -> f64 {
    if before.h == 0.0 { 0.0 } else { h / before.h }
}

/// The number of tangents of the carried state: a and φ, and the part of itself by which the last step
/// became longer.
pub(super) const fn carried(n: usize) -> usize {
    2 * n + 1
}

/// Appends the unknowns of the step that has led to a state: φ1, A0 and A1 where there are any, and multipliers.
pub(super) fn append_unknowns(alpha: &Alpha, state: &AlphaState, out: &mut Vec<f64>) {
    out.extend_from_slice(&state.phi);
    let [first, last] = &alpha.kept;
    if alpha.solver.is_paired() {
        for part in [&first.a, &last.a, &first.lam] {
            out.extend_from_slice(part);
        }
    }
    out.extend_from_slice(&last.lam);
}

impl Stepper for AlphaTangents {
    type State = TangentState<AlphaState>;

    fn step(
        &mut self,
        t: f64,
        h: f64,
        state: &mut TangentState<AlphaState>,
    ) -> Result<(), StepError> {
        self.carried = begins_again(&state.motion, h).then(|| state.clone());
        let made = self.make(t, h, state);
        if made.is_err() {
            self.restore_carried(state);
        }
        made
    }

    fn forget(&mut self) {
        self.alpha.forget();
        for errors in &mut self.errors {
            errors.forget();
        }
    }

    fn stats(&self) -> Stats {
        self.alpha.stats()
    }
}

impl Estimating for AlphaTangents {
    fn error(&self) -> f64 {
        self.largest().error
    }

    fn error_order(&self) -> f64 {
        self.largest().order
    }

    fn undo(&mut self, state: &mut TangentState<AlphaState>) {
        for errors in &mut self.errors {
            errors.undo();
        }
        self.alpha.undo(&mut state.motion);
        state.clone_from(&self.before);
        self.restore_carried(state);
    }

    fn most_corrections(&self) -> f64 {
        self.alpha.most_corrections()
    }

    fn insist(&mut self, insists: bool) {
        self.alpha.insist(insists);
    }
}

// Tangents are saved with the state; other memory is rewritten in each step.
liouville_base::checkpoint!(AlphaTangents { alpha, errors });
