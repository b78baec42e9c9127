//! The flow of a plane, compiled for each size of a spline and each instruction set.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::equation::{Fault, solved};
use crate::local::Local;
use crate::plane::Plane;
use crate::spline::Spline;
use crate::traced::Memory;
use liouville_base::simd::{InstructionSet, Kernel, SimdViews, Stored};

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
