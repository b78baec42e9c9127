//! Solves with the transposed saddle-point matrix, whose factors are those of the matrix:
//!
//!     [ p_zᵀ   v_zᵀ g_yᵀ ] [ x ]   [ a ]
//!     [ −r_λᵀ       0    ] [ μ ] = [ b ],     Sᵀ μ = b + r_λᵀ p_z⁻ᵀ a
//!
//! and k_zᵀ beside v_zᵀ g_yᵀ, −∂r_n/∂νᵀ below −r_λᵀ.

use super::{Eliminated, Form, Saddle};
use crate::{Mass, Model};
use liouville_base::linalg::copy;
use liouville_base::real::Real;

impl<R: Real> Saddle<R> {
    /// Solves with the transposed matrix in place: `a` becomes x, `b` becomes μ.
    pub fn solve_transposed(&mut self, model: &Model<R>, a: &mut [R], b: &mut [R]) {
        let at = &model.problem.patterns;
        match &mut self.form {
            _ if b.is_empty() => self.mass.solve_transposed(a),
            Form::Dense {
                schur, velocity, ..
            } => {
                copy(velocity, a);
                self.mass.solve_transposed(velocity);
                at.r_lam
                    .multiply_add_transposed(&self.r_lam, 1.0, velocity, b);
                let own = (model.problem.nonholonomic.as_ref()).zip(self.nonholonomic.as_ref());
                if let Some((problem, own)) = own {
                    let (nu, at_own) = (&mut b[at.g_y.shape().0..], &problem.patterns);
                    let r_nu = &at_own.r_nu;
                    r_nu.multiply_add_transposed(&own.r_nu, 1.0, velocity, nu);
                }
                schur.solve_transposed(b);
                velocity.fill(R::splat(0.0));
                at.g_y.multiply_add_transposed(&self.g_y, 1.0, b, velocity);
                self.mass.add_velocity_transposed(-1.0, velocity, a);
                if let Some((problem, own)) = own {
                    let (nu, at_own) = (&b[at.g_y.shape().0..], &problem.patterns);
                    let k_z = &at_own.k_z;
                    k_z.multiply_add_transposed(&own.k_z, -1.0, nu, a);
                }
                self.mass.solve_transposed(a);
            }
            Form::Sparse(eliminated) => eliminated.solve_transposed(&mut self.mass, a, b),
            Form::Kkt(kkt) => kkt.solve_transposed(a, b),
        }
    }
}

impl<R: Real> Eliminated<R> {
    fn solve_transposed(&mut self, mass: &mut Mass<R>, a: &mut [R], b: &mut [R]) {
        if let (true, Some(kkt)) = (self.is_kkt, &mut self.kkt) {
            return kkt.solve_transposed(a, b);
        }
        let velocity = &mut self.velocity;
        copy(velocity, a);
        mass.solve_transposed(velocity);
        (self.schur.r_lam()).add_product_transposed::<1>(1, velocity, b);
        self.schur.solve_transposed(b);
        velocity.fill(R::splat(0.0));
        (self.schur.g_y()).add_product_transposed::<1>(1, b, velocity);
        mass.add_velocity_transposed(-1.0, velocity, a);
        mass.solve_transposed(a);
    }
}
