//! Constrained mechanics as an index-3 differential-algebraic system:
//!
//!     y' = v(t, y, z),   d/dt p(t, y, z) = f(t, y, z) + r(t, y, λ),   0 = g(t, y)
//!
//! with the hidden constraint 0 = w(t, y, z) := g_t + g_y v. A Lagrangian system has v = z and
//! p = L_v; a Hamiltonian one p = z and v = H_p; both r = −g_yᵀ λ. Nonholonomic constraints, if there
//! are any, have a file of their own. Source: jay2007.

mod acceleration;
mod consistency;
mod cotangents;
mod dense;
mod dynamics;
mod energy;
mod estimate;
mod hermite;
mod kinetic;
mod kkt;
mod mass;
mod model;
mod monitor;
mod nonholonomic;
mod observe;
mod observe_point;
mod points;
mod projection;
mod random_tangents;
mod rate_tangents;
mod redundant;
mod restart;
mod saddle;
mod schur;
mod second_order;
mod sensitivity;
mod separable;
mod step_map;
mod tangent_sizes;
mod tangents;
mod turns;
mod watch;

pub use acceleration::Acceleration;
pub use consistency::{Kind, Tolerances, Violation};
pub use cotangents::{Cotangents, PointAdjoint};
pub use dense::{Nearby, Path, Point};
pub use dynamics::Dynamics;
pub use energy::EnergyWatch;
pub use estimate::{Estimate, StepVelocities};
pub use kinetic::Kinetic;
pub use mass::Mass;
pub use model::{Model, finite, finite_k, finite_state};
pub use monitor::{TimeScale, Traced};
pub use nonholonomic::diagnose_rank_all;
pub use nonholonomic::{Nonholonomic, NonholonomicPatterns};
pub use observe::{Carried, Observer, Observers};
pub use observe_point::ObservePoint;
pub use points::{PointRows, Points, Times};
pub use projection::{Projection, project, project_linear};
pub use random_tangents::{
    LargestError, MechanicalStart, RandomTangents, TangentLed, random_numbers,
};
pub use rate_tangents::{MotionPoint, MotionTangents, RateTangents, Side, rates_beside};
pub use redundant::Redundant;
pub use restart::{Impact, Impulse, Jump, Refused, Restart, Sizes};
pub use saddle::Saddle;
pub use saddle::{add_product, diagnose_rank};
pub use schur::{SchurPlan, SparseSchur};
pub use second_order::{SecondOrder, SecondOrderModel, SecondOrderPatterns};
pub use sensitivity::{Sensitivity, SensitivityModel, SensitivityPatterns};
pub use separable::{Separable, SeparableModel};
pub use step_map::{StateSegments, StepMap};
pub use tangent_sizes::{TangentSizes, TangentStep};
pub use tangents::{
    AccelerationTangents, BeginTangents, Directions, MomentumTangents, TangentObserver,
    TangentRestart, TangentState, TangentView,
};

pub use turns::Turning;
pub use watch::{StepWatch, Watched};

use liouville_base::linalg::{BlockPlan, Pattern};
use liouville_base::method;
use liouville_base::real::{BATCH, Lanes, Real, Scalar};
use liouville_base::tape::{CompensatedProgram, Tape};
use points::cut;
use std::sync::{Arc, OnceLock};

/// The tapes and patterns of a mechanical system with n coordinates and m constraints.
///
/// The tapes' last input is always the parameters; the outputs of a tape follow one another. Where
/// v = z, there are no outputs for v and its derivatives, and `v_z` is `None`.
#[derive(Clone, Debug)]
pub struct Mechanical {
    /// Number of coordinates.
    pub n: usize,
    /// Number of holonomic constraints.
    pub m: usize,
    /// p, v and k are linear in z, and reactions linear in their multipliers.
    pub is_linear: bool,
    /// (t, y, z) → p, f, v
    pub stage: Tape,
    /// (t, y, z) → p_z, v_z
    pub stage_blocks: Tape,
    /// (t, y, z) → p_y, f_y, f_z, v_y
    pub stage_jacobian: Tape,
    /// (t, y, λ) → g, r
    pub node: Tape,
    /// (t, y, λ) → g_y, r_λ
    pub node_blocks: Tape,
    /// (t, y, λ) → r_y
    pub node_jacobian: Tape,
    /// (t, y, z) → p, w, v
    pub end: Tape,
    /// (t, y, z) → f − p_t − p_y v, w_t + w_y v, k_t + k_y v, v_t + v_y v
    pub acceleration: Tape,
    /// Where the derivatives are not zero.
    pub patterns: Patterns,
    /// Constraints on velocities, and their reactions.
    pub nonholonomic: Option<Box<Nonholonomic>>,
    /// Constraints that those above imply; they add multipliers to the records only.
    pub redundant: Option<Box<Redundant>>,
    /// How constraints are eliminated where they are many, found at the first run.
    pub schur_plan: OnceLock<Option<Arc<SchurPlan>>>,
    /// The blocks of the mass, found at the first run.
    pub mass_plan: OnceLock<Option<Arc<BlockPlan>>>,
    /// The program of g in compensated numbers, found at the first run.
    pub compensated_g: OnceLock<Option<Arc<CompensatedProgram>>>,
}

/// The sparsity of each derivative.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct Patterns {
    pub p_z: Pattern,
    pub v_z: Option<Pattern>,
    pub p_y: Pattern,
    pub f_y: Pattern,
    pub f_z: Pattern,
    pub v_y: Pattern,
    pub g_y: Pattern,
    pub r_lam: Pattern,
    pub r_y: Pattern,
}

/// Tapes and patterns that do not belong together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} has size {found}, wanted {wanted}")]
#[allow(missing_docs)]
pub struct Mismatch {
    pub name: &'static str,
    pub found: usize,
    pub wanted: usize,
}

impl Mechanical {
    /// The program of g in compensated numbers, where it takes arithmetic and square roots alone.
    fn compensated_g(&self) -> Option<&Arc<CompensatedProgram>> {
        let find = || match self.m {
            0 => None,
            m => self.node.compensated(m).map(Arc::new),
        };
        self.compensated_g.get_or_init(find).as_ref()
    }

    /// The system, once its parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape or pattern that has not the size the others imply.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (n, m, at) = (self.n, self.m, &self.patterns);
        let v = if at.v_z.is_some() { n } else { 0 };
        let v_z = at.v_z.as_ref().map_or(0, Pattern::len);
        let params = self.stage.inputs().last().copied().unwrap_or(0);
        let tapes = [
            ("stage", &self.stage, n, n + n + v),
            ("stage_blocks", &self.stage_blocks, n, at.p_z.len() + v_z),
            (
                "stage_jacobian",
                &self.stage_jacobian,
                n,
                at.p_y.len() + at.f_y.len() + at.f_z.len() + at.v_y.len(),
            ),
            ("node", &self.node, m, m + n),
            (
                "node_blocks",
                &self.node_blocks,
                m,
                at.g_y.len() + at.r_lam.len(),
            ),
            ("node_jacobian", &self.node_jacobian, m, at.r_y.len()),
            ("end", &self.end, n, n + m + v),
            (
                "acceleration",
                &self.acceleration,
                n,
                n + self.multipliers() + v,
            ),
        ];
        for (name, tape, third, outputs) in tapes {
            check(name, tape.inputs().len(), 4)?;
            for (found, wanted) in tape.inputs().iter().zip([1, n, third, params]) {
                check(name, *found, wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let square = [
            ("p_z", &at.p_z),
            ("p_y", &at.p_y),
            ("f_y", &at.f_y),
            ("f_z", &at.f_z),
            ("v_y", &at.v_y),
            ("r_y", &at.r_y),
        ];
        let v_z = at.v_z.iter().map(|pattern| ("v_z", pattern, (n, n)));
        let shaped = [("g_y", &at.g_y, (m, n)), ("r_lam", &at.r_lam, (n, m))];
        for (name, pattern, (rows, cols)) in square
            .map(|(name, pattern)| (name, pattern, (n, n)))
            .into_iter()
            .chain(v_z)
            .chain(shaped)
        {
            check_pattern(name, pattern, (rows, cols))?;
        }
        if let Some(nonholonomic) = &self.nonholonomic {
            nonholonomic.check(n, m, params)?;
        }
        if let Some(redundant) = &self.redundant {
            redundant.check(n, self.multipliers(), params)?;
        }
        Ok(self)
    }

    /// Number l of nonholonomic constraints.
    #[inline]
    pub fn l(&self) -> usize {
        self.nonholonomic.as_ref().map_or(0, |own| own.l)
    }

    /// Whether all equations are linear in y, z and λ, with factors that depend on parameters alone.
    #[inline]
    pub fn is_affine(&self) -> bool {
        let derivatives = [
            &self.stage_blocks,
            &self.stage_jacobian,
            &self.node_blocks,
            &self.node_jacobian,
        ];
        self.l() == 0 && derivatives.iter().all(|tape| tape.is_empty())
    }

    /// Whether most derivatives of the constraints are zero.
    #[inline]
    pub fn is_sparse(&self) -> bool {
        4 * self.patterns.g_y.len() <= self.n * self.m
    }

    /// Number of all multipliers, λ then ν, that a step solves for.
    #[inline]
    pub fn multipliers(&self) -> usize {
        self.m + self.l()
    }

    /// Number of all multipliers that are recorded, with those of constraints left out.
    #[inline]
    pub fn recorded_multipliers(&self) -> usize {
        let left = self.redundant.as_ref().map_or(0, |own| own.left_out.len());
        self.multipliers() + left
    }
}

fn check_pattern(
    name: &'static str,
    pattern: &Pattern,
    (rows, cols): (usize, usize),
) -> Result<(), Mismatch> {
    check(name, pattern.shape().0, rows)?;
    check(name, pattern.shape().1, cols)
}

fn check(name: &'static str, found: usize, wanted: usize) -> Result<(), Mismatch> {
    if found == wanted {
        Ok(())
    } else {
        Err(Mismatch {
            name,
            found,
            wanted,
        })
    }
}

/// The same number of each member of a block.
pub type MemberLanes = Lanes<BATCH>;

/// The step being made.
pub type Step<'a, R = f64> = method::Step<'a, State<R>>;

/// Where a mechanical system is, with the low parts its compensated sums carry.
#[derive(Debug, PartialEq)]
pub struct State<R = f64> {
    /// Coordinates.
    pub y: Vec<R>,
    /// Velocities or momenta, as the system has them.
    pub z: Vec<R>,
    /// p(t, y, z), summed up from its increments.
    pub p: Vec<R>,
    /// The rounding error of `y`.
    pub y_low: Vec<R>,
    /// The rounding error of `p`.
    pub p_low: Vec<R>,
}

impl<R: Real> State<R> {
    /// A state of n zeros.
    pub fn zeros(n: usize) -> Self {
        let zeros = || vec![R::splat(0.0); n];
        Self {
            y: zeros(),
            z: zeros(),
            p: zeros(),
            y_low: zeros(),
            p_low: zeros(),
        }
    }

    /// A member becomes one of another state, whose sizes are the same.
    pub fn copy_member<S: Real>(&mut self, member: usize, other: &State<S>, of: usize) {
        let pairs = [
            (&mut self.y, &other.y),
            (&mut self.z, &other.z),
            (&mut self.p, &other.p),
            (&mut self.y_low, &other.y_low),
            (&mut self.p_low, &other.p_low),
        ];
        for (out, x) in pairs {
            for (out, x) in out.iter_mut().zip(x) {
                out.set_member(member, x.member(of));
            }
        }
    }
}

liouville_base::clone_in_place!([R: Clone] State<R> { y, z, p, y_low, p_low });

liouville_base::checkpoint!([R: Scalar] State<R> { y, z, p, y_low, p_low });
liouville_base::recorded!([R: Scalar] State<R> { y, z, p, y_low, p_low });
