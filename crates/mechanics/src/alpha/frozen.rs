//! The Newton matrix of the α family, frozen and factored.
//!
//! Corrections are h² η of y1 and h ζ of z1. With ζ = (γ/β) η + d, the derivative of F enters one
//! equation only, and with K = M − z_φ h F_z − y_φ h² (F − M u)_y + y_1 h² (M a − r)_y the corrections
//! η, d, dΛ0 and dΛ1 solve
//!
//!     [ K                  −y_φ h F_z   −y_0 r_λ(t0)   −y_1 r_λ(t1) ]
//!     [ z_1 h² (M a − r)_y      M       −z_0 r_λ(t0)   −z_1 r_λ(t1) ]
//!     [ g_y                     0            0              0       ]
//!     [ h w_y                  g_y           0              0       ]
//!
//! with the weights of [`super::coupling::Coupling`]. Without constraints, what is left of it is K; for the
//! relative without A, K with y_φ h² (−r)_y in its last term, bordered by −r_λ and g_y. No entry grows as h → 0: the limit is the matrix of the
//! acceleration-level solve, twice.

use super::Reactions;
use super::origin::Origin;
use super::solve::{Solver, Step};
use crate::problem::{Mass, Saddle, SecondOrderModel};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{Assembly, Factor, Matrix, Pattern, copy, max_norm};

/// The factors, with the derivatives they came from.
#[derive(Clone, Debug)]
pub(super) struct Frozen {
    /// M alone.
    pub(super) mass: Mass,
    transport: Option<Transport>,
    matrix: Assembly,
    factor: Factor,
    mass_values: Vec<f64>,
    /// (F − M u)_y
    pub(super) j_y: Vec<f64>,
    /// F_z
    pub(super) j_z: Vec<f64>,
    /// Multipliers are solved for in this unit, so that soft systems are not singular to the eye.
    unit: f64,
    /// The step they are for; 0 when they are of no use.
    pub(super) h: f64,
    /// Corrections of the first step they were used for; 0 before.
    pub(super) corrections: usize,
    /// Where they were made.
    origin: Origin,
    /// Where the local error is wanted: what projects it.
    saddle: Option<Saddle>,
    momentum: Vec<f64>,
    none: Vec<f64>,
}

/// In a large system, where factors cost ten corrections, steps that differ by less share them.
const SIMILAR: f64 = 0.25;

/// Blocks of the matrix, in the order they are given to the assembly.
const MASS: usize = 0;
const J_Z: usize = 1;
const J_Y: usize = 2;
const N_Y: usize = 3;
const G_Y: usize = 4;
const R_LAST: usize = 5;
const R_FIRST: usize = 6;
const D_J_Z: usize = 7;
const D_MASS: usize = 8;
const D_N_Y: usize = 9;
const D_R_FIRST: usize = 10;
const D_R_LAST: usize = 11;
const D_G_Y: usize = 12;
const W_Y: usize = 13;

/// Up to this size of r_λ, A0 is weighed with its own M where M changes.
const SMALL: usize = 1 << 12;

/// What takes A0, which belongs to M(t0), to the equations of M(t1): M(t1) M(t0)⁻¹.
#[derive(Clone, Debug)]
struct Transport {
    mass: Mass,
    /// r_λ(t0), transported, column by column.
    r_lam: Vec<f64>,
}

fn assembly(model: &SecondOrderModel, is_paired: bool, first_r_lam: &Pattern) -> Assembly {
    let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
    let (at, general) = (&model.problem.patterns, &model.problem.mechanical.patterns);
    let (d, first, last) = if is_paired {
        (n, 2 * n, 2 * n + m)
    } else {
        (0, 0, n)
    };
    let order = last + m;
    let mut blocks: Vec<(&Pattern, usize, usize)> = vec![
        (&at.mass, 0, 0),
        (&at.j_z, 0, 0),
        (&at.j_y, 0, 0),
        (&at.n_y, 0, 0),
        (&general.g_y, if is_paired { first } else { last }, 0),
        (&general.r_lam, 0, last),
    ];
    if is_paired {
        blocks.extend([
            (first_r_lam, 0, first),
            (&at.j_z, 0, d),
            (&at.mass, d, d),
            (&at.n_y, d, 0),
            (first_r_lam, d, first),
            (&general.r_lam, d, last),
            (&general.g_y, last, d),
            (&at.w_y, last, 0),
        ]);
    }
    Assembly::new((order, order), &blocks)
}

impl Frozen {
    /// Memory for this model; the projection of local errors only where they are wanted.
    pub(super) fn new(model: &SecondOrderModel, solver: &Solver, is_controlled: bool) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let at = &model.problem.patterns;
        let is_moved = solver.is_paired() && n * m <= SMALL && !model.problem.has_constant_mass();
        let transport = is_moved.then(|| Transport {
            mass: Mass::new(&model.general),
            r_lam: vec![0.0; n * m],
        });
        let full = is_moved.then(|| Pattern::full(n, m));
        let r_lam = &model.problem.mechanical.patterns.r_lam;
        let matrix = assembly(model, solver.is_paired(), full.as_ref().unwrap_or(r_lam));
        Self {
            mass: Mass::new(&model.general),
            transport,
            factor: Factor::new(matrix.pattern()),
            matrix,
            mass_values: vec![0.0; at.mass.len()],
            j_y: vec![0.0; at.j_y.len()],
            j_z: vec![0.0; at.j_z.len()],
            unit: 1.0,
            h: 0.0,
            corrections: 0,
            origin: Origin::new(solver),
            saddle: is_controlled.then(|| Saddle::new(&model.general)),
            momentum: vec![0.0; n],
            none: vec![0.0; m],
        }
    }

    /// Factors the matrix at the solver's unknowns.
    pub(super) fn update(
        &mut self,
        model: &mut SecondOrderModel,
        solver: &mut Solver,
        step: Step,
    ) -> Result<(), StepError> {
        self.h = 0.0;
        solver.place(step.h);
        let t1 = step.t + step.h;
        if let Some(saddle) = &mut self.saddle {
            let lam = &solver.reactions[1].lam;
            saddle.update(&mut model.general, t1, &solver.y, &solver.z, lam)?;
        }
        self.mass
            .update(&mut model.general, t1, &solver.y, &solver.z)?;
        self.matrix.clear();
        self.add_forces(model, solver, step)?;
        if !self.none.is_empty() {
            self.add_constraints(model, solver, step)?;
        }
        self.factor
            .factor(self.matrix.pattern(), self.matrix.values())
            .map_err(|_| StepError::SingularNewton)?;
        self.h = step.h;
        self.corrections = 0;
        self.origin.keep(solver, step);
        Ok(())
    }

    /// Makes the factors again where they were made before.
    pub(super) fn remake(
        &mut self,
        model: &mut SecondOrderModel,
        solver: &mut Solver,
    ) -> Result<(), CheckpointMismatch> {
        if self.h == 0.0 {
            return Ok(());
        }
        let corrections = self.corrections;
        let origin = self.origin.clone();
        let step = origin.put_back(solver, self.h);
        self.update(model, solver, step)
            .map_err(|_| CheckpointMismatch)?;
        self.corrections = corrections;
        Ok(())
    }

    /// Whether the factors were made for steps of this size.
    pub(super) fn are_for(&self, h: f64) -> bool {
        h.to_bits() == self.h.to_bits()
    }

    /// Whether the factors are good enough to begin a step of this size with.
    pub(super) fn serve(&self, h: f64) -> bool {
        let is_large = matches!(self.factor, Factor::Sparse(_));
        self.are_for(h) || is_large && (h / self.h - 1.0).abs() <= SIMILAR
    }

    /// K, and what couples η with d.
    fn add_forces(
        &mut self,
        model: &mut SecondOrderModel,
        at: &Solver,
        Step { t, h, .. }: Step,
    ) -> Result<(), StepError> {
        let [y_phi, z_phi] = at.coupling.phi;
        let [mass, j_y, j_z, w_y] = model.jacobian(t + h, &at.y, &at.z, &at.phi)?;
        copy(&mut self.mass_values, mass);
        copy(&mut self.j_y, j_y);
        copy(&mut self.j_z, j_z);
        let matrix = &mut self.matrix;
        matrix.add(MASS, mass, 1.0);
        matrix.add(J_Z, j_z, -z_phi * h);
        matrix.add(J_Y, j_y, -y_phi * h * h);
        if at.is_paired() {
            matrix.add(D_J_Z, j_z, -y_phi * h);
            matrix.add(D_MASS, mass, 1.0);
            matrix.add(W_Y, w_y, h);
        }
        self.unit = max_norm(self.matrix.values());
        Ok(())
    }

    /// Everything that comes from g and r.
    fn add_constraints(
        &mut self,
        model: &mut SecondOrderModel,
        at: &Solver,
        Step { t, h, state }: Step,
    ) -> Result<(), StepError> {
        let [first, last] = &at.reactions;
        let (y, z) = (at.coupling.y, at.coupling.z);
        let matrix = &mut self.matrix;
        let [g_y, r_lam] = model.node_blocks(t + h, &at.y, &last.lam)?;
        let unit = self.unit / max_norm(r_lam);
        self.unit = if unit.is_normal() { unit } else { 1.0 };
        let unit = self.unit;
        matrix.add(G_Y, g_y, 1.0);
        if !at.is_paired() {
            matrix.add(R_LAST, r_lam, -unit);
            let n_y = model.reaction_jacobian(t + h, &at.y, &at.none, &last.lam)?;
            matrix.add(N_Y, n_y, at.coupling.phi[0] * h * h);
            return Ok(());
        }
        matrix.add(D_G_Y, g_y, 1.0);
        if let Reactions::Extended {
            predicted: true, ..
        } = at.reactions_by
        {
            let [_, r_lam] = model.node_blocks(t + h, &at.predicted, &last.lam)?;
            matrix.add(R_LAST, r_lam, -unit * y[1]);
            matrix.add(D_R_LAST, r_lam, -unit * z[1]);
        } else {
            matrix.add(R_LAST, r_lam, -unit * y[1]);
            matrix.add(D_R_LAST, r_lam, -unit * z[1]);
            let n_y = model.reaction_jacobian(t + h, &at.y, &last.a, &last.lam)?;
            matrix.add(N_Y, n_y, y[1] * h * h);
            matrix.add(D_N_Y, n_y, z[1] * h * h);
        }
        let problem = model.problem.clone();
        let [_, r_lam] = model.node_blocks(t, &state.y, &first.lam)?;
        let r_lam = match &mut self.transport {
            None => r_lam,
            Some(Transport { mass, r_lam: moved }) => {
                moved.fill(0.0);
                let n = state.y.len();
                let pattern = &problem.mechanical.patterns.r_lam;
                for (&(row, col), value) in pattern.entries().iter().zip(r_lam) {
                    moved[col * n + row] = *value;
                }
                mass.update(&mut model.general, t, &state.y, &state.z)?;
                let at_end = (&problem.patterns.mass, &self.mass_values[..]);
                for column in moved.chunks_exact_mut(n) {
                    transport(mass, at_end, &mut self.momentum, column);
                }
                moved
            }
        };
        matrix.add(R_FIRST, r_lam, -unit * y[0]);
        matrix.add(D_R_FIRST, r_lam, -unit * z[0]);
        Ok(())
    }

    /// Takes M A0 − r to the equations of M(t1).
    pub(super) fn move_pull(&mut self, model: &SecondOrderModel, pull: &mut [f64]) {
        if let Some(Transport { mass, .. }) = &mut self.transport {
            let at_end = (&model.problem.patterns.mass, &self.mass_values[..]);
            transport(mass, at_end, &mut self.momentum, pull);
        }
    }

    /// The matrix, dense.
    pub(super) fn matrix(&self) -> Matrix {
        let pattern = self.matrix.pattern();
        let mut dense = Matrix::zeros(pattern.shape().0, pattern.shape().1);
        pattern.add_to(self.matrix.values(), 1.0, &mut dense, 0, 0);
        dense
    }

    /// Solves in place; multipliers begin at `multipliers`.
    pub(super) fn solve(&mut self, x: &mut [f64], multipliers: usize) {
        self.factor.solve(x);
        x[multipliers..]
            .iter_mut()
            .for_each(|lam| *lam *= self.unit);
    }

    /// `x = P x`, with P the projection along r_λ onto what the constraints leave free.
    pub(super) fn project(&mut self, model: &SecondOrderModel, x: &mut [f64]) {
        let Some(saddle) = &mut self.saddle else {
            return;
        };
        if self.none.is_empty() {
            return;
        }
        self.momentum.fill(0.0);
        let pattern = &model.problem.patterns.mass;
        pattern.multiply_add(&self.mass_values, 1.0, x, &mut self.momentum);
        self.none.fill(0.0);
        saddle.solve(&model.general, &mut self.momentum, &mut self.none);
        copy(x, &self.momentum);
    }
}

/// `x = M(t1) M(t0)⁻¹ x`, with M(t0) factored and M(t1) by its pattern and values.
fn transport(start: &mut Mass, end: (&Pattern, &[f64]), spare: &mut [f64], x: &mut [f64]) {
    start.solve(x);
    spare.fill(0.0);
    end.0.multiply_add(end.1, 1.0, x, spare);
    copy(x, spare);
}

// How old the factors are, and where they were made.
liouville_base::checkpoint!(Frozen {
    h,
    corrections,
    origin
});
