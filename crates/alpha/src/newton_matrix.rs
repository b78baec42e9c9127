//! The modified-Newton matrix of the α family.
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
use super::coupling::Coupling;
use super::linearization_point::LinearizationPoint;
use super::unknowns::{AlphaSolver, AlphaStep};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{Pattern, copy, max_norm};
use liouville_base::newton::{BlockHandle, BlockLayout, BlockMatrix, Renewal, Reuse};
use liouville_problem::{Mass, Saddle, SecondOrderModel};

/// The matrix, factored, with the derivatives it came from.
#[derive(Clone, Debug)]
pub(super) struct AlphaMatrix {
    pub(super) reuse: Reuse,
    pub(super) matrix: BlockMatrix,
    blocks: AlphaBlocks,
    coupling: Coupling,
    reactions_by: Reactions,
    point: LinearizationPoint,
    /// M alone.
    pub(super) mass: Mass,
    transport: Option<Transport>,
    mass_values: Vec<f64>,
    /// (F − M u)_y
    pub(super) j_y: Vec<f64>,
    /// F_z
    pub(super) j_z: Vec<f64>,
    /// Multipliers are solved for in this unit, so that soft systems are not singular to the eye.
    unit: f64,
    /// Projects the local error, where that is wanted.
    saddle: Option<Saddle>,
    momentum: Vec<f64>,
    none: Vec<f64>,
}

/// Blocks in the equation for η, and in that of g.
#[derive(Clone, Debug)]
struct AlphaBlocks {
    mass: BlockHandle,
    j_z: BlockHandle,
    j_y: BlockHandle,
    n_y: BlockHandle,
    g_y: BlockHandle,
    r_last: BlockHandle,
    paired: Option<PairedBlocks>,
}

/// Blocks that come with A0 and A1: of A0 in the equation for η, and those in the equations for d and of w.
#[derive(Clone, Debug)]
struct PairedBlocks {
    r_first: BlockHandle,
    j_z: BlockHandle,
    mass: BlockHandle,
    n_y: BlockHandle,
    d_r_first: BlockHandle,
    d_r_last: BlockHandle,
    g_y: BlockHandle,
    w_y: BlockHandle,
}

/// Factors are made anew when a step takes more corrections than the first with them, by more than this.
const SLOW: usize = 2;
/// Up to this size of r_λ, A0 is weighed with its own M where M changes.
const SMALL: usize = 1 << 12;

/// M(t1) M(t0)⁻¹, which takes A0 from the equations of M(t0) to those of M(t1).
#[derive(Clone, Debug)]
struct Transport {
    mass: Mass,
    /// r_λ(t0), transported, column by column.
    r_lam: Vec<f64>,
}

/// The places of all blocks, and the matrix of them.
fn build(
    model: &SecondOrderModel,
    is_paired: bool,
    first_r_lam: &Pattern,
) -> (AlphaBlocks, BlockMatrix) {
    let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
    let (at, general) = (&model.problem.patterns, &model.problem.mechanical.patterns);
    let (d, first, last) = if is_paired {
        (n, 2 * n, 2 * n + m)
    } else {
        (0, 0, n)
    };
    let mut layout = BlockLayout::default();
    let blocks = AlphaBlocks {
        mass: layout.place(&at.mass, 0, 0),
        j_z: layout.place(&at.j_z, 0, 0),
        j_y: layout.place(&at.j_y, 0, 0),
        n_y: layout.place(&at.n_y, 0, 0),
        g_y: layout.place(&general.g_y, if is_paired { first } else { last }, 0),
        r_last: layout.place(&general.r_lam, 0, last),
        paired: is_paired.then(|| PairedBlocks {
            r_first: layout.place(first_r_lam, 0, first),
            j_z: layout.place(&at.j_z, 0, d),
            mass: layout.place(&at.mass, d, d),
            n_y: layout.place(&at.n_y, d, 0),
            d_r_first: layout.place(first_r_lam, d, first),
            d_r_last: layout.place(&general.r_lam, d, last),
            g_y: layout.place(&general.g_y, last, d),
            w_y: layout.place(&at.w_y, last, 0),
        }),
    };
    (blocks, layout.build(last + m, 0))
}

impl AlphaMatrix {
    /// Memory for this model; the projection of local errors only where they are wanted.
    pub(super) fn new(model: &SecondOrderModel, solver: &AlphaSolver, is_controlled: bool) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let at = &model.problem.patterns;
        let is_moved = solver.is_paired() && n * m <= SMALL && !model.problem.has_constant_mass();
        let transport = is_moved.then(|| Transport {
            mass: Mass::new(&model.general),
            r_lam: vec![0.0; n * m],
        });
        let full = is_moved.then(|| Pattern::full(n, m));
        let r_lam = &model.problem.mechanical.patterns.r_lam;
        let (blocks, matrix) = build(model, solver.is_paired(), full.as_ref().unwrap_or(r_lam));
        Self {
            reuse: Reuse::new(&matrix, Renewal::AboveFirst(SLOW)),
            matrix,
            blocks,
            coupling: solver.coupling,
            reactions_by: solver.reactions_by,
            point: LinearizationPoint::new(solver),
            mass: Mass::new(&model.general),
            transport,
            mass_values: vec![0.0; at.mass.len()],
            j_y: vec![0.0; at.j_y.len()],
            j_z: vec![0.0; at.j_z.len()],
            unit: 1.0,
            saddle: is_controlled.then(|| Saddle::new(&model.general)),
            momentum: vec![0.0; n],
            none: vec![0.0; m],
        }
    }

    /// Has the saddle that projects, from the next matrix on.
    pub(super) fn keep_saddle(&mut self, model: &SecondOrderModel) {
        self.saddle
            .get_or_insert_with(|| Saddle::new(&model.general));
    }

    /// Factors the matrix at the solver's unknowns.
    pub(super) fn update(
        &mut self,
        model: &mut SecondOrderModel,
        solver: &mut AlphaSolver,
        step: AlphaStep,
    ) -> Result<(), StepError> {
        solver.place(step.h);
        self.point.move_to(solver, step);
        self.refactor(model, step.h)
    }

    /// Factors the matrix at its point of linearisation, for steps of `h`.
    fn refactor(&mut self, model: &mut SecondOrderModel, h: f64) -> Result<(), StepError> {
        self.reuse.discard();
        let point = &self.point;
        let (t1, y, z) = (point.t + h, &point.y1, &point.z1);
        if let Some(saddle) = &mut self.saddle {
            let lam = &point.reactions[1].lam;
            saddle.update(&mut model.general, t1, y, z, lam)?;
        }
        self.mass.update(&mut model.general, t1, y, z)?;
        self.factor(model, (t1, h))?;
        self.reuse.renew(h);
        Ok(())
    }

    /// Factors the matrix with derivatives at t1, for steps of `h`.
    fn factor(&mut self, model: &mut SecondOrderModel, at: (f64, f64)) -> Result<(), StepError> {
        self.matrix.clear();
        self.add_forces(model, at)?;
        if !self.none.is_empty() {
            self.add_constraints(model, at)?;
        }
        let factored = self.matrix.factor();
        factored.map_err(|_| StepError::SingularNewton)
    }

    /// Whether forces have turned the sign of the matrix for steps of `h`, which is replaced by the one without them.
    pub(super) fn is_turned_by_forces(&mut self, model: &mut SecondOrderModel, h: f64) -> bool {
        let (own, t1) = (self.matrix.is_negative(), self.point.t + h);
        self.reuse.discard();
        own.is_some() && self.factor(model, (t1, 0.0)).is_ok() && self.matrix.is_negative() != own
    }

    /// Makes the factors again that were there when a run was saved.
    pub(super) fn restore_factors(
        &mut self,
        model: &mut SecondOrderModel,
    ) -> Result<(), CheckpointMismatch> {
        let reuse = self.reuse.clone();
        if reuse.h() != 0.0 {
            let factored = self.refactor(model, reuse.h());
            factored.map_err(|_| CheckpointMismatch)?;
            self.reuse = reuse;
        }
        Ok(())
    }

    /// K, and what couples η with d.
    fn add_forces(
        &mut self,
        model: &mut SecondOrderModel,
        (t1, h): (f64, f64),
    ) -> Result<(), StepError> {
        let ([y_phi, z_phi], point) = (self.coupling.phi, &self.point);
        let [mass, j_y, j_z, w_y] = model.jacobian(t1, &point.y1, &point.z1, &point.phi)?;
        copy(&mut self.mass_values, mass);
        copy(&mut self.j_y, j_y);
        copy(&mut self.j_z, j_z);
        let (matrix, at) = (&mut self.matrix, &self.blocks);
        matrix.add(at.mass, mass, 1.0);
        matrix.add(at.j_z, j_z, -z_phi * h);
        matrix.add(at.j_y, j_y, -y_phi * h * h);
        if let Some(at) = &at.paired {
            matrix.add(at.j_z, j_z, -y_phi * h);
            matrix.add(at.mass, mass, 1.0);
        }
        self.unit = max_norm(matrix.values());
        if let Some(at) = &at.paired {
            matrix.add(at.w_y, w_y, h);
        }
        Ok(())
    }

    /// Everything that comes from g and r.
    fn add_constraints(
        &mut self,
        model: &mut SecondOrderModel,
        (t1, h): (f64, f64),
    ) -> Result<(), StepError> {
        let (point, at) = (&self.point, &self.blocks);
        let [first, last] = &point.reactions;
        let (y, z) = (self.coupling.y, self.coupling.z);
        let matrix = &mut self.matrix;
        let [g_y, r_lam] = model.node_blocks(t1, &point.y1, &last.lam)?;
        let unit = self.unit / max_norm(r_lam);
        self.unit = if unit.is_normal() { unit } else { 1.0 };
        let unit = self.unit;
        matrix.add(at.g_y, g_y, 1.0);
        let Some(paired) = &at.paired else {
            matrix.add(at.r_last, r_lam, -unit);
            self.momentum.fill(0.0); // no acceleration
            let n_y = model.reaction_jacobian(t1, &point.y1, &self.momentum, &last.lam)?;
            matrix.add(at.n_y, n_y, self.coupling.phi[0] * h * h);
            return Ok(());
        };
        matrix.add(paired.g_y, g_y, 1.0);
        if let Reactions::Extended {
            predicted: true, ..
        } = self.reactions_by
        {
            let [_, r_lam] = model.node_blocks(t1, &point.predicted, &last.lam)?;
            matrix.add(at.r_last, r_lam, -unit * y[1]);
            matrix.add(paired.d_r_last, r_lam, -unit * z[1]);
        } else {
            matrix.add(at.r_last, r_lam, -unit * y[1]);
            matrix.add(paired.d_r_last, r_lam, -unit * z[1]);
            let n_y = model.reaction_jacobian(t1, &point.y1, &last.a, &last.lam)?;
            matrix.add(at.n_y, n_y, y[1] * h * h);
            matrix.add(paired.n_y, n_y, z[1] * h * h);
        }
        let problem = model.problem.clone();
        let [_, r_lam] = model.node_blocks(point.t, &point.y0, &first.lam)?;
        let r_lam = match &mut self.transport {
            None => r_lam,
            Some(Transport { mass, r_lam: moved }) => {
                moved.fill(0.0);
                let n = point.y0.len();
                let pattern = &problem.mechanical.patterns.r_lam;
                for (&(row, col), value) in pattern.entries().iter().zip(r_lam) {
                    moved[col * n + row] = *value;
                }
                mass.update(&mut model.general, point.t, &point.y0, &point.z0)?;
                let at_end = (&problem.patterns.mass, &self.mass_values[..]);
                for column in moved.chunks_exact_mut(n) {
                    transport(mass, at_end, &mut self.momentum, column);
                }
                moved
            }
        };
        matrix.add(paired.r_first, r_lam, -unit * y[0]);
        matrix.add(paired.d_r_first, r_lam, -unit * z[0]);
        Ok(())
    }

    /// Takes M A0 − r to the equations of M(t1).
    pub(super) fn transport_residual(&mut self, model: &SecondOrderModel, residual: &mut [f64]) {
        if let Some(Transport { mass, .. }) = &mut self.transport {
            let at_end = (&model.problem.patterns.mass, &self.mass_values[..]);
            transport(mass, at_end, &mut self.momentum, residual);
        }
    }

    /// Solves in place; multipliers begin at `multipliers`.
    pub(super) fn solve(&mut self, x: &mut [f64], multipliers: usize) {
        self.matrix.solve(x);
        x[multipliers..]
            .iter_mut()
            .for_each(|lam| *lam *= self.unit);
    }

    /// The saddle that projects.
    pub(super) fn saddle(&mut self) -> Option<&mut Saddle> {
        self.saddle.as_mut()
    }

    /// `x = P x`, with P the projection along r_λ onto the nullspace of the constraints.
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

liouville_base::checkpoint!(AlphaMatrix { reuse, point });
