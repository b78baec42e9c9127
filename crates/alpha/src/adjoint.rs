//! Adjoints of recorded steps of the α family.
//!
//! With (ȳ1, z̄1, ā1) the cotangents of a step's end e(x, u), φ̄1 that of its φ1, and E(x, u) = 0 its equations,
//!
//!     E_uᵀ v = e_uᵀ (ȳ1, z̄1, ā1) + (φ̄1, 0, ..),     x̄ = e_xᵀ (ȳ1, z̄1, ā1) − E_xᵀ v.

use super::state::AlphaState;
use super::tangent::{AlphaSlopes, ratio, write_unknowns};
use super::{Alpha, Reactions};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Pattern, add_scaled, copy};
use liouville_base::method::{Estimating, Stats, Stepper};
use liouville_base::newton::{BlockHandle, BlockLayout, BlockMatrix};
use liouville_base::tape::{Registers, Tape};
use liouville_problem::{Cotangents, Model, PointAdjoint, finite};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

/// A step with what solved its equations.
#[derive(Clone, Debug)]
pub struct AlphaRecord {
    t: f64,
    h: f64,
    before: AlphaState,
    /// a0, as the size of the step wants it.
    a: Vec<f64>,
    unknowns: Vec<f64>,
    /// The state that it led to.
    pub end: AlphaState,
}

impl AlphaRecord {
    /// Time at its end.
    pub fn time(&self) -> f64 {
        self.t + self.h
    }
}

/// Records that a stepper shares with what follows its steps back.
#[derive(Clone, Debug, Default)]
pub struct AlphaRecords(Arc<Mutex<Vec<AlphaRecord>>>);

impl AlphaRecords {
    /// The records, for as long as nothing else wants them.
    pub fn lock(&self) -> MutexGuard<'_, Vec<AlphaRecord>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A method of the α family that records its steps; they have the bits of those without.
#[derive(Clone, Debug)]
pub struct AlphaRecorder {
    alpha: Alpha,
    records: AlphaRecords,
}

impl AlphaRecorder {
    /// The method, and where it records.
    pub fn new(alpha: Alpha, records: AlphaRecords) -> Self {
        Self { alpha, records }
    }
}

impl Stepper for AlphaRecorder {
    type State = AlphaState;

    fn step(&mut self, t: f64, h: f64, state: &mut AlphaState) -> Result<(), StepError> {
        let before = state.clone();
        self.alpha.step(t, h, state)?;
        let mut unknowns = Vec::new();
        write_unknowns(&self.alpha, state, &mut unknowns);
        self.records.lock().push(AlphaRecord {
            t,
            h,
            before,
            a: self.alpha.solver.a.clone(),
            unknowns,
            end: state.clone(),
        });
        Ok(())
    }

    fn forget(&mut self) {
        self.alpha.forget();
    }

    fn stats(&self) -> Stats {
        self.alpha.stats()
    }
}

impl Estimating for AlphaRecorder {
    fn error(&self) -> f64 {
        self.alpha.error()
    }

    fn error_order(&self) -> f64 {
        self.alpha.error_order()
    }

    fn undo(&mut self, state: &mut AlphaState) {
        self.alpha.undo(state);
        self.records.lock().pop();
    }
}

// What is recorded is made again with the steps.
liouville_base::checkpoint!(AlphaRecorder { alpha });

/// Cotangents of a motion whose states have accelerations of their own.
#[derive(Clone, Debug)]
pub struct AlphaCotangents {
    /// Those of y, z, time and parameters, and of the length of the steps.
    pub point: Cotangents,
    a: Vec<f64>,
    phi: Vec<f64>,
}

impl AlphaCotangents {
    /// Those of nothing.
    pub fn zeros(n: usize, width: usize) -> Self {
        Self {
            point: Cotangents::zeros(n, width),
            a: vec![0.0; n],
            phi: vec![0.0; n],
        }
    }
}

/// Follows recorded steps of a method of the α family back.
#[derive(Clone, Debug)]
pub struct AlphaAdjoint {
    slopes: AlphaSlopes,
    transposed: AlphaTransposed,
    registers: [Registers<f64>; 4],
    matrix: BlockMatrix,
    block: BlockHandle,
    right: Vec<f64>,
    ends: Vec<f64>,
}

impl AlphaAdjoint {
    /// The adjoint of steps with these derivatives.
    pub fn new(slopes: AlphaSlopes, transposed: AlphaTransposed, params: &[f64], n: usize) -> Self {
        let (block, matrix) = of_pattern(&slopes.pattern);
        let tapes = [
            &slopes.matrix,
            &transposed.unknowns,
            &transposed.step,
            &transposed.start,
        ];
        Self {
            registers: tapes.map(|tape| tape.bind(params)),
            matrix,
            block,
            right: vec![0.0; slopes.pattern.shape().0],
            ends: vec![0.0; 3 * n],
            slopes,
            transposed,
        }
    }

    /// Takes cotangents from the end of a step to its start.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn follow(
        &mut self,
        record: &AlphaRecord,
        of: &mut AlphaCotangents,
    ) -> Result<(), StepError> {
        let (t, h, n) = (record.t, record.h, of.a.len());
        let AlphaState { y, z, phi, .. } = &record.before;
        let point: [&[f64]; 7] = [&[t], &[h], y, z, &record.a, phi, &record.unknowns];
        let [of_matrix, of_unknowns, of_step, _] = &mut self.registers;
        let values = self.slopes.matrix.eval(of_matrix, point);
        finite(values, Quantity::Derivative, t)?;
        self.matrix.clear();
        self.matrix.add(self.block, values, 1.0);
        self.matrix
            .factor()
            .map_err(|_| StepError::SingularNewton)?;
        let (by_y, rest) = self.ends.split_at_mut(n);
        let (by_z, by_a) = rest.split_at_mut(n);
        copy(by_y, &of.point.y);
        copy(by_z, &of.point.z);
        copy(by_a, &of.a);
        let [t0, h0, y0, z0, a0, phi0, u0] = point;
        let args = [t0, h0, y0, z0, a0, phi0, u0, &self.ends];
        copy(
            &mut self.right,
            self.transposed.unknowns.eval(of_unknowns, args),
        );
        add_scaled(&mut self.right[..n], 1.0, &of.phi);
        self.matrix.solve_transposed(&mut self.right);
        let args = [t0, h0, y0, z0, a0, phi0, u0, &self.right, &self.ends];
        let found = self.transposed.step.eval(of_step, args);
        finite(found, Quantity::Derivative, t)?;
        let point = &mut of.point;
        // dt1 = dt0 + h stretch
        point.stretch += h * (point.tau[0] + found[1]);
        point.tau[0] += found[0];
        let mut parts = found[2..].chunks_exact(n);
        let mut next = |out: &mut [f64]| parts.next().map_or((), |x| copy(out, x));
        next(&mut point.y);
        next(&mut point.z);
        next(&mut of.a);
        next(&mut of.phi);
        // a0 is φ0 + r (a0 − φ0) of the state before
        let r = ratio(&record.before, h);
        add_scaled(&mut of.phi, 1.0 - r, &of.a);
        for a in &mut of.a {
            *a *= r;
        }
        add_scaled(&mut point.tau[1..], 1.0, &found[2 + 4 * n..]);
        Ok(())
    }

    /// Ends at the start of a run, where accelerations follow coordinates and velocities unless they are `given`.
    ///
    /// # Errors
    /// A derivative that is not finite, or a singular matrix.
    pub fn leave(
        &mut self,
        (t, state, is_given): (f64, &AlphaState, bool),
        reactions: Reactions,
        (model, adjoint): (&mut Model, &mut PointAdjoint),
        of: &mut AlphaCotangents,
    ) -> Result<(), StepError> {
        let (a, phi) = (&of.a, &mut of.phi);
        if !is_given {
            add_scaled(phi, 1.0, a);
        }
        if reactions == Reactions::Position {
            return adjoint.observe_rate((t, state), phi, &mut of.point);
        }
        let AlphaState { y, z, phi: at, .. } = state;
        let problem = model.problem.clone();
        let (block, mut mass) = of_pattern(&problem.patterns.p_z);
        mass.add(block, model.stage_blocks(t, y, z)[0], 1.0);
        mass.factor().map_err(|_| StepError::SingularNewton)?;
        mass.solve_transposed(phi);
        let registers = &mut self.registers[3];
        let found = self
            .transposed
            .start
            .eval(registers, [&[t], y, z, at, &*phi]);
        finite(found, Quantity::Derivative, t)?;
        let n = y.len();
        of.point.tau[0] += found[0];
        add_scaled(&mut of.point.y, 1.0, &found[1..=n]);
        add_scaled(&mut of.point.z, 1.0, &found[1 + n..=2 * n]);
        add_scaled(&mut of.point.tau[1..], 1.0, &found[1 + 2 * n..]);
        Ok(())
    }
}

/// A matrix of one block.
pub(super) fn of_pattern(pattern: &Pattern) -> (BlockHandle, BlockMatrix) {
    let mut layout = BlockLayout::default();
    let block = layout.place(pattern, 0, 0);
    let matrix = layout.build(pattern.shape().0, 0);
    (block, matrix)
}
