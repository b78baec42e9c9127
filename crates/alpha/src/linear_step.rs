//! A step of the α family, linearised at the solution that it has found.
//!
//! With x = (t0, h, y0, z0, a0, φ0, θ), u the unknowns (φ1, A0, A1, Λ0, Λ1) of a step, E(x, u) = 0 its equations and
//! e(x, u) = (y1, z1, a1) its end,
//!
//!     E_u du = −E_x dx,   de = e_x dx + e_u du.
//!
//! Where the size of the steps changes, a0 is φ0 + r (a0 − φ0) of the step before, with r = h/h₀ the ratio of the sizes
//! and dr = r (dh/h − dh₀/h₀): the last of these is carried along.

use super::Alpha;
use super::slopes::AlphaSlopes;
use super::state::AlphaState;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy};
use liouville_base::linear::{add, add_column, in_order};
use liouville_base::newton::{BlockHandle, BlockLayout, BlockMatrix};
use liouville_base::tape::{Registers, Tape};
use liouville_problem::{Directions, TangentState, finite};

/// E_u of a step.
#[derive(Clone, Debug)]
pub(super) struct StepMatrix {
    tape: Tape,
    registers: Registers<f64>,
    matrix: BlockMatrix,
    block: BlockHandle,
}

impl StepMatrix {
    pub(super) fn new(slopes: &AlphaSlopes, params: &[f64]) -> Self {
        let mut layout = BlockLayout::default();
        let block = layout.place(&slopes.pattern, 0, 0);
        Self {
            registers: slopes.matrix.bind(params),
            tape: slopes.matrix.clone(),
            matrix: layout.build(slopes.pattern.shape().0, 0),
            block,
        }
    }

    /// Factors the matrix at the solution (t0, h, y0, z0, a0, φ0, u) of a step.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub(super) fn factor(&mut self, at: [&[f64]; 7]) -> Result<(), StepError> {
        let values = self.tape.eval(&mut self.registers, at);
        finite(values, Quantity::Derivative, at[0][0])?;
        self.matrix.clear();
        self.matrix.add(self.block, values, 1.0);
        (self.matrix.factor()).map_err(|_| StepError::SingularNewton)
    }

    pub(super) fn solve<const TRANSPOSED: bool>(&mut self, x: &mut [f64]) {
        if TRANSPOSED {
            self.matrix.solve_transposed(x);
        } else {
            self.matrix.solve(x);
        }
    }
}

/// The equations of a step, linearised at its solution.
#[derive(Clone, Debug)]
pub(super) struct LinearAlpha {
    slopes: AlphaSlopes,
    registers: [Registers<f64>; 2],
    matrix: StepMatrix,
    unknowns: Vec<f64>,
    along: Vec<f64>,
    right: Vec<f64>,
}

impl LinearAlpha {
    pub(super) fn new(slopes: AlphaSlopes, params: &[f64]) -> Self {
        let order = slopes.pattern.shape().0;
        Self {
            registers: [&slopes.equations, &slopes.end].map(|tape| tape.bind(params)),
            matrix: StepMatrix::new(&slopes, params),
            unknowns: Vec::with_capacity(order),
            along: Vec::new(),
            right: vec![0.0; order],
            slopes,
        }
    }

    /// Linearises the step that a method has just made between these states.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub(super) fn make(
        &mut self,
        alpha: &Alpha,
        (t, h): (f64, f64),
        [before, after]: [&AlphaState; 2],
    ) -> Result<(), StepError> {
        self.unknowns.clear();
        append_unknowns(alpha, after, &mut self.unknowns);
        let AlphaState { y, z, phi, .. } = before;
        let (a, u) = (&alpha.solver.a, &self.unknowns);
        self.matrix.factor([&[t], &[h], y, z, a, phi, u])
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
        let (n, mut stretch) = (y.len(), directions.stretch[direction]);
        let along = &mut self.along;
        along.clear();
        along.extend([before.t[direction], h * stretch]);
        along.extend_from_slice(before.y.row(direction));
        along.extend_from_slice(before.z.row(direction));
        along.extend_from_slice(before.carried.row(direction));
        let carried = &mut along[2 + 2 * n..];
        resize::<false>((&before.motion, h), carried, &mut stretch);
        along.truncate(2 + 4 * n);
        along.extend_from_slice(&directions.tau.row(direction)[1..]);
        let [of_equations, of_end] = &mut self.registers;
        let (t0, h0, a, u): (&[f64], &[f64], &[f64], &[f64]) =
            (&[t], &[h], &alpha.solver.a, &self.unknowns);
        let args = [t0, h0, y, z, a, phi, u, along];
        let rates = self.slopes.equations.eval(of_equations, args);
        self.right.fill(0.0);
        add_scaled(&mut self.right, -1.0, rates);
        self.matrix.solve::<false>(&mut self.right);
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

/// Takes changes of the carried a, φ and last stretch to that of a0 before a step of h, or cotangents back.
pub(super) fn resize<const TRANSPOSED: bool>(
    (before, h): (&AlphaState, f64),
    carried: &mut [f64],
    stretch: &mut f64,
) {
    if before.h == 0.0 {
        return;
    }
    let (n, r) = (before.a.len(), h / before.h);
    let (a, rest) = carried.split_at_mut(n);
    let (phi, last) = rest.split_at_mut(n);
    for part in in_order::<TRANSPOSED>(3) {
        match part {
            0 => a.iter_mut().for_each(|a| *a *= r),
            1 => add::<TRANSPOSED, _>(a, 1.0 - r, phi),
            _ => {
                for (weight, values) in [(r, &before.a), (-r, &before.phi)] {
                    add_column::<TRANSPOSED, _>(a, weight, values, stretch);
                    add_column::<TRANSPOSED, _>(a, -weight, values, &mut last[0]);
                }
            }
        }
    }
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
