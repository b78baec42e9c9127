//! The flow of two coordinates by a Hamiltonian, the others frozen: symplectic Euler with Newton's method.
//!
//!     v' = F_w + U,   w' = −F_v + V
//!     w1 = w0 − h F_v(v0, w1) + h V,   v1 = v0 + h F_w(v0, w1) + h U
//!
//! and its adjoint, in which v is implicit. U and V are a mean flow, which has no periodic potential. The determinant of the
//! derivative is (1 + h F_vw)^−1 (1 + h F_vw) = 1 where the scalar equation is solved. With u the implicit and e the
//! explicit coordinate, both are u1 = u0 + σ h F_e(e0, u1), e1 = e0 − σ h F_u(e0, u1).
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

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

/// The Hamiltonian as a function of the implicit coordinate u, near a start.
pub(crate) trait Near {
    /// F_e and F_eu
    fn implicit(&mut self) -> (f64, f64);
    /// F_u
    fn explicit(&mut self) -> f64;
    /// Moves u to where an iterate is.
    fn go(&mut self, u: f64);
    /// Whether what a correction to `now` leaves is roundoff.
    fn is_solved(&mut self, now: f64, correction: f64) -> bool;
    /// Why there is no solution, if the last iterate is `now`.
    fn fault(&self, now: f64) -> Fault;
}

/// The flow from frozen coordinates, v and w, given F near these and the mean flow.
#[inline(always)]
pub(crate) fn solved(
    mut near: impl Near,
    frozen: usize,
    mean: [f64; 2],
    (x, is_adjoint, h): ([f64; 4], bool, f64),
) -> Result<[f64; 2], Fault> {
    let (e, u) = (usize::from(is_adjoint), usize::from(!is_adjoint));
    let sigma = if is_adjoint { h } else { -h };
    let start = x[frozen + u];
    let target = start + mean[u] * h;
    let (mut now, mut is_solved) = (start, false);
    for _ in 0..MOST_CORRECTIONS {
        let (change, slope) = near.implicit();
        let residual = now - target - change * sigma;
        let correction = residual / (1.0 - slope * sigma);
        now -= correction;
        near.go(now);
        if near.is_solved(now, correction) {
            is_solved = true;
            break;
        }
    }
    if !is_solved {
        return Err(near.fault(now));
    }
    let other = near.explicit();
    let moved = x[frozen + e] + mean[e] * h - other * sigma;
    Ok(if is_adjoint {
        [now, moved]
    } else {
        [moved, now]
    })
}
