//! The modified-Newton matrix of the α family: as it stands, or split in two.
//!
//! Corrections are h² η of y1 and h ζ of z1. With ζ = (γ/β) η + d, the derivative of F enters the equation for η only;
//! [`super::block`] has the matrix of η, d, dΛ0 and dΛ1. Of large assemblies it is *split*: with the terms of h F_z, h² F_y
//! and h² r_y dropped, and r_λ(t0) taken to be r_λ(t1), both within O(h), what is left are two solves,
//!
//!     M η − r_λ p = a,   g_y η = b;      M d − r_λ q = c,   g_y d = e − h w_y η,
//!
//! with the saddle that is eliminated joint by joint, for p = y_0 dΛ0 + y_1 dΛ1 and q = z_0 dΛ0 + z_1 dΛ1. Broyden's
//! update makes up for what is dropped; where forces are too stiff for it, the matrix is taken as it stands.

use super::Reactions;
use super::block::AlphaBlock;
use super::coupling::Coupling;
use super::linearization_point::LinearizationPoint;
use super::unknowns::{AlphaSolver, AlphaStep};
use liouville_base::checkpoint::CheckpointMismatch;
use liouville_base::error::StepError;
use liouville_base::linalg::{Matrix, copy};
use liouville_base::newton::{Renewal, Reuse};
use liouville_problem::{Mass, Mechanical, Saddle, SecondOrderModel};

/// The matrix, factored, with the derivatives it came from.
#[derive(Clone, Debug)]
pub(super) struct AlphaMatrix {
    pub(super) reuse: Reuse,
    coupling: Coupling,
    reactions_by: Reactions,
    point: LinearizationPoint,
    /// M alone.
    pub(super) mass: Mass,
    pub(super) derivatives: Derivatives,
    /// The matrix as it stands; none where it has not been wanted.
    block: Option<Box<AlphaBlock>>,
    pub(super) is_split: bool,
    /// Solves the split matrix, and projects.
    saddle: Option<Saddle>,
    momentum: Vec<f64>,
    none: Vec<f64>,
}

/// The derivatives that are kept with the factors.
#[derive(Clone, Debug)]
pub(super) struct Derivatives {
    pub(super) mass: Vec<f64>,
    /// (F − M u)_y
    pub(super) j_y: Vec<f64>,
    /// F_z
    pub(super) j_z: Vec<f64>,
    pub(super) w_y: Vec<f64>,
}

/// Factors are made anew when a step takes more corrections than the first with them, by more than this.
const SLOW: usize = 2;
/// Corrections of a step beyond which the split matrix is too far from the matrix.
const MOST_SPLIT: usize = 16;

impl AlphaMatrix {
    /// Memory for this model; the projection of local errors only where they are wanted.
    pub(super) fn new(model: &SecondOrderModel, solver: &AlphaSolver, is_controlled: bool) -> Self {
        let (n, m) = (model.problem.mechanical.n, model.problem.mechanical.m);
        let at = &model.problem.patterns;
        let values = |count| vec![0.0; count];
        let (coupling, reactions_by) = (solver.coupling, solver.reactions_by);
        let renewal = Renewal::AboveFirst(SLOW);
        let may_split = solver.is_paired() && !solver.is_affine;
        let saddle = (may_split || is_controlled).then(|| Saddle::new(&model.general));
        let is_split = may_split && saddle.as_ref().is_some_and(Saddle::is_eliminated);
        let block = (!is_split).then(|| AlphaBlock::new(model, coupling, reactions_by));
        Self {
            reuse: match &block {
                Some(block) => Reuse::new(&block.matrix, renewal),
                None => Reuse::sparse(renewal),
            },
            block: block.map(Box::new),
            is_split,
            coupling,
            reactions_by,
            point: LinearizationPoint::new(solver),
            mass: Mass::new(&model.general),
            derivatives: Derivatives {
                mass: values(at.mass.len()),
                j_y: values(at.j_y.len()),
                j_z: values(at.j_z.len()),
                w_y: values(at.w_y.len()),
            },
            saddle: saddle.filter(|_| is_split || is_controlled),
            momentum: values(n),
            none: values(m),
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
        let LinearizationPoint { t, y1, z1, phi, .. } = &self.point;
        let t1 = t + h;
        if let Some(saddle) = &mut self.saddle {
            let lam = &self.point.reactions[1].lam;
            saddle.update(&mut model.general, t1, y1, z1, lam)?;
        }
        self.mass.update(&mut model.general, t1, y1, z1)?;
        let [mass, j_y, j_z, w_y] = model.jacobian(t1, y1, z1, phi)?;
        let of = &mut self.derivatives;
        for (kept, values) in [
            (&mut of.mass, mass),
            (&mut of.j_y, j_y),
            (&mut of.j_z, j_z),
            (&mut of.w_y, w_y),
        ] {
            copy(kept, values);
        }
        if !self.is_split {
            self.factor(model, (t1, h))?;
        }
        self.reuse.renew(h);
        Ok(())
    }

    /// Factors the matrix as it stands with the derivatives at t1, for steps of `h`.
    fn factor(&mut self, model: &mut SecondOrderModel, at: (f64, f64)) -> Result<(), StepError> {
        let (coupling, reactions_by) = (self.coupling, self.reactions_by);
        let block = (self.block)
            .get_or_insert_with(|| AlphaBlock::new(model, coupling, reactions_by).into());
        block.factor(model, (&self.derivatives, &self.point), at)
    }

    /// Splits the matrix from the next factors on, or does not.
    pub(super) fn split(&mut self, is_split: bool) {
        if self.is_split != is_split {
            self.is_split = is_split;
            self.reuse.discard();
        }
    }

    /// Records the corrections of a step; a split matrix that takes too many is split no more.
    pub(super) fn record(&mut self, corrections: usize) {
        self.reuse.record(corrections);
        if corrections > MOST_SPLIT {
            self.split(false);
        }
    }

    /// The matrix as it stands, of the last factors.
    pub(super) fn to_dense(&self) -> Option<Matrix> {
        self.as_it_stands().map(|block| block.matrix.to_dense())
    }

    fn as_it_stands(&self) -> Option<&AlphaBlock> {
        self.block.as_deref().filter(|_| !self.is_split)
    }

    /// Whether the determinant of the matrix is negative, where that is known.
    fn is_negative(&self) -> Option<bool> {
        self.as_it_stands()
            .and_then(|block| block.matrix.is_negative())
    }

    /// Whether the determinant has another sign than that of M, where both are known.
    pub(super) fn is_against_mass(&self) -> bool {
        let both = self.is_negative().zip(self.mass.is_negative());
        both.is_some_and(|(own, of_mass)| own != of_mass)
    }

    /// Whether forces have turned the sign of the matrix for steps of `h`, which is replaced by the one without them.
    pub(super) fn is_turned_by_forces(&mut self, model: &mut SecondOrderModel, h: f64) -> bool {
        let (own, t1) = (self.is_negative(), self.point.t + h);
        if own.is_none() {
            return false;
        }
        self.reuse.discard();
        self.factor(model, (t1, 0.0)).is_ok() && self.is_negative() != own
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

    /// Takes M A0 − r to the equations of M(t1).
    pub(super) fn transport_residual(&mut self, model: &SecondOrderModel, residual: &mut [f64]) {
        if let (Some(block), false) = (&mut self.block, self.is_split) {
            block.transport_residual(model, &self.derivatives, residual);
        }
    }

    /// Solves in place, for a step of `h`.
    pub(super) fn solve(&mut self, model: &SecondOrderModel, x: &mut [f64], h: f64) {
        match (&mut self.saddle, &mut self.block) {
            (Some(saddle), _) if self.is_split => {
                let (coupling, w_y) = (self.coupling, &self.derivatives.w_y);
                solve_split((saddle, model), (coupling, w_y), x, h);
            }
            (_, Some(block)) => block.solve(x),
            _ => {}
        }
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
        pattern.multiply_add(&self.derivatives.mass, 1.0, x, &mut self.momentum);
        self.none.fill(0.0);
        saddle.solve(&model.general, &mut self.momentum, &mut self.none);
        copy(x, &self.momentum);
    }
}

/// Solves in place by the saddle, for η, d and multipliers.
fn solve_split(
    (saddle, model): (&mut Saddle, &SecondOrderModel),
    (coupling, w_y): (Coupling, &[f64]),
    x: &mut [f64],
    h: f64,
) {
    let Mechanical { n, m, .. } = *model.problem.mechanical;
    let (eta, rest) = x.split_at_mut(n);
    let (d, lam) = rest.split_at_mut(n);
    let (p, q) = lam.split_at_mut(m);
    saddle.solve(&model.general, eta, p);
    model.problem.patterns.w_y.multiply_add(w_y, -h, eta, q);
    saddle.solve(&model.general, d, q);
    for (p, q) in p.iter_mut().zip(q) {
        [*p, *q] = coupling.apart(*p, *q);
    }
}

liouville_base::checkpoint!(AlphaMatrix {
    reuse,
    point,
    is_split
});
