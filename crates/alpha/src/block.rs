//! The modified-Newton matrix of the α family as it stands.
//!
//! With K = M − z_φ h F_z − y_φ h² (F − M u)_y + y_1 h² (M a − r)_y the corrections η, d, dΛ0 and dΛ1 solve
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
use super::newton_matrix::Derivatives;
use liouville_base::error::StepError;
use liouville_base::linalg::{Pattern, copy, max_norm};
use liouville_base::newton::{BlockHandle, BlockLayout, BlockMatrix};
use liouville_problem::{Mass, SecondOrderModel};

/// Up to this size of r_λ, A0 is weighed with its own M where M changes.
const SMALL: usize = 1 << 12;

/// The matrix, factored.
#[derive(Clone, Debug)]
pub(super) struct AlphaBlock {
    pub(super) matrix: BlockMatrix,
    places: Places,
    coupling: Coupling,
    reactions_by: Reactions,
    transport: Option<Transport>,
    /// Multipliers are solved for in this unit, so that soft systems are not singular to the eye.
    unit: f64,
    momentum: Vec<f64>,
}

/// Blocks in the equation for η, and in that of g.
#[derive(Clone, Debug)]
struct Places {
    mass: BlockHandle,
    j_z: BlockHandle,
    j_y: BlockHandle,
    n_y: BlockHandle,
    g_y: BlockHandle,
    r_last: BlockHandle,
    paired: Option<PairedPlaces>,
}

/// Blocks that come with A0 and A1: of A0 in the equation for η, and those in the equations for d and of w.
#[derive(Clone, Debug)]
struct PairedPlaces {
    r_first: BlockHandle,
    j_z: BlockHandle,
    mass: BlockHandle,
    n_y: BlockHandle,
    d_r_first: BlockHandle,
    d_r_last: BlockHandle,
    g_y: BlockHandle,
    w_y: BlockHandle,
}

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
) -> (Places, BlockMatrix) {
    let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
    let (at, general) = (&model.problem.patterns, &model.problem.mechanical.patterns);
    let (d, first, last) = if is_paired {
        (n, 2 * n, 2 * n + m)
    } else {
        (0, 0, n)
    };
    let mut layout = BlockLayout::default();
    let places = Places {
        mass: layout.place(&at.mass, 0, 0),
        j_z: layout.place(&at.j_z, 0, 0),
        j_y: layout.place(&at.j_y, 0, 0),
        n_y: layout.place(&at.n_y, 0, 0),
        g_y: layout.place(&general.g_y, if is_paired { first } else { last }, 0),
        r_last: layout.place(&general.r_lam, 0, last),
        paired: is_paired.then(|| PairedPlaces {
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
    (places, layout.build(last + m, 0))
}

impl AlphaBlock {
    /// Memory for this model.
    pub(super) fn new(
        model: &SecondOrderModel,
        coupling: Coupling,
        reactions_by: Reactions,
    ) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let is_paired = reactions_by.are_paired(m);
        let is_moved = is_paired && n * m <= SMALL && !model.problem.has_constant_mass();
        let transport = is_moved.then(|| Transport {
            mass: Mass::new(&model.general),
            r_lam: vec![0.0; n * m],
        });
        let full = is_moved.then(|| Pattern::full(n, m));
        let r_lam = &model.problem.mechanical.patterns.r_lam;
        let (places, matrix) = build(model, is_paired, full.as_ref().unwrap_or(r_lam));
        Self {
            matrix,
            places,
            coupling,
            reactions_by,
            transport,
            unit: 1.0,
            momentum: vec![0.0; n],
        }
    }

    /// Factors the matrix with derivatives at t1, for steps of `h`.
    pub(super) fn factor(
        &mut self,
        model: &mut SecondOrderModel,
        (of, point): (&Derivatives, &LinearizationPoint),
        (t1, h): (f64, f64),
    ) -> Result<(), StepError> {
        self.matrix.clear();
        self.add_forces(of, h);
        if model.problem.mechanical.m > 0 {
            self.add_constraints(model, (of, point), (t1, h))?;
        }
        let factored = self.matrix.factor();
        factored.map_err(|_| StepError::SingularNewton)
    }

    /// K, and what couples η with d.
    fn add_forces(&mut self, of: &Derivatives, h: f64) {
        let [y_phi, z_phi] = self.coupling.phi;
        let (matrix, at) = (&mut self.matrix, &self.places);
        matrix.add(at.mass, &of.mass, 1.0);
        matrix.add(at.j_z, &of.j_z, -z_phi * h);
        matrix.add(at.j_y, &of.j_y, -y_phi * h * h);
        if let Some(at) = &at.paired {
            matrix.add(at.j_z, &of.j_z, -y_phi * h);
            matrix.add(at.mass, &of.mass, 1.0);
        }
        self.unit = max_norm(matrix.values());
        if let Some(at) = &at.paired {
            matrix.add(at.w_y, &of.w_y, h);
        }
    }

    /// Everything that comes from g and r.
    fn add_constraints(
        &mut self,
        model: &mut SecondOrderModel,
        (of, point): (&Derivatives, &LinearizationPoint),
        (t1, h): (f64, f64),
    ) -> Result<(), StepError> {
        let at = &self.places;
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
                let at_end = (&problem.patterns.mass, &of.mass[..]);
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
    pub(super) fn transport_residual(
        &mut self,
        model: &SecondOrderModel,
        of: &Derivatives,
        residual: &mut [f64],
    ) {
        if let Some(Transport { mass, .. }) = &mut self.transport {
            let at_end = (&model.problem.patterns.mass, &of.mass[..]);
            transport(mass, at_end, &mut self.momentum, residual);
        }
    }

    /// Solves in place.
    pub(super) fn solve(&mut self, x: &mut [f64]) {
        self.matrix.solve(x);
        let others = if self.places.paired.is_some() { 2 } else { 1 } * self.momentum.len();
        for lam in &mut x[others..] {
            *lam *= self.unit;
        }
    }
}

/// `x = M(t1) M(t0)⁻¹ x`, with M(t0) factored and M(t1) by its pattern and values.
fn transport(start: &mut Mass, end: (&Pattern, &[f64]), spare: &mut [f64], x: &mut [f64]) {
    start.solve(x);
    spare.fill(0.0);
    end.0.multiply_add(end.1, 1.0, x, spare);
    copy(x, spare);
}
