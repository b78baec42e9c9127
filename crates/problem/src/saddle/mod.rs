//! The matrix of every index-1 solve, by its Schur complement:
//!
//!     [ p_z      −r_λ ] [ x ]   [ a ]
//!     [ g_y v_z    0  ] [ μ ] = [ b ],     S = g_y v_z p_z⁻¹ r_λ   (m by m)
//!
//! or, where S would be large, as it stands: with V = v_z x for a further unknown, in the units of μ that
//! make r_λ as large as p_z. Nonholonomic constraints add the rows k_z and the columns −∂r_n/∂ν.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

mod transposed;

use super::MemberLanes;
use super::kkt::{KktMatrix, NonholonomicBlocks};
use super::model::finite;
use super::nonholonomic::diagnose_rank_all;
use super::schur::SparseSchur;
use super::{Mass, Mechanical, Model};
use liouville_base::compiled;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::choice::{KKT_SADDLE, SPARSE_SADDLE};
use liouville_base::linalg::{Lu, Matrix, Pattern, Singular, copy, dependencies};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;

/// `target[row.., col..] += factor * A Cᵀ` for a sparse A and the rows of C.
#[inline(always)]
pub fn add_product<R: Real>(
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
#[inline(never)]
pub fn diagnose_rank<R: Real>(pattern: &Pattern, g_y: &[R], error: StepError) -> StepError {
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
    form: Form<R>,
    g_y: Vec<R>,
    r_lam: Vec<R>,
    nonholonomic: Option<NonholonomicBlocks<R>>,
}

/// The matrix eliminated by its Schur complement, dense or sparse, or as it stands.
#[derive(Clone, Debug)]
enum Form<R> {
    Dense {
        /// `(v_z p_z⁻¹ r_λ)ᵀ`
        inverse_mass_rt: Matrix<R>,
        schur: Lu<R>,
        velocity: Vec<R>,
    },
    Sparse(Box<Eliminated<R>>),
    Kkt(Box<KktMatrix<R>>),
}

/// The sparse Schur complement of holonomic constraints.
#[derive(Clone, Debug)]
struct Eliminated<R> {
    schur: SparseSchur<R>,
    velocity: Vec<R>,
    /// The pivoted matrix for a mass that is not definite, and whether it is in use.
    kkt: Option<KktMatrix<R>>,
    is_kkt: bool,
}

impl<R: Real> Saddle<R> {
    /// Memory for the saddle of this model.
    #[inline(never)]
    pub fn new(model: &Model<R>) -> Self {
        let problem = &model.problem;
        let order = problem.multipliers();
        let mass = Mass::new(model);
        let is_large = order >= KKT_SADDLE || order >= SPARSE_SADDLE && problem.is_sparse();
        let eliminated = is_large.then(|| Eliminated::new(problem, &mass)).flatten();
        let form = match eliminated {
            Some(eliminated) => Form::Sparse(Box::new(eliminated)),
            None if order >= KKT_SADDLE => Form::Kkt(Box::new(KktMatrix::of(problem))),
            None => Form::Dense {
                inverse_mass_rt: Matrix::zeros(order, problem.n),
                schur: Lu::new(order),
                velocity: vec![R::splat(0.0); problem.n],
            },
        };
        Self {
            mass,
            form,
            g_y: vec![R::splat(0.0); problem.patterns.g_y.len()],
            r_lam: vec![R::splat(0.0); problem.patterns.r_lam.len()],
            nonholonomic: problem.nonholonomic.as_ref().map(|own| NonholonomicBlocks {
                k_z: vec![R::splat(0.0); own.patterns.k_z.len()],
                r_nu: vec![R::splat(0.0); own.patterns.r_nu.len()],
            }),
        }
    }

    /// Whether it is eliminated constraint by constraint, as sparse as their couplings.
    pub fn is_eliminated(&self) -> bool {
        matches!(self.form, Form::Sparse(_))
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
        if let Form::Sparse(eliminated) = &self.form {
            let r_lam = eliminated.schur.r_lam();
            r_lam.add_product::<1>(1, x, out);
        } else {
            let pattern = &model.problem.patterns.r_lam;
            pattern.multiply_add(&self.r_lam, 1.0, x, out);
        }
    }

    /// `out += ∂r_n/∂ν x`, as it was last factored with.
    pub fn add_nonholonomic(&self, model: &Model<R>, x: &[R], out: &mut [R]) {
        if let (Some(problem), Some(own)) = (&model.problem.nonholonomic, &self.nonholonomic) {
            problem.patterns.r_nu.multiply_add(&own.r_nu, 1.0, x, out);
        }
    }

    /// The largest velocity that the impulses of multipliers x give, ν behind λ, as it was last factored with.
    pub fn velocity_of(&mut self, model: &Model<R>, x: &[R]) -> R {
        let (d_lam, d_nu) = x.split_at(model.problem.m);
        let size = self.mass.velocity_of(&self.r_lam, d_lam);
        match (&model.problem.nonholonomic, &self.nonholonomic) {
            (Some(problem), Some(own)) => {
                let pattern = &problem.patterns.r_nu;
                size + self.mass.velocity_by(pattern, &own.r_nu, d_nu)
            }
            _ => size,
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
        let factored = match &mut self.form {
            Form::Dense { .. } => self.factor_schur(&model.problem),
            Form::Sparse(eliminated) => {
                let found = eliminated.factor(&self.mass, &self.g_y, &self.r_lam);
                found.or_else(|_| {
                    let kkt = eliminated.kkt(&model.problem);
                    kkt.factor(model.stage_blocks(t, y, z), &self.g_y, &self.r_lam, None)
                })
            }
            Form::Kkt(kkt) => {
                let own = self.nonholonomic.as_ref();
                kkt.factor(model.stage_blocks(t, y, z), &self.g_y, &self.r_lam, own)
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
        let Form::Dense {
            inverse_mass_rt,
            schur,
            ..
        } = &mut self.form
        else {
            return Ok(());
        };
        let at = &problem.patterns;
        schur.matrix_mut().clear();
        match (&problem.nonholonomic, &self.nonholonomic) {
            (Some(problem), Some(own)) => {
                let at_own = &problem.patterns;
                let m = inverse_mass_rt.rows() - problem.l;
                inverse_mass_rt.clear();
                at.r_lam.add_transposed(&self.r_lam, inverse_mass_rt, 0);
                at_own.r_nu.add_transposed(&own.r_nu, inverse_mass_rt, m);
                for row in 0..inverse_mass_rt.rows() {
                    self.mass.solve(inverse_mass_rt.row_mut(row));
                }
                let target = schur.matrix_mut();
                add_product(&at_own.k_z, &own.k_z, 1.0, inverse_mass_rt, target, (m, 0));
                self.mass.take_velocities(inverse_mass_rt);
            }
            _ => (self.mass).inverse_mass_rt(&at.r_lam, &self.r_lam, inverse_mass_rt),
        }
        let target = schur.matrix_mut();
        dispatch_simd::<R, _>(
            #[inline(always)]
            || add_product(&at.g_y, &self.g_y, 1.0, inverse_mass_rt, target, (0, 0)),
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
        match &mut self.form {
            _ if b.is_empty() => self.mass.solve(a),
            Form::Dense {
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
            Form::Sparse(eliminated) => eliminated.solve(&mut self.mass, a, b),
            Form::Kkt(kkt) => kkt.solve(a, b),
        }
    }
}

impl<R: Real> Eliminated<R> {
    /// Memory for the Schur complement of holonomic constraints; `None` where it is not sparse.
    fn new(problem: &Mechanical, mass: &Mass<R>) -> Option<Self> {
        if problem.nonholonomic.is_some() {
            return None;
        }
        let one = Matrix::from_fn(1, 1, |_, _| 1.0);
        Some(Self {
            schur: SparseSchur::new(problem, mass, &one)?,
            velocity: vec![R::splat(0.0); problem.n],
            kkt: None,
            is_kkt: false,
        })
    }

    fn factor(&mut self, mass: &Mass<R>, g_y: &[R], r_lam: &[R]) -> Result<(), Singular> {
        self.is_kkt = false;
        (self.schur).factor::<1>(1, mass, |_| g_y, |_| r_lam)
    }

    /// The KKT matrix, to be factored instead.
    fn kkt(&mut self, problem: &Mechanical) -> &mut KktMatrix<R> {
        self.is_kkt = true;
        self.kkt.get_or_insert_with(|| KktMatrix::of(problem))
    }

    #[inline(always)]
    fn solve(&mut self, mass: &mut Mass<R>, a: &mut [R], b: &mut [R]) {
        if let (true, Some(kkt)) = (self.is_kkt, &mut self.kkt) {
            return kkt.solve(a, b);
        }
        // μ is found with its sign changed
        copy(&mut self.velocity, a);
        mass.solve_velocity(&mut self.velocity);
        for b in &mut *b {
            *b = -*b;
        }
        (self.schur.g_y()).add_product::<1>(1, &self.velocity, b);
        self.schur.solve(b);
        for b in &mut *b {
            *b = -*b;
        }
        (self.schur.r_lam()).add_product::<1>(1, b, a);
        mass.solve(a);
    }
}

compiled!(R in [f64, MemberLanes] {
    Saddle::<R>::new as fn(_) -> _,
    diagnose_rank::<R> as fn(_, _, _) -> _,
});
