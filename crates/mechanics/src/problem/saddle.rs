//! The matrix of every index-1 solve, by its Schur complement:
//!
//!     [ p_z      −r_λ ] [ x ]   [ a ]
//!     [ g_y v_z    0  ] [ μ ] = [ b ],     S = g_y v_z p_z⁻¹ r_λ   (m by m)
//!
//! or, where S would be large, as it stands: with V = v_z x for a further unknown, in the units of μ that
//! make r_λ as large as p_z. Nonholonomic constraints add the rows k_z and the columns −∂r_n/∂ν.
#![allow(clippy::inline_always)] // what is not inlined is compiled without the registers it is for

use super::model::finite;
use super::nonholonomic::diagnose_rank_all;
use super::whole::{Border, Whole};
use super::{Compliance, Mass, Mechanical, Model};
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{
    Lu, Matrix, NodeGram, NodeRows, Pattern, Singular, copy, dependencies,
};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;

/// `target[row.., col..] += factor * A Cᵀ` for a sparse A and the rows of C.
#[inline(always)]
pub(crate) fn add_product<R: Real>(
    pattern: &Pattern,
    values: &[R],
    factor: f64,
    rows: &Matrix<R>,
    target: &mut Matrix<R>,
    (row, col): (usize, usize),
) {
    let width = rows.rows();
    for (&(i, j), value) in pattern.entries().iter().zip(values) {
        let out = &mut target.row_mut(row + i)[col..col + width];
        for (k, out) in out.iter_mut().enumerate() {
            *out += *value * factor * rows[(k, j)];
        }
    }
}

/// The constraints whose gradients are dependent, if any are; otherwise `error` itself.
///
/// Of several members nothing is said: each is asked alone.
pub(crate) fn diagnose_rank<R: Real>(pattern: &Pattern, g_y: &[R], error: StepError) -> StepError {
    let found = R::alone(g_y).and_then(|g_y| dependencies(pattern, g_y));
    found.map_or(error, |constraints| StepError::DependentConstraints {
        constraints,
    })
}

/// The saddle-point matrix, factored.
#[derive(Clone, Debug)]
pub struct Saddle<R = f64> {
    /// `p_z` and `v_z`.
    pub mass: Mass<R>,
    factors: Factors<R>,
    g_y: Vec<R>,
    r_lam: Vec<R>,
    nonholonomic: Option<Border<R>>,
}

/// The matrix in one of three forms.
#[derive(Clone, Debug)]
enum Factors<R> {
    Schur {
        compliance: Matrix<R>,
        schur: Lu<R>,
        velocity: Vec<R>,
    },
    Eliminated(Box<Eliminated<R>>),
    Whole(Box<Whole<R>>),
}

/// The Schur complement, sparse.
#[derive(Clone, Debug)]
struct Eliminated<R> {
    g_y: NodeRows<R>,
    r_lam: NodeRows<R>,
    compliance: Compliance<R>,
    schur: NodeGram<R>,
    velocity: Vec<R>,
    /// What takes a mass that is not definite and wants other pivots, and whether it does now.
    whole: Option<Whole<R>>,
    is_whole: bool,
}

impl<R: Real> Saddle<R> {
    /// Memory for the saddle of this model.
    pub fn new(model: &Model<R>) -> Self {
        let problem = &model.problem;
        let order = problem.multipliers();
        let mass = Mass::new(model);
        let is_large = order >= WHOLE || order >= SPARSE && problem.is_sparse();
        let eliminated = is_large.then(|| Eliminated::new(problem, &mass)).flatten();
        let factors = match eliminated {
            Some(eliminated) => Factors::Eliminated(Box::new(eliminated)),
            None if order >= WHOLE => Factors::Whole(Box::new(Whole::new(problem))),
            None => Factors::Schur {
                compliance: Matrix::zeros(order, problem.n),
                schur: Lu::new(order),
                velocity: vec![R::splat(0.0); problem.n],
            },
        };
        Self {
            mass,
            factors,
            g_y: vec![R::splat(0.0); problem.patterns.g_y.len()],
            r_lam: vec![R::splat(0.0); problem.patterns.r_lam.len()],
            nonholonomic: problem.nonholonomic.as_ref().map(|own| Border {
                k_z: vec![R::splat(0.0); own.patterns.k_z.len()],
                r_nu: vec![R::splat(0.0); own.patterns.r_nu.len()],
            }),
        }
    }

    /// `g_y` it was last factored with.
    pub fn g_y(&self) -> &[R] {
        &self.g_y
    }

    /// `r_λ` it was last factored with.
    pub fn r_lam(&self) -> &[R] {
        &self.r_lam
    }

    /// `out += r_λ x`, as it was last factored with.
    pub fn add_reaction(&self, model: &Model<R>, x: &[R], out: &mut [R]) {
        if let Factors::Eliminated(eliminated) = &self.factors {
            eliminated.r_lam.add_product(x, out);
        } else {
            let pattern = &model.problem.patterns.r_lam;
            pattern.multiply_add(&self.r_lam, 1.0, x, out);
        }
    }

    /// `out += ∂r_n/∂ν x`, as it was last factored with.
    pub fn add_rolling(&self, model: &Model<R>, x: &[R], out: &mut [R]) {
        if let (Some(problem), Some(own)) = (&model.problem.nonholonomic, &self.nonholonomic) {
            problem.patterns.r_nu.multiply_add(&own.r_nu, 1.0, x, out);
        }
    }

    /// Factors the matrix at (t, y, z, λ), ν behind λ.
    ///
    /// # Errors
    /// A singular mass, redundant constraints, or a derivative that is not finite.
    pub fn update(
        &mut self,
        model: &mut Model<R>,
        t: f64,
        y: &[R],
        z: &[R],
        lam: &[R],
    ) -> Result<(), StepError> {
        self.mass.update(model, t, y, z)?;
        if model.problem.multipliers() == 0 {
            return Ok(());
        }
        let (lam, nu) = lam.split_at(model.problem.m);
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                let [g_y, r_lam] = model.node_blocks(t, y, lam);
                finite(g_y, Quantity::Derivative, t)?;
                finite(r_lam, Quantity::Derivative, t)?;
                copy(&mut self.g_y, g_y);
                copy(&mut self.r_lam, r_lam);
                Ok(())
            },
        )?;
        if let Some(own) = &mut self.nonholonomic {
            let [_, k_z, _, _, r_nu] = model.nonholonomic_blocks(t, y, z, nu);
            finite(k_z, Quantity::Derivative, t)?;
            finite(r_nu, Quantity::Derivative, t)?;
            copy(&mut own.k_z, k_z);
            copy(&mut own.r_nu, r_nu);
        }
        let factored = match &mut self.factors {
            Factors::Schur { .. } => self.factor_schur(&model.problem),
            Factors::Eliminated(eliminated) => {
                let found = eliminated.factor(&self.mass, &self.g_y, &self.r_lam);
                found.or_else(|_| {
                    let whole = eliminated.whole(&model.problem);
                    whole.factor(model.stage_blocks(t, y, z), &self.g_y, &self.r_lam, None)
                })
            }
            Factors::Whole(whole) => {
                let own = self.nonholonomic.as_ref();
                whole.factor(model.stage_blocks(t, y, z), &self.g_y, &self.r_lam, own)
            }
        };
        factored.map_err(|_| match &self.nonholonomic {
            None => diagnose_rank(
                &model.problem.patterns.g_y,
                &self.g_y,
                StepError::SingularNewton,
            ),
            Some(own) => diagnose_rank_all(&model.problem, &self.mass, &self.g_y, &own.k_z),
        })
    }

    fn factor_schur(&mut self, problem: &Mechanical) -> Result<(), Singular> {
        let Factors::Schur {
            compliance, schur, ..
        } = &mut self.factors
        else {
            return Ok(());
        };
        let at = &problem.patterns;
        schur.matrix_mut().clear();
        match (&problem.nonholonomic, &self.nonholonomic) {
            (Some(problem), Some(own)) => {
                let at_own = &problem.patterns;
                let m = compliance.rows() - problem.l;
                compliance.clear();
                at.r_lam.add_transposed(&self.r_lam, compliance, 0);
                at_own.r_nu.add_transposed(&own.r_nu, compliance, m);
                for row in 0..compliance.rows() {
                    self.mass.solve(compliance.row_mut(row));
                }
                let target = schur.matrix_mut();
                add_product(&at_own.k_z, &own.k_z, 1.0, compliance, target, (m, 0));
                self.mass.take_velocities(compliance);
            }
            _ => self.mass.compliance(&at.r_lam, &self.r_lam, compliance),
        }
        let target = schur.matrix_mut();
        dispatch_simd::<R, _>(
            #[inline(always)]
            || add_product(&at.g_y, &self.g_y, 1.0, compliance, target, (0, 0)),
        );
        schur.factor()
    }

    /// Solves in place: `a` becomes x, `b` becomes μ.
    pub fn solve(&mut self, model: &Model<R>, a: &mut [R], b: &mut [R]) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || self.solve_by(model, a, b),
        );
    }

    #[inline(always)]
    fn solve_by(&mut self, model: &Model<R>, a: &mut [R], b: &mut [R]) {
        let (problem, at) = (&model.problem, &model.problem.patterns);
        match &mut self.factors {
            _ if b.is_empty() => self.mass.solve(a),
            Factors::Schur {
                schur, velocity, ..
            } => {
                copy(velocity, a);
                if let (Some(problem), Some(own)) = (&problem.nonholonomic, &self.nonholonomic) {
                    let (b, at_own) = (&mut b[at.g_y.shape().0..], &problem.patterns);
                    self.mass.solve(velocity);
                    at_own.k_z.multiply_add(&own.k_z, -1.0, velocity, b);
                    copy(velocity, a);
                }
                self.mass.solve_velocity(velocity);
                at.g_y.multiply_add(&self.g_y, -1.0, velocity, b);
                schur.solve(b);
                at.r_lam.multiply_add(&self.r_lam, 1.0, b, a);
                if let (Some(problem), Some(own)) = (&problem.nonholonomic, &self.nonholonomic) {
                    let nu = &b[at.g_y.shape().0..];
                    problem.patterns.r_nu.multiply_add(&own.r_nu, 1.0, nu, a);
                }
                self.mass.solve(a);
            }
            Factors::Eliminated(eliminated) => {
                if let (true, Some(whole)) = (eliminated.is_whole, &mut eliminated.whole) {
                    return whole.solve(a, b);
                }
                // μ is found with its sign changed
                let velocity = &mut eliminated.velocity;
                copy(velocity, a);
                self.mass.solve_velocity(velocity);
                for b in &mut *b {
                    *b = -*b;
                }
                eliminated.g_y.add_product(velocity, b);
                eliminated.schur.solve(b);
                for b in &mut *b {
                    *b = -*b;
                }
                eliminated.r_lam.add_product(b, a);
                self.mass.solve(a);
            }
            Factors::Whole(whole) => whole.solve(a, b),
        }
    }
}

/// From this many constraints on, the matrix as it stands is solved sooner than by its Schur complement.
/// Measured on chains with a diagonal mass, Schur over whole: 0.6 at 24 links, 1.0 at 48, 1.4 at 64.
const WHOLE: usize = 48;
/// From here on its Schur complement is eliminated where most of `g_y` is zero. Measured on plane chains, sparse
/// over dense: 0.97 of a step with 10 links, 0.9 with 16, 0.84 with 24.
const SPARSE: usize = 12;

impl<R: Real> Eliminated<R> {
    /// Memory for the Schur complement of holonomic constraints; `None` where it is not sparse.
    fn new(problem: &Mechanical, mass: &Mass<R>) -> Option<Self> {
        if problem.nonholonomic.is_some() {
            return None;
        }
        let g_y = NodeRows::new(&problem.patterns.g_y, 1);
        let r_lam = NodeRows::new(&problem.patterns.r_lam, 1);
        let compliance = Compliance::new(mass, r_lam.pattern(), 1)?;
        let one = Matrix::from_fn(1, 1, |_, _| 1.0);
        Some(Self {
            schur: NodeGram::new(g_y.pattern(), compliance.pattern(), &one)?,
            g_y,
            r_lam,
            compliance,
            velocity: vec![R::splat(0.0); problem.n],
            whole: None,
            is_whole: false,
        })
    }

    fn factor(&mut self, mass: &Mass<R>, g_y: &[R], r_lam: &[R]) -> Result<(), Singular> {
        self.is_whole = false;
        self.g_y.set([g_y]);
        self.r_lam.set([r_lam]);
        let compliance = self.compliance.update(mass, self.r_lam.values());
        self.schur.factor(self.g_y.values(), compliance)
    }

    /// The matrix as it stands, to be factored instead.
    fn whole(&mut self, problem: &Mechanical) -> &mut Whole<R> {
        self.is_whole = true;
        self.whole.get_or_insert_with(|| Whole::new(problem))
    }
}
