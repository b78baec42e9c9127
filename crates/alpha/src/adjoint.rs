//! Adjoints of recorded steps of the α family.
//!
//! With (ȳ1, z̄1, ā1) the cotangents of a step's end e(x, u), φ̄1 that of its φ1, and E(x, u) = 0 its equations,
//!
//!     E_uᵀ v = e_uᵀ (ȳ1, z̄1, ā1) + (φ̄1, 0, ..),     x̄ = e_xᵀ (ȳ1, z̄1, ā1) − E_xᵀ v.

use super::linear_step::{StepMatrix, append_unknowns, carried, resize};
use super::slopes::AlphaSlopes;
use super::state::AlphaState;
use super::tangent::AlphaTangents;
use super::{Alpha, Reactions, begins_again};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{add_scaled, copy};
use liouville_base::recorder::{Recordable, StepRecord};
use liouville_base::tape::{Registers, Tape};
use liouville_problem::{Cotangents, Mass, PointAdjoint, TangentState, finite};

/// Tapes of the transposed derivatives of a step; their last input is the parameters.
#[derive(Clone, Debug)]
pub struct AlphaTransposed {
    /// (t0, h, y0, z0, a0, φ0, u, w) → e_uᵀ w
    pub unknowns: Tape,
    /// (t0, h, y0, z0, a0, φ0, u, v, w) → e_xᵀ w − E_xᵀ v
    pub step: Tape,
    /// (t, y, z, φ, c) → (F − M φ)_xᵀ c
    pub start: Tape,
}

impl AlphaTransposed {
    /// Whether they are the transposes of these derivatives, with so many coordinates and parameters.
    #[must_use]
    pub fn fit(&self, slopes: &AlphaSlopes, n: usize, params: usize) -> bool {
        let (unknowns, x) = (slopes.pattern.shape().0, 2 + 4 * n + params);
        let point = [1, 1, n, n, n, n, unknowns];
        let takes = |tape: &Tape, more: &[usize], outputs: usize| {
            let wanted = point.iter().chain(more).chain([&params]);
            tape.inputs().iter().eq(wanted) && tape.outputs() == outputs
        };
        takes(&self.unknowns, &[3 * n], unknowns)
            && takes(&self.step, &[unknowns, 3 * n], x)
            && self.start.inputs() == [1, n, n, n, n, params]
            && self.start.outputs() == 1 + 2 * n + params
    }
}

impl Recordable for Alpha {
    /// Behind a0, as the size of the step wants it.
    fn write_unknowns(&self, state: &AlphaState, out: &mut Vec<f64>) {
        out.clear();
        out.extend_from_slice(&self.solver.a);
        append_unknowns(self, state, out);
    }
}

impl Recordable for AlphaTangents {
    fn write_unknowns(&self, state: &TangentState<AlphaState>, out: &mut Vec<f64>) {
        self.alpha.write_unknowns(&state.motion, out);
    }
}

/// Follows recorded steps of a method of the α family back.
#[derive(Clone, Debug)]
pub struct AlphaAdjoint {
    transposed: AlphaTransposed,
    registers: [Registers<f64>; 3],
    reactions: Reactions,
    matrix: StepMatrix,
    right: Vec<f64>,
    ends: Vec<f64>,
}

impl AlphaAdjoint {
    /// The adjoint of steps with these derivatives.
    pub fn new(
        (slopes, transposed): (AlphaSlopes, AlphaTransposed),
        reactions: Reactions,
        params: &[f64],
        n: usize,
    ) -> Self {
        let tapes = [&transposed.unknowns, &transposed.step, &transposed.start];
        Self {
            registers: tapes.map(|tape| tape.bind(params)),
            reactions,
            matrix: StepMatrix::new(&slopes, params),
            right: vec![0.0; slopes.pattern.shape().0],
            ends: vec![0.0; 3 * n],
            transposed,
        }
    }

    /// The number of cotangents of the carried state.
    pub fn carried(n: usize) -> usize {
        carried(n)
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(
        &mut self,
        record: &StepRecord<AlphaState>,
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (t, h, n) = (record.t, record.h, of.y.len());
        let AlphaState { y, z, phi, .. } = &record.before;
        let (a, unknowns) = record.unknowns.split_at(n);
        let begins = begins_again(&record.before, h);
        let phi = if begins { a } else { phi };
        let at: [&[f64]; 7] = [&[t], &[h], y, z, a, phi, unknowns];
        self.matrix.factor(at)?;
        let [of_unknowns, of_step, _] = &mut self.registers;
        let (by_a, rest) = of.carried.split_at_mut(n);
        let (by_phi, by_size) = rest.split_at_mut(n);
        let (ends_y, ends) = self.ends.split_at_mut(n);
        let (ends_z, ends_a) = ends.split_at_mut(n);
        copy(ends_y, &of.y);
        copy(ends_z, &of.z);
        copy(ends_a, by_a);
        let [t0, h0, y0, z0, a0, phi0, u0] = at;
        let args = [t0, h0, y0, z0, a0, phi0, u0, &self.ends];
        copy(
            &mut self.right,
            self.transposed.unknowns.eval(of_unknowns, args),
        );
        add_scaled(&mut self.right[..n], 1.0, by_phi);
        self.matrix.solve::<true>(&mut self.right);
        let args = [t0, h0, y0, z0, a0, phi0, u0, &self.right, &self.ends];
        let found = self.transposed.step.eval(of_step, args);
        finite(found, Quantity::Derivative, t)?;
        // dt1 = dt0 + h stretch, and the size is carried on
        of.stretch += h * (of.tau[0] + found[1]) + std::mem::take(&mut by_size[0]);
        of.tau[0] += found[0];
        let mut parts = found[2..].chunks_exact(n);
        let mut next = |out: &mut [f64]| parts.next().map_or((), |x| copy(out, x));
        next(&mut of.y);
        next(&mut of.z);
        next(by_a);
        next(by_phi);
        add_scaled(&mut of.tau[1..], 1.0, &found[2 + 4 * n..]);
        if begins {
            let start = AlphaState {
                phi: phi.to_vec(),
                ..record.before.clone()
            };
            return self.leave((t, &start, false), point, of);
        }
        resize::<true>((&record.before, h), &mut of.carried, &mut of.stretch);
        Ok(())
    }

    /// Takes cotangents of the carried state, where a motion begins, to y, z and τ there; accelerations follow
    /// these unless they are `given`.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn leave(
        &mut self,
        (t, state, is_given): (f64, &AlphaState, bool),
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        let (n, mut carried) = (of.y.len(), std::mem::take(&mut of.carried));
        let (a, rest) = carried.split_at_mut(n);
        let phi = &mut rest[..n];
        if !is_given {
            add_scaled(phi, 1.0, a);
        }
        let left = self.leave_phi((t, state), phi, point, of);
        carried.fill(0.0);
        of.carried = carried;
        left
    }

    fn leave_phi(
        &mut self,
        (t, state): (f64, &AlphaState),
        phi: &mut [f64],
        point: &mut PointAdjoint,
        of: &mut Cotangents,
    ) -> Result<(), StepError> {
        if self.reactions == Reactions::Position {
            return point.observe_rate((t, state), phi, of);
        }
        let AlphaState { y, z, phi: at, .. } = state;
        let mut mass = Mass::new(&point.model);
        mass.update(&mut point.model, t, y, z)?;
        mass.solve_transposed(phi);
        let registers = &mut self.registers[2];
        let args = [&[t], &y[..], z, at, &*phi];
        let found = self.transposed.start.eval(registers, args);
        finite(found, Quantity::Derivative, t)?;
        let n = y.len();
        of.tau[0] += found[0];
        add_scaled(&mut of.y, 1.0, &found[1..=n]);
        add_scaled(&mut of.z, 1.0, &found[1 + n..=2 * n]);
        add_scaled(&mut of.tau[1..], 1.0, &found[1 + 2 * n..]);
        Ok(())
    }
}
