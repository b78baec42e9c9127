//! Derivatives of a mechanical system by time and parameters, τ = (t, θ), and of its accelerations: what tangents of
//! a motion need beside the derivatives that a step has.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::points::{Parts, TapeRegisters};
use super::{Mechanical, Mismatch, check, check_pattern, cut};
use super::{PointRows, Points};
use liouville_base::linalg::Pattern;
use liouville_base::real::Real;
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// Tapes and patterns of the derivatives; a tape's last input is always the parameters.
///
/// Where v = z, there are no outputs for v.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    /// The system itself.
    pub mechanical: Arc<Mechanical>,
    /// (t, y, z) → p_τ, f_τ, v_τ
    pub stage: Tape,
    /// (t, y, λ) → g_τ, r_τ
    pub node: Tape,
    /// (t, y, z) → w_y, w_τ
    pub hidden: Tape,
    /// (t, y, z, u, λ), ν behind λ → derivatives by y, z and τ of p_z u + p_y v + p_t − f − r − r_n, then of
    /// w_z u + w_y v + w_t with k_z u + k_y v + k_t below
    pub motion: Tape,
    /// (t, y, z, ν) → k_τ and the derivative of r_n by τ; none where there are no nonholonomic constraints
    pub nonholonomic: Option<Tape>,
    /// Where the derivatives are not zero.
    pub patterns: SensitivityPatterns,
}

/// The sparsity of each derivative, `motion` and `rate` being the two of accelerations, `nonholonomic` those of k and r_n.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct SensitivityPatterns {
    pub p_tau: Pattern,
    pub f_tau: Pattern,
    pub v_tau: Option<Pattern>,
    pub g_tau: Pattern,
    pub r_tau: Pattern,
    pub w_y: Pattern,
    pub w_tau: Pattern,
    pub motion: [Pattern; 3],
    pub rate: [Pattern; 3],
    pub nonholonomic: Option<[Pattern; 2]>,
}

impl Sensitivity {
    /// The derivatives, once their parts are seen to fit together.
    ///
    /// # Errors
    /// The first tape or pattern that has not the size the others imply.
    pub fn checked(self) -> Result<Self, Mismatch> {
        let (own, at) = (&self.mechanical, &self.patterns);
        let (n, m, params) = (own.n, own.m, own.stage.inputs()[3]);
        let multipliers = own.multipliers();
        let v_tau = at.v_tau.as_ref();
        let has_velocity = usize::from(own.patterns.v_z.is_some());
        check("v_tau", usize::from(v_tau.is_some()), has_velocity)?;
        let nonholonomic = self.nonholonomic.iter().zip(&at.nonholonomic);
        let count = usize::from(own.l() > 0);
        check("nonholonomic", nonholonomic.clone().count(), count)?;
        let v = v_tau.map_or(0, Pattern::len);
        let sum = |patterns: &[Pattern]| patterns.iter().map(Pattern::len).sum::<usize>();
        let tapes: [(_, &Tape, &[usize], _); 4] = [
            (
                "stage",
                &self.stage,
                &[1, n, n, params],
                at.p_tau.len() + at.f_tau.len() + v,
            ),
            (
                "node",
                &self.node,
                &[1, n, m, params],
                at.g_tau.len() + at.r_tau.len(),
            ),
            (
                "hidden",
                &self.hidden,
                &[1, n, n, params],
                at.w_y.len() + at.w_tau.len(),
            ),
            (
                "motion",
                &self.motion,
                &[1, n, n, n, multipliers, params],
                sum(&at.motion) + sum(&at.rate),
            ),
        ];
        let in_nu: [usize; 5] = [1, n, n, own.l(), params];
        let of_nonholonomic = nonholonomic
            .clone()
            .map(|(tape, at)| ("nonholonomic", tape, &in_nu[..], sum(at)));
        for (name, tape, inputs, outputs) in tapes.into_iter().chain(of_nonholonomic) {
            check(name, tape.inputs().len(), inputs.len())?;
            for (found, wanted) in tape.inputs().iter().zip(inputs) {
                check(name, *found, *wanted)?;
            }
            check(name, tape.outputs(), outputs)?;
        }
        let tau = 1 + params;
        let shapes = [
            ("p_tau", &at.p_tau, (n, tau)),
            ("f_tau", &at.f_tau, (n, tau)),
            ("g_tau", &at.g_tau, (m, tau)),
            ("r_tau", &at.r_tau, (n, tau)),
            ("w_y", &at.w_y, (m, n)),
            ("w_tau", &at.w_tau, (m, tau)),
        ];
        let of_v = v_tau.map(|pattern| ("v_tau", pattern, (n, tau)));
        let widths = [n, n, tau];
        let motion = at.motion.iter().zip(widths);
        let motion = motion.map(|(pattern, width)| ("motion", pattern, (n, width)));
        let rate = at.rate.iter().zip(widths);
        let rate = rate.map(|(pattern, width)| ("rate", pattern, (multipliers, width)));
        let heights = [own.l(), n];
        let nonholonomic = nonholonomic.flat_map(|(_, at)| at.iter().zip(heights));
        let nonholonomic =
            nonholonomic.map(|(pattern, height)| ("nonholonomic", pattern, (height, tau)));
        let all = shapes.into_iter().chain(of_v).chain(motion).chain(rate);
        for (name, pattern, shape) in all.chain(nonholonomic) {
            check_pattern(name, pattern, shape)?;
        }
        Ok(self)
    }

    /// Number of time and parameters.
    pub fn width(&self) -> usize {
        self.patterns.p_tau.shape().1
    }
}

/// The derivatives ready to be evaluated.
#[derive(Clone, Debug)]
pub struct SensitivityModel<R = f64> {
    /// The derivatives themselves, shared.
    pub problem: Arc<Sensitivity>,
    stage: TapeRegisters<R>,
    node: TapeRegisters<R>,
    hidden: Registers<R>,
    motion: Registers<R>,
    nonholonomic: Option<Registers<R>>,
}

impl<R: Real> SensitivityModel<R> {
    /// Binds parameters.
    ///
    /// # Panics
    /// When `params` has not the size the tapes have.
    pub fn new(problem: Arc<Sensitivity>, params: &[R]) -> Self {
        Self {
            stage: TapeRegisters::new(&problem.stage, params),
            node: TapeRegisters::new(&problem.node, params),
            hidden: problem.hidden.bind(params),
            motion: problem.motion.bind(params),
            nonholonomic: (problem.nonholonomic.as_ref()).map(|tape| tape.bind(params)),
            problem,
        }
    }

    /// Takes memory to be evaluated at so many stages and nodes at once.
    pub fn reserve_batch(&mut self, stages: usize, nodes: usize) {
        self.stage.reserve_batch(&self.problem.stage, stages);
        self.node.reserve_batch(&self.problem.node, nodes);
    }

    /// p_τ, f_τ, v_τ at (t, y, z); the last is empty where v is z.
    #[inline(always)]
    pub fn stage(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 3, R> {
        let (sizes, args): (_, [&[R]; 3]) = (self.stage_sizes(), [&[R::splat(t)], y, z]);
        cut(self.problem.stage.eval(&mut self.stage.one, args), sizes)
    }

    fn stage_sizes(&self) -> [usize; 3] {
        let at = &self.problem.patterns;
        let v = at.v_tau.as_ref().map_or(0, Pattern::len);
        [at.p_tau.len(), at.f_tau.len(), v]
    }

    /// [`SensitivityModel::stage`] at several points (t, y, z).
    #[inline(always)]
    pub fn stages<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 3, R> {
        let sizes = self.stage_sizes();
        self.stage.at(&self.problem.stage, at, sizes)
    }

    /// g_τ, r_τ at several points (t, y, λ).
    #[inline(always)]
    pub fn nodes<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 2, R> {
        let SensitivityPatterns { g_tau, r_tau, .. } = &self.problem.patterns;
        let sizes = [g_tau.len(), r_tau.len()];
        self.node.at(&self.problem.node, at, sizes)
    }

    /// g_τ, r_τ at one point (t, y, λ).
    #[inline(always)]
    pub fn node(&mut self, t: f64, y: &[R], lam: &[R]) -> Parts<'_, 2, R> {
        let at = &self.problem.patterns;
        let sizes = [at.g_tau.len(), at.r_tau.len()];
        let args: [&[R]; 3] = [&[R::splat(t)], y, lam];
        cut(self.problem.node.eval(&mut self.node.one, args), sizes)
    }

    /// w_y, w_τ at (t, y, z).
    #[inline(always)]
    pub fn hidden(&mut self, t: f64, y: &[R], z: &[R]) -> Parts<'_, 2, R> {
        let at = &self.problem.patterns;
        let sizes = [at.w_y.len(), at.w_tau.len()];
        let args: [&[R]; 3] = [&[R::splat(t)], y, z];
        cut(self.problem.hidden.eval(&mut self.hidden, args), sizes)
    }

    /// The derivatives of the equations of accelerations at (t, y, z), where z' is `u`.
    #[inline(always)]
    pub fn motion(&mut self, t: f64, [y, z, u, lam]: [&[R]; 4]) -> Parts<'_, 6, R> {
        let SensitivityPatterns { motion, rate, .. } = &self.problem.patterns;
        let of = |k: usize| {
            if k < 3 {
                motion[k].len()
            } else {
                rate[k - 3].len()
            }
        };
        let args: [&[R]; 5] = [&[R::splat(t)], y, z, u, lam];
        let values = self.problem.motion.eval(&mut self.motion, args);
        cut(values, std::array::from_fn(of))
    }

    /// k_τ and the derivative of r_n by τ at (t, y, z, ν); none without nonholonomic constraints.
    #[inline(always)]
    pub fn nonholonomic(&mut self, t: f64, [y, z, nu]: [&[R]; 3]) -> Option<Parts<'_, 2, R>> {
        let patterns = self.problem.patterns.nonholonomic.as_ref()?;
        let tape = self.problem.nonholonomic.as_ref()?;
        let (registers, args): (_, [&[R]; 4]) =
            (self.nonholonomic.as_mut()?, [&[R::splat(t)], y, z, nu]);
        let sizes = std::array::from_fn(|k| patterns[k].len());
        Some(cut(tape.eval(registers, args), sizes))
    }
}
