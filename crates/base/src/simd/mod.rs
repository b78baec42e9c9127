//! Vector registers: one loop, compiled for each instruction set, chosen when it runs.
//!
//! A [`Kernel`] is written once over any [`Number`]. What is stored (a number, or several trajectories'
//! in lock-step) says through [`Stored::run`] which registers it is computed in. No fused operations
//! are used, so that every instruction set gives the same bits.
#![allow(clippy::inline_always)] // a kernel must be compiled for one instruction set as a whole

mod block;
mod windows;

pub use windows::ScalarViews;

use crate::real::Scalar;
use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, Div, Mul, Sub};

/// What a kernel computes with.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same constant for all.
    #[must_use]
    fn like(self, value: f64) -> Self;
    /// This times a constant.
    #[must_use]
    fn scaled(self, factor: f64) -> Self;
    /// e^x
    #[must_use]
    fn exp(self) -> Self;
    /// e^x - 1
    #[must_use]
    fn exp_m1(self) -> Self;
    /// ln(1 + x)
    #[must_use]
    fn ln_1p(self) -> Self;
    /// cos x
    #[must_use]
    fn cos(self) -> Self;
    /// sin x
    #[must_use]
    fn sin(self) -> Self;
    /// x^(-1/q) for x > 0 and q = 1, 2, 3.
    #[must_use]
    fn inverse_root(self, q: u32) -> Self;
    /// Whether all values are finite and below a bound.
    fn is_below(self, bound: f64) -> bool;
    /// Whether all values are finite.
    fn is_finite(self) -> bool;
}

/// How a kernel reads and writes one part of what is stored.
pub trait SimdView: Copy {
    /// What is stored.
    type Stored;
    /// What it is computed in.
    type Number: Number;

    /// A constant.
    fn constant(self, value: f64) -> Self::Number;
    /// Reads this part of `x[place]`, or what follows it.
    fn load(self, x: &[Self::Stored], place: usize) -> Self::Number;
    /// Reads `values[place]`, the same for all trajectories, or what follows it.
    fn shared(self, values: &[f64], place: usize) -> Self::Number;
    /// Reads this part of `x[place]`, the same again and again for what follows it.
    fn every(self, x: &[Self::Stored], place: usize) -> Self::Number;
    /// Writes this part of `x[place]`, or what follows it.
    fn store(self, x: &mut [Self::Stored], place: usize, value: Self::Number);
    /// The first trajectory in this part.
    fn first(self) -> usize;
}

/// What is done to each part of what is stored.
pub trait ForEach<S> {
    /// Does it for one part; false to stop.
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool;
}

/// How what is stored falls into parts.
pub trait SimdViews: Copy {
    /// What is stored.
    type Stored;

    /// Visits all parts of each of `count` numbers stored one after another; false where it was stopped.
    fn each<V: ForEach<Self::Stored>>(self, count: usize, visitor: &mut V) -> bool;
}

/// A computation on what is stored.
pub trait Kernel<S> {
    /// Its result.
    type Output;

    /// Makes it with these windows.
    fn run<W: SimdViews<Stored = S>>(self, windows: W) -> Self::Output;
}

/// What kernels can work on.
pub trait Stored: Scalar {
    /// Makes a computation on it.
    fn run<K: Kernel<Self>>(machine: InstructionSet, kernel: K) -> K::Output;
}

/// The instruction set a kernel is run with.
#[derive(Clone, Copy, Debug)]
pub struct InstructionSet(Arch);

impl Default for InstructionSet {
    /// The widest this machine has.
    fn default() -> Self {
        Self(Arch::new())
    }
}

struct Closure<F>(F);

impl<O, F: FnOnce() -> O> WithSimd for Closure<F> {
    type Output = O;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> O {
        (self.0)()
    }
}

/// Runs `f`, which is to be inlined, with the widest registers that this machine has, where it works on
/// several members.
#[inline(always)]
pub fn dispatch_simd<R: Scalar, O>(f: impl FnOnce() -> O) -> O {
    if R::MEMBERS == 1 {
        f()
    } else {
        Arch::new().dispatch(Closure(f))
    }
}

/// Vectors of one member are long from here on. Measured on steps of plane chains, dispatch_simd over not: 1.0 with 20
/// coordinates, 0.87 with 32, 0.83 with 48.
const LONG: usize = 32;

/// [`dispatch_simd`], and also where one member has vectors of such a `length` that they pay for the call.
#[inline(always)]
pub fn dispatch_simd_long<R: Scalar, O>(length: usize, f: impl FnOnce() -> O) -> O {
    if R::MEMBERS == 1 && length < LONG {
        f()
    } else {
        Arch::new().dispatch(Closure(f))
    }
}

/// [`dispatch_simd_long`] within what is [`dispatch_simd`] already where there are several members.
#[inline(always)]
pub fn dispatch_simd_nested<R: Scalar, O>(length: usize, f: impl FnOnce() -> O) -> O {
    if R::MEMBERS == 1 && length >= LONG {
        Arch::new().dispatch(Closure(f))
    } else {
        f()
    }
}

impl InstructionSet {
    /// All that this machine has, the widest last.
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self(Arch::Scalar)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|simd| Self(Arch::V3(simd))));
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V4::try_new().map(|simd| Self(Arch::V4(simd))));
        all
    }
}
