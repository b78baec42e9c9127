//! The mass matrix of a mechanical system, p_z, factored.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::MemberLanes;
use super::model::finite;
use super::{Mechanical, Model};
use liouville_base::compiled;
use liouville_base::error::{Quantity, StepError};
use liouville_base::linalg::{Factor, Matrix, Pattern, add_scaled, copy, max_norm};
use liouville_base::real::Real;
use liouville_base::simd::dispatch_simd;
use std::sync::Arc;

/// `p_z` factored, and `v_z`; made once when both depend on parameters alone.
#[derive(Clone, Debug)]
pub struct Mass<R = f64> {
    problem: Arc<Mechanical>,
    factor: Factor<R>,
    v_z: Option<(Pattern, Vec<R>)>,
    is_constant: bool,
    is_ready: bool,
    column: Vec<R>,
    impulse: Vec<R>,
}

impl<R: Real> Mass<R> {
    /// Memory for the mass of this model.
    #[inline(never)]
    pub fn new(model: &Model<R>) -> Self {
        let at = &model.problem.patterns;
        Self {
            problem: model.problem.clone(),
            factor: Factor::planned(&at.p_z, &model.problem.mass_plan),
            v_z: at
                .v_z
                .clone()
                .map(|pattern| (pattern.clone(), vec![R::splat(0.0); pattern.len()])),
            is_constant: model.problem.stage_blocks.is_empty(),
            is_ready: false,
            column: vec![R::splat(0.0); model.problem.n],
            impulse: vec![R::splat(0.0); model.problem.n],
        }
    }

    /// Brings the factors to (t, y, z).
    ///
    /// # Errors
    /// [`StepError::SingularMass`], or a derivative that is not finite.
    pub fn update(
        &mut self,
        model: &mut Model<R>,
        t: f64,
        y: &[R],
        z: &[R],
    ) -> Result<(), StepError> {
        if self.is_ready && self.is_constant {
            return Ok(());
        }
        let [p_z, v_z] = dispatch_simd::<R, _>(
            #[inline(always)]
            || model.stage_blocks(t, y, z),
        );
        finite(p_z, Quantity::Derivative, t)?;
        finite(v_z, Quantity::Derivative, t)?;
        self.set(p_z, v_z)
    }

    /// Brings the factors to these values.
    ///
    /// # Errors
    /// [`StepError::SingularMass`].
    pub fn set(&mut self, p_z: &[R], v_z: &[R]) -> Result<(), StepError> {
        if self.is_ready && self.is_constant {
            return Ok(());
        }
        if let Some((_, values)) = &mut self.v_z {
            values.copy_from_slice(v_z);
        }
        self.factor
            .factor(&self.problem.patterns.p_z, p_z)
            .map_err(|singular| StepError::SingularMass {
                coordinate: singular.column,
            })?;
        self.is_ready = true;
        Ok(())
    }

    /// Whether its determinant is negative, of the first of several members; `None` where that is not known.
    pub fn is_negative(&self) -> Option<bool> {
        self.factor.is_negative()
    }

    /// `x = p_z⁻¹ x`
    #[inline(always)]
    pub fn solve(&mut self, x: &mut [R]) {
        self.factor.solve(x);
    }

    /// `out += v_z x`
    #[inline(always)]
    pub fn add_velocity(&self, x: &[R], out: &mut [R]) {
        match &self.v_z {
            Some((pattern, values)) => pattern.multiply_add(values, 1.0, x, out),
            None => {
                for (out, x) in out.iter_mut().zip(x) {
                    *out += *x;
                }
            }
        }
    }

    /// `x = v_z p_z⁻¹ x`
    #[inline(always)]
    pub fn solve_velocity(&mut self, x: &mut [R]) {
        self.factor.solve(x);
        if self.v_z.is_some() {
            copy(&mut self.column, x);
            x.fill(R::splat(0.0));
            self.add_velocity(&self.column, x);
        }
    }

    /// The largest velocity that the impulse `r_λ dΛ` gives.
    #[inline(always)]
    pub fn velocity_of(&mut self, r_lam: &[R], d_lam: &[R]) -> R {
        let mut velocity = std::mem::take(&mut self.impulse);
        velocity.fill(R::splat(0.0));
        let pattern = &self.problem.patterns.r_lam;
        pattern.multiply_add(r_lam, 1.0, d_lam, &mut velocity);
        self.largest(velocity)
    }

    /// The largest velocity that the impulse `A x` gives.
    pub fn velocity_by(&mut self, pattern: &Pattern, values: &[R], x: &[R]) -> R {
        let mut velocity = std::mem::take(&mut self.impulse);
        velocity.fill(R::splat(0.0));
        pattern.multiply_add(values, 1.0, x, &mut velocity);
        self.largest(velocity)
    }

    #[inline(always)]
    fn largest(&mut self, mut impulse: Vec<R>) -> R {
        self.solve_velocity(&mut impulse);
        self.impulse = impulse;
        max_norm(&self.impulse)
    }

    /// `(v_z p_z⁻¹ A)ᵀ`, one row for each column of A.
    #[inline(never)]
    pub fn inverse_mass_rt(&mut self, pattern: &Pattern, values: &[R], out: &mut Matrix<R>) {
        dispatch_simd::<R, _>(
            #[inline(always)]
            || {
                out.clear();
                for (&(row, col), value) in pattern.entries().iter().zip(values) {
                    out[(col, row)] += *value;
                }
                for col in 0..pattern.shape().1 {
                    self.solve_velocity(out.row_mut(col));
                }
            },
        );
    }

    /// Each row x of `rows` becomes `v_z x`.
    pub(super) fn take_velocities(&mut self, rows: &mut Matrix<R>) {
        if self.v_z.is_some() {
            for row in 0..rows.rows() {
                copy(&mut self.column, rows.row(row));
                rows.row_mut(row).fill(R::splat(0.0));
                self.add_velocity(&self.column, rows.row_mut(row));
            }
        }
    }

    /// Where `p_z`⁻¹ is not zero, if it falls into small blocks.
    pub(super) fn inverse_pattern(&self) -> Option<Pattern> {
        self.factor.inverse_pattern()
    }

    /// `p_z`⁻¹ on that pattern.
    pub(super) fn inverse_values(&self) -> &[R] {
        self.factor.inverse_values()
    }

    /// `v_z`, where it is not the identity.
    pub(super) fn v_z(&self) -> Option<(&Pattern, &[R])> {
        let (pattern, values) = self.v_z.as_ref()?;
        Some((pattern, values))
    }

    /// `x = p_z⁻ᵀ x`
    pub fn solve_transposed(&mut self, x: &mut [R]) {
        self.factor.solve_transposed(x);
    }

    /// `out += factor * v_zᵀ x`
    pub fn add_velocity_transposed(&self, factor: f64, x: &[R], out: &mut [R]) {
        match &self.v_z {
            Some((pattern, values)) => pattern.multiply_add_transposed(values, factor, x, out),
            None => add_scaled(out, factor, x),
        }
    }
}

compiled!(R in [f64, MemberLanes] {
    Mass::<R>::new as fn(_) -> _,
    Mass::<R>::inverse_mass_rt as fn(_, _, _, _),
});
