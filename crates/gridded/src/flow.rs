//! The flow of two coordinates by a Hamiltonian, the others frozen: symplectic Euler with Newton's method.
//!
//!     v' = F_w + U,   w' = −F_v + V
//!     w1 = w0 − h F_v(v0, w1) + h V,   v1 = v0 + h F_w(v0, w1) + h U
//!
//! and its adjoint, in which v is implicit. U and V are a mean flow, which has no periodic potential. The determinant of the
//! derivative is (1 + h F_vw)^−1 (1 + h F_vw) = 1 where the scalar equation is solved. With u the implicit and e the
//! explicit coordinate, both are u1 = u0 + σ h F_e(e0, u1), e1 = e0 − σ h F_u(e0, u1).
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::plane::Plane;
use crate::spline::{Local, Spline};
use crate::traced::Memory;
use liouville_base::simd::{InstructionSet, Kernel, SimdViews, Stored};

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

/// A flow of one trajectory: coordinates are the frozen ones, v and w.
#[derive(Debug)]
pub struct PlaneFlow<'a> {
    /// The Hamiltonian.
    pub plane: &'a Plane,
    /// Its memory.
    pub memory: &'a mut Memory,
    /// The coordinates.
    pub x: [f64; 4],
    /// Whether v is implicit.
    pub is_adjoint: bool,
    /// The length of the flow.
    pub h: f64,
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

impl PlaneFlow<'_> {
    /// Makes the flow: the new v and w.
    ///
    /// # Errors
    /// A coordinate is outside its axis, the equation was not solved, or the Hamiltonian is not finite.
    pub fn run(&mut self, machine: InstructionSet) -> Result<[f64; 2], Fault> {
        let start = (self.x, self.is_adjoint, self.h);
        match self.plane {
            Plane::Spline(spline) => f64::run(machine, OnGrid(spline, start)),
            Plane::Traced(traced) => {
                let near = traced.near(&self.x, self.is_adjoint, self.h, self.memory);
                solved(near, traced.frozen(), [0.0; 2], start)
            }
        }
    }
}

/// The flow from frozen coordinates, v and w, given F near these and the mean flow.
#[inline(always)]
fn solved(
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

/// A spline, and a start with the kind and the length of its flow.
struct OnGrid<'a>(&'a Spline, ([f64; 4], bool, f64));

impl Kernel<f64> for OnGrid<'_> {
    type Output = Result<[f64; 2], Fault>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(self, views: W) -> Self::Output {
        match (self.0.axes[0].degree(), self.0.frozen()) {
            (3, 0) => views.call(Sized::<4, 6, 0>(self)),
            (3, 1) => views.call(Sized::<4, 6, 1>(self)),
            (3, _) => views.call(Sized::<4, 6, 2>(self)),
            (_, 0) => views.call(Sized::<6, 8, 0>(self)),
            (_, 1) => views.call(Sized::<6, 8, 1>(self)),
            _ => views.call(Sized::<6, 8, 2>(self)),
        }
    }
}

/// A flow with the sizes that it is compiled for: `N` functions on a cell, `M` in a window and `K` frozen coordinates.
struct Sized<'a, const N: usize, const M: usize, const K: usize>(OnGrid<'a>);

impl<const N: usize, const M: usize, const K: usize> Kernel<f64> for Sized<'_, N, M, K> {
    type Output = Result<[f64; 2], Fault>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(self, _: W) -> Self::Output {
        let OnGrid(spline, start) = self.0;
        let local = Local::<N, M, K>::new(spline, &start.0, start.1)?;
        let mean = local.mean;
        solved(local, K, mean, start)
    }
}
