//! Steps of small systems, of fixed sizes, with the stages of a step, or members, in vector registers.
//!
//! Nearly all steps of such systems are made here: the start, extrapolated or cold, corrections, the update. The
//! equations, the stopping rule and the order of sums are those of `crates/spark`; a step that does not converge here is
//! repeated there. V is Z. With M = p_z constant, node Schur takes per correction the products with ā, â, μ̄, μ̂ and the inverse of
//!
//!     P⁻¹ S,   S_il = P_il G_i M⁻¹ R_l,   P = ā â,
//!
//! which is a multiple of the identity in the nodes as h → 0: it needs no pivots. Where M varies, it is full Newton.

mod blocks;
mod end;
mod equations;
mod full_newton;
mod layout;
mod linear;
mod newton_matrix;
mod points;
mod sizes;
mod start;
mod tables;

use end::End;
use full_newton::FullNewton;
use layout::{Layout, POINTS};
use linear::SchurInverse;
use liouville_base::compiled;
use liouville_base::newton::{self, Member, Stop};
use liouville_base::real::{Lanes, Scalar};
use liouville_base::tableau;
use liouville_base::tape::{CompensatedPoints, PointRegisters};
use liouville_problem::{Acceleration, Mass, Mechanical, MemberLanes, Model, Step};
pub use sizes::Small;
use std::sync::Arc;
use tables::{StartWeights, Tables};

/// The curves of Z and λ that a predictor holds.
pub const Z: usize = 0;
#[allow(missing_docs)]
pub const LAM: usize = 1;

/// Whether V is Z, momenta are linear in it, and nothing but holonomic constraints acts with reactions linear in λ.
fn is_plain(problem: &Mechanical) -> bool {
    problem.is_linear && problem.l() == 0 && problem.patterns.v_z.is_none()
}

/// The matrices that corrections may be made with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matrices {
    /// Node Schur's where the mass is constant, else full Newton's.
    Any,
    /// Node Schur's.
    NodeSchur,
    /// Full Newton's.
    Newton,
}

/// The memory of a step of at most N coordinates and M constraints.
#[derive(Clone, Debug)]
pub struct Fixed<L: Layout, const N: usize, const M: usize> {
    problem: Arc<Mechanical>,
    tables: &'static Tables,
    start: StartWeights,
    stage: PointRegisters<L::Row>,
    node: PointRegisters<L::Row>,
    node_blocks: PointRegisters<L::Row>,
    /// Rounding errors of g, where its operations have them.
    compensated: Option<Box<CompensatedPoints<L::Row>>>,
    /// Whether forces depend on the stages at all, and p or they on their positions.
    has_force: bool,
    depends_on_y: bool,
    /// M⁻¹, at the end of the step where it varies.
    inverse_mass: [[L; N]; N],
    is_diagonal: bool,
    linear: SchurInverse<L, N, M>,
    /// Full Newton, where the mass varies.
    full: Option<Box<FullNewton<L, N, M>>>,
    z: [L::Points; N],
    lam: [L::Points; M],
    /// Z and λ of members that take no further corrections.
    kept: Option<Box<KeptUnknowns<L, N, M>>>,
    /// h b_j V_j, h b_j F_j, h b̂_j R_j; Σ μᶠ h b F; M⁻¹ times the residual of the momentum.
    displacements: [L::Points; N],
    impulses: [L::Points; N],
    reactions: [L::Points; N],
    forces: [L::Points; N],
    velocity: [L::Points; N],
    /// Rounding errors of the nodes.
    node_low: [L::Points; N],
    start_of_iteration: IterationStart<L, N, M>,
    /// h b_j (V_j − V_j⁰), with V⁰ of that start.
    moved: [L::Points; N],
    work: Workspace<L, N, M>,
    /// h b and h b̂.
    weights: [Lanes; 2],
    v0: [L; N],
    yardstick: L,
    rest: L,
    /// h times the largest acceleration that forces and reactions take from one another.
    borne: L,
    speed: L,
    /// The relative size of the last correction.
    size: L,
    deviation: L,
    end: End<L, N, M>,
}

/// Z and the nodes, with their rounding errors, at the first evaluation of a step.
#[derive(Clone, Debug)]
struct IterationStart<L: Layout, const N: usize, const M: usize> {
    z: [L::Points; N],
    node: [L::Points; N],
    node_low: [L::Points; N],
}

/// Values within a correction.
#[derive(Clone, Debug)]
struct Workspace<L: Layout, const N: usize, const M: usize> {
    residual: [L::Points; N],
    at_nodes: [L::Points; N],
    sides: [L::Points; M],
    d_lam: [L::Points; M],
    d_z: L::Points,
}

impl<L: Layout, const N: usize, const M: usize> Workspace<L, N, M> {
    fn new() -> Self {
        let (of_n, of_m) = ([L::zeros(); N], [L::zeros(); M]);
        Self {
            residual: of_n,
            at_nodes: of_n,
            sides: of_m,
            d_lam: of_m,
            d_z: L::zeros(),
        }
    }
}

/// Z and λ.
type KeptUnknowns<L, const N: usize, const M: usize> =
    ([<L as Layout>::Points; N], [<L as Layout>::Points; M]);

/// The most coordinates of a mass that varies: with more, node Schur of `crates/spark` takes less time than full Newton here.
const MOST_VARYING: usize = 4;

impl<L: Layout, const N: usize, const M: usize> Fixed<L, N, M> {
    const TAKES_NEWTON: bool = N <= MOST_VARYING;

    /// Memory for a small system with these parameters; `None` for other systems, or where `matrices` excludes its matrix.
    #[inline(never)]
    pub fn new(
        model: &mut Model<L>,
        tableau: &tableau::Spark,
        matrices: Matrices,
    ) -> Option<Box<Self>> {
        let sizes = (model.problem.n, model.problem.m);
        let points = tableau.stages.max(tableau.intervals + 1);
        let is_small = sizes.0 <= N && sizes.1 <= M && points <= POINTS;
        let problem = model.problem.clone();
        let is_constant = problem.stage_blocks.is_empty();
        let other = if is_constant {
            Matrices::Newton
        } else {
            Matrices::NodeSchur
        };
        if !is_small
            || !is_plain(&problem)
            || matrices == other
            || !(is_constant || Self::TAKES_NEWTON)
        {
            return None;
        }
        let tables = Tables::of(tableau)?;
        let (mut full, mut inverse) = (None, [[L::splat(0.0); N]; N]);
        if is_constant {
            inverse = inverse_mass(model)?;
        } else {
            full = Some(Box::new(FullNewton::new(model, tables)?));
        }
        let rows = [tableau.stages, tableau.intervals + 1].map(L::rows);
        let [stage, node, node_blocks] = model.at_points(rows, Layout::every)?;
        let zeros = [L::zeros(); N];
        let of_unknowns = (zeros, [L::zeros(); M]);
        let at = &problem.patterns;
        let has_force = !at.f_y.is_empty() || !at.f_z.is_empty();
        Some(Box::new(Self {
            tables,
            start: StartWeights::new(tableau),
            stage,
            compensated: model.compensated_g_at(&node).map(Box::new),
            node,
            node_blocks,
            has_force,
            depends_on_y: !at.f_y.is_empty() || !at.p_y.is_empty(),
            inverse_mass: inverse,
            is_diagonal: at.p_z.entries().iter().all(|(i, j)| i == j),
            linear: SchurInverse::new(tableau.intervals * problem.m),
            full,
            z: zeros,
            lam: of_unknowns.1,
            kept: (!L::IS_SINGLE).then(|| Box::new(of_unknowns)),
            displacements: zeros,
            impulses: zeros,
            reactions: zeros,
            forces: zeros,
            velocity: zeros,
            node_low: zeros,
            start_of_iteration: IterationStart {
                z: zeros,
                node: zeros,
                node_low: zeros,
            },
            moved: zeros,
            work: Workspace::new(),
            weights: [Lanes::splat(0.0); 2],
            v0: [L::splat(0.0); N],
            yardstick: L::splat(0.0),
            rest: L::splat(0.0),
            borne: L::splat(0.0),
            speed: L::splat(0.0),
            size: L::splat(f64::INFINITY),
            deviation: L::splat(0.0),
            end: End::new(),
            problem,
        }))
    }

    /// Whether corrections are full Newton's.
    pub fn is_newton(&self) -> bool {
        Self::TAKES_NEWTON && self.full.is_some()
    }

    /// How many pivots of the last matrix of full Newton have other signs than those of a small step.
    pub fn reversed(&self) -> L {
        let full = self.full.as_ref().filter(|_| Self::TAKES_NEWTON);
        full.map_or(L::splat(0.0), |full| full.reversed)
    }

    /// Iterates from the extrapolated start, or the cold one, and finds the end of the step for members that are open;
    /// `None` where the step has to be made by `crates/spark`.
    #[inline(never)]
    pub fn advance(
        &mut self,
        model: &mut Model<L>,
        from: StepStart<L>,
        step: Step<L>,
        (most, stop): (usize, Stop),
        members: &mut [Member],
    ) -> Option<()> {
        self.begin(model, from, step)?;
        let mut equations = equations::SmallEquations {
            small: self,
            step,
            stop,
            is_linearized: false,
        };
        newton::solve_each(&mut equations, most, members).ok()?;
        let has_converged = |member: &Member| matches!(member, Member::Converged(_));
        if !members.iter().any(has_converged) {
            return None;
        }
        let loses = self.problem.patterns.p_y.is_empty() && stop.is_roundoff();
        self.finish(model, step, (loses, stop))
    }

    fn begin(&mut self, model: &mut Model<L>, from: StepStart<L>, step: Step<L>) -> Option<()> {
        let (held, acceleration) = from;
        self.weights = self.tables.weights(step.h);
        if !held.update_weights(step.h) {
            return self.start_cold(model, acceleration, step);
        }
        self.start.update(held);
        self.extrapolate(held, acceleration.borne, step);
        Some(())
    }
}

/// The source of start values: the step before, or the accelerations.
type StepStart<'a, L> = (&'a mut newton::Predictor<L>, &'a mut Acceleration<L>);

/// p_z⁻¹, which parameters alone determine.
fn inverse_mass<L: Layout, const N: usize>(model: &mut Model<L>) -> Option<[[L; N]; N]> {
    let n = model.problem.n;
    let mut mass = Mass::new(model);
    let mut column = vec![L::splat(0.0); n];
    mass.update(model, 0.0, &column.clone(), &column.clone())
        .ok()?;
    let mut inverse = [[L::splat(0.0); N]; N];
    for j in 0..n {
        column.fill(L::splat(0.0));
        column[j] = L::splat(1.0);
        mass.solve(&mut column);
        for (row, x) in inverse.iter_mut().zip(&column) {
            row[j] = *x;
        }
    }
    Some(inverse)
}

compiled!(R in [f64, MemberLanes] {
    Fixed::<R, 4, 2>::new as fn(_, _, _) -> _,
    Fixed::<R, 4, 2>::advance as fn(_, _, _, _, _, _) -> _,
    Fixed::<R, 4, 2>::commit as fn(_, _, _, _),
    Fixed::<R, 8, 8>::new as fn(_, _, _) -> _,
    Fixed::<R, 8, 8>::advance as fn(_, _, _, _, _, _) -> _,
    Fixed::<R, 8, 8>::commit as fn(_, _, _, _),
});
