//! A mechanical system with its parameters bound, and the memory its tapes work in.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::MemberLanes;
use super::nonholonomic::{Bound, Nonholonomic};
use super::points::{Parts, TapeRegisters, cut};
use super::{Mechanical, State};
use liouville_base::compiled;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Pattern, all_finite};
use liouville_base::real::Real;
use liouville_base::tape::{CompensatedPoints, CompensatedTape, PointRegisters, Registers};
use std::sync::Arc;

/// A system ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Model<R = f64> {
    /// The system itself, shared.
    pub problem: Arc<Mechanical>,
    pub(super) stage: TapeRegisters<R>,
    pub(super) stage_blocks: TapeRegisters<R>,
    pub(super) stage_jacobian: TapeRegisters<R>,
    pub(super) node: TapeRegisters<R>,
    pub(super) node_blocks: TapeRegisters<R>,
    pub(super) node_jacobian: TapeRegisters<R>,
    pub(super) end: Registers<R>,
    acceleration: Registers<R>,
    pub(super) nonholonomic: Option<Box<Bound<R>>>,
    reactions: Option<Box<Registers<R>>>,
    /// n, or 0 where v is z.
    v_size: usize,
}

impl<R: Real> Model<R> {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    #[inline(never)]
    pub fn new(problem: Arc<Mechanical>, params: &[R]) -> Self {
        Self {
            stage: TapeRegisters::new(&problem.stage, params),
            stage_blocks: TapeRegisters::new(&problem.stage_blocks, params),
            stage_jacobian: TapeRegisters::new(&problem.stage_jacobian, params),
            node: TapeRegisters::new(&problem.node, params),
            node_blocks: TapeRegisters::new(&problem.node_blocks, params),
            node_jacobian: TapeRegisters::new(&problem.node_jacobian, params),
            end: problem.end.bind(params),
            acceleration: problem.acceleration.bind(params),
            nonholonomic: problem
                .nonholonomic
                .as_ref()
                .map(|own| Box::new(Bound::new(own, params))),
            reactions: problem
                .redundant
                .as_ref()
                .map(|own| Box::new(own.reactions.bind(params))),
            v_size: if problem.patterns.v_z.is_some() {
                problem.n
            } else {
                0
            },
            problem,
        }
    }

    /// p, f, v at (t, y, z); v is empty where it is z.
    #[inline(always)]
    pub fn stage(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 3, R> {
        let sizes = self.stage_sizes();
        cut(
            self.problem
                .stage
                .eval(&mut self.stage.one, [&[R::splat(t)], y, z]),
            sizes,
        )
    }

    #[inline(always)]
    pub(super) fn stage_sizes(&self) -> [usize; 3] {
        [self.problem.n, self.problem.n, self.v_size]
    }

    /// p_z, v_z at (t, y, z).
    #[inline(always)]
    pub fn stage_blocks(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 2, R> {
        let sizes = self.stage_blocks_sizes();
        cut(
            self.problem
                .stage_blocks
                .eval(&mut self.stage_blocks.one, [&[R::splat(t)], y, z]),
            sizes,
        )
    }

    #[inline(always)]
    pub(super) fn stage_blocks_sizes(&self) -> [usize; 2] {
        let at = &self.problem.patterns;
        [at.p_z.len(), at.v_z.as_ref().map_or(0, Pattern::len)]
    }

    /// p_y, f_y, f_z, v_y at (t, y, z).
    #[inline(always)]
    pub fn stage_jacobian(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 4, R> {
        let sizes = self.stage_jacobian_sizes();
        cut(
            self.problem
                .stage_jacobian
                .eval(&mut self.stage_jacobian.one, [&[R::splat(t)], y, z]),
            sizes,
        )
    }

    pub(super) fn stage_jacobian_sizes(&self) -> [usize; 4] {
        let at = &self.problem.patterns;
        [at.p_y.len(), at.f_y.len(), at.f_z.len(), at.v_y.len()]
    }

    /// g, r at (t, y, λ).
    #[inline(always)]
    pub fn node(&mut self, t: f64, y: &[R], lam: &[R]) -> Parts<'_, 2, R> {
        let sizes = self.node_sizes();
        cut(
            self.problem
                .node
                .eval(&mut self.node.one, [&[R::splat(t)], y, lam]),
            sizes,
        )
    }

    #[inline(always)]
    pub(super) fn node_sizes(&self) -> [usize; 2] {
        [self.problem.m, self.problem.n]
    }

    /// g in compensated numbers, where it is made of arithmetic and square roots.
    pub fn compensated_g(&self) -> Option<CompensatedTape<R>> {
        Some(self.problem.compensated_g()?.bind(&self.node.one))
    }

    /// The same at the points of `node`.
    pub fn compensated_g_at<P: Real>(
        &self,
        node: &PointRegisters<P>,
    ) -> Option<CompensatedPoints<P>> {
        Some(self.problem.compensated_g()?.bind_points(node))
    }

    /// `g_y`, `r_λ` at (t, y, λ).
    #[inline(always)]
    pub fn node_blocks(&mut self, t: f64, y: &[R], lam: &[R]) -> Parts<'_, 2, R> {
        let sizes = self.node_blocks_sizes();
        cut(
            self.problem
                .node_blocks
                .eval(&mut self.node_blocks.one, [&[R::splat(t)], y, lam]),
            sizes,
        )
    }

    #[inline(always)]
    pub(super) fn node_blocks_sizes(&self) -> [usize; 2] {
        let at = &self.problem.patterns;
        [at.g_y.len(), at.r_lam.len()]
    }

    /// `r_y` at (t, y, λ).
    #[inline(always)]
    pub fn node_jacobian(&mut self, t: f64, y: &[R], lam: &[R]) -> &[R] {
        self.problem
            .node_jacobian
            .eval(&mut self.node_jacobian.one, [&[R::splat(t)], y, lam])
    }

    /// p, w, v at (t, y, z); v is empty where it is z.
    #[inline(always)]
    pub fn end(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 3, R> {
        let (n, m, v) = (self.problem.n, self.problem.m, self.v_size);
        cut(
            self.problem.end.eval(&mut self.end, [&[R::splat(t)], y, z]),
            [n, m, v],
        )
    }

    /// f − p_t − `p_y` v, then `w_t` + `w_y` v with `k_t` + `k_y` v behind it, and `v_t` + `v_y` v at (t, y, z);
    /// the last is empty where v is z.
    pub fn acceleration(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 3, R> {
        let sizes = [self.problem.n, self.problem.multipliers(), self.v_size];
        cut(
            self.problem
                .acceleration
                .eval(&mut self.acceleration, [&[R::splat(t)], y, z]),
            sizes,
        )
    }

    /// k, `r_n` at (t, y, z, ν); empty where there is no such constraint.
    pub fn nonholonomic(&mut self, t: f64, y: &[R], z: &[R], nu: &[R]) -> Parts<'_, 2, R> {
        match self.bound() {
            Some((problem, bound)) => bound.values(problem, [&[R::splat(t)], y, z, nu]),
            None => [&[]; 2],
        }
    }

    /// `k_y`, `k_z`, and of `r_n` its derivatives by y, z and ν, at (t, y, z, ν).
    pub fn nonholonomic_blocks(&mut self, t: f64, y: &[R], z: &[R], nu: &[R]) -> Parts<'_, 5, R> {
        match self.bound() {
            Some((problem, bound)) => bound.blocks(problem, [&[R::splat(t)], y, z, nu]),
            None => [&[]; 5],
        }
    }

    /// `w_y` at (t, y, z), where there are nonholonomic constraints too.
    pub fn hidden_jacobian(&mut self, t: f64, y: &[R], z: &[R]) -> &[R] {
        match self.bound() {
            Some((problem, bound)) => bound.hidden(problem, [&[R::splat(t)], y, z]),
            None => &[],
        }
    }

    fn bound(&mut self) -> Option<(&Nonholonomic, &mut Bound<R>)> {
        let problem = self.problem.nonholonomic.as_deref()?;
        Some((problem, self.nonholonomic.as_deref_mut()?))
    }

    /// Reactions of all constraints to a multiplier of one, where some are left out; else empty.
    pub(super) fn reactions(&mut self, t: f64, y: &[R], z: &[R]) -> &[R] {
        match (&self.problem.redundant, &mut self.reactions) {
            (Some(own), Some(registers)) => own.reactions.eval(registers, [&[R::splat(t)], y, z]),
            _ => &[],
        }
    }

    /// The state at (t, y, z), with nothing lost to rounding yet.
    #[inline(never)]
    pub fn state(&mut self, t: f64, y: &[R], z: &[R]) -> State<R> {
        let p = self.end(t, y, z)[0].to_vec();
        let low = vec![R::splat(0.0); y.len()];
        State {
            y: y.to_vec(),
            z: z.to_vec(),
            p,
            y_low: low.clone(),
            p_low: low,
        }
    }
}

/// Refuses values that are not finite, naming the first.
///
/// # Errors
/// [`StepError::NotFinite`].
#[inline(always)]
pub fn finite<R: Real>(values: &[R], quantity: Quantity, t: f64) -> Result<(), StepError> {
    if all_finite(values) {
        return Ok(());
    }
    Err(not_finite(values, quantity, t))
}

#[cold]
#[inline(never)]
fn not_finite<R: Real>(values: &[R], quantity: Quantity, t: f64) -> StepError {
    let index = values
        .iter()
        .position(|x| !x.all(f64::is_finite))
        .unwrap_or(0);
    StepError::NotFinite { quantity, index, t }
}

/// Refuses a state that has overflown.
///
/// # Errors
/// [`StepError::Overflow`] for the first coordinate that is not finite.
pub fn finite_state<R: Real>(x: &[R], t: f64) -> Result<(), StepError> {
    match x.iter().position(|x| !x.all(f64::is_finite)) {
        Some(index) => Err(StepError::Overflow {
            index,
            member: 0,
            t,
        }),
        None => Ok(()),
    }
}

/// [`finite`] of k, whose constraints come after the m holonomic ones.
///
/// # Errors
/// [`StepError::NotFinite`].
pub fn finite_k<R: Real>(k: &[R], m: usize, t: f64) -> Result<(), StepError> {
    match k.iter().position(|x| !x.all(f64::is_finite)) {
        Some(index) => Err(StepError::NotFinite {
            quantity: Quantity::Nonholonomic,
            index: m + index,
            t,
        }),
        None => Ok(()),
    }
}

compiled!(R in [f64, MemberLanes] {
    Model::<R>::new as fn(_, _) -> _,
    Model::<R>::state as fn(_, _, _, _) -> _,
});
