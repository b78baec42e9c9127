//! The flow of two coordinates by a Hamiltonian, the others frozen: symplectic Euler with Newton's method,
//! for members in lock-step.
//!
//!     v' = F_w + U,   w' = −F_v + V
//!     w1 = w0 − h F_v(v0, w1) + h V,   v1 = v0 + h F_w(v0, w1) + h U
//!
//! and its adjoint, in which v is implicit. U and V are a mean flow, which has no periodic potential. The determinant of the
//! derivative is (1 + h F_vw)^−1 (1 + h F_vw) = 1 where the scalar equation is solved. With u the implicit and e the
//! explicit coordinate, both are u1 = u0 + σ h F_e(e0, u1), e1 = e0 − σ h F_u(e0, u1).
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use liouville_base::real::Real;

/// Newton's corrections, of which there are two to five up to the largest steps.
pub const MOST_CORRECTIONS: usize = 12;

/// Why a flow could not be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// A coordinate is outside its axis, by its number among frozen ones, v and w.
    Outside(usize),
    /// Newton's method did not converge; the last correction, on a grid in parts of a cell.
    NotConverged(f64),
    /// The Hamiltonian, or a derivative of it, is not finite.
    NotFinite,
}

/// The Hamiltonian as a function of the implicit coordinate u, near the starts of members.
pub(crate) trait Near<R> {
    /// F_e, F_eu and F_euu / 2, which may be zero for any function.
    fn implicit(&mut self) -> [R; 3];
    /// F_u
    fn explicit(&mut self) -> R;
    /// Moves u to where an iterate is.
    fn go(&mut self, u: R);
    /// Zero for members whose corrections to `now` leave roundoff.
    fn unsolved(&mut self, now: R, correction: R) -> R;
    /// Why there is no solution for a member, if its last iterate is `now`.
    fn fault(&self, member: usize, now: f64) -> Fault;
}

/// Moves members from frozen coordinates, v and w, given F near these and the mean flow.
///
/// # Errors
/// The first member that has no solution.
///
/// Corrections are Chebyshev's, d = r − r² f''/(2 f') with Newton's r = f/f', whose error is of third order.
#[inline(always)]
pub(crate) fn solved<R: Real>(
    mut near: impl Near<R>,
    frozen: usize,
    mean: [R; 2],
    (x, is_adjoint, h): (&mut [R; 4], bool, f64),
) -> Result<(), (Fault, usize)> {
    let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
    let sigma = R::splat(if is_adjoint { h } else { -h });
    let one = R::splat(1.0);
    let target = x[frozen + u] + mean[u] * h;
    let (mut now, mut open) = (x[frozen + u], one);
    for _ in 0..MOST_CORRECTIONS {
        let [change, slope, curve] = near.implicit();
        let inverse = one / (one - slope * sigma);
        let newton = (now - target - change * sigma) * inverse;
        let correction = newton - newton * newton * (curve * sigma * inverse);
        now = open.choose(now - correction, now);
        near.go(now);
        open = open.choose(near.unsolved(now, correction), open);
        if open.all(
            #[inline(always)]
            |open| open == 0.0,
        ) {
            let other = near.explicit();
            x[frozen + u] = now;
            x[frozen + e] = x[frozen + e] + mean[e] * h - other * sigma;
            return Ok(());
        }
    }
    let member = (0..R::MEMBERS).find(|member| open.member(*member) != 0.0);
    let member = member.unwrap_or(0);
    Err((near.fault(member, now.member(member)), member))
}
