//! Vector registers: one loop, compiled for each instruction set and dispatched when it runs.
//!
//! A [`Kernel`] is written once over any [`Number`]. The type of a state's elements, a number or several trajectories'
//! in lock-step, selects through [`Stored::run`] the registers for it. There are no fused operations but those whose result
//! is exact, so that every instruction set gives the same bits.
#![allow(clippy::inline_always)] // a kernel must be compiled for one instruction set as a whole

mod block;
mod views;

pub use crate::real::Number;

use crate::real::{Real, Scalar};
use pulp::{Arch, Simd, WithSimd};

/// Access of a kernel to one part of stored numbers.
pub trait SimdView: Copy {
    /// The type in memory.
    type Stored;
    /// The type in registers.
    type Number: Number;

    /// A constant.
    fn constant(self, value: f64) -> Self::Number;
    /// Reads this part of `x[place]`, or of the places from there on.
    fn load(self, x: &[Self::Stored], place: usize) -> Self::Number;
    /// Reads `values[place]`, the same for all trajectories, or the values from there on.
    fn shared(self, values: &[f64], place: usize) -> Self::Number;
    /// Reads this part of `x[place]`, the same for all places of the view.
    fn every(self, x: &[Self::Stored], place: usize) -> Self::Number;
    /// Writes this part of `x[place]`, or of the places from there on.
    fn store(self, x: &mut [Self::Stored], place: usize, value: Self::Number);
    /// The first trajectory in this part.
    fn first(self) -> usize;
}

/// An operation on each part of stored numbers.
pub trait ForEach<S> {
    /// Does it for one part; false to stop.
    fn visit<V: SimdView<Stored = S>>(&mut self, view: V) -> bool;
}

/// The parts of stored numbers.
pub trait SimdViews: Copy {
    /// The type in memory.
    type Stored;

    /// Visits all parts of each of `count` numbers stored one after another; false where it was stopped.
    fn each<V: ForEach<Self::Stored>>(self, count: usize, visitor: &mut V) -> bool;

    /// The same in parts of few registers, for long formulas: the registers of the machine then hold all that is between.
    fn each_narrow<V: ForEach<Self::Stored>>(self, count: usize, visitor: &mut V) -> bool;

    /// Visits all parts of one number: a register of several numbers in a row is not compiled for it.
    fn one<V: ForEach<Self::Stored>>(self, visitor: &mut V) -> bool;

    /// The same in parts of a quarter of the machine's registers, for formulas of a few numbers that are needed to the end.
    fn one_quarter<V: ForEach<Self::Stored>>(self, visitor: &mut V) -> bool;

    /// The same in parts of few registers.
    fn one_narrow<V: ForEach<Self::Stored>>(self, visitor: &mut V) -> bool;

    /// Makes a computation in a function of its own: parts that are all inlined make one long function, which takes the
    /// compiler longer than its parts do.
    fn call<K: Kernel<Self::Stored>>(self, kernel: K) -> K::Output;
}

/// A computation on stored numbers.
pub trait Kernel<S> {
    /// Its result.
    type Output;

    /// Makes it with these views.
    fn run<W: SimdViews<Stored = S>>(self, views: W) -> Self::Output;
}

/// Numbers in memory that kernels work on.
pub trait Stored: Scalar {
    /// Trajectories that are computed together where each reads numbers of its own.
    type Group: Real + Stored + std::fmt::Debug;
    /// How many groups there are.
    const GROUPS: usize = Self::MEMBERS / Self::Group::MEMBERS;

    /// The values of a group.
    fn group(&self, group: usize) -> Self::Group;
    /// Sets them.
    fn set_group(&mut self, group: usize, values: Self::Group);
    /// Makes a computation with the registers of an instruction set.
    fn run<K: Kernel<Self>>(machine: InstructionSet, kernel: K) -> K::Output;
}

/// The instruction set a kernel is run with.
#[derive(Clone, Copy, Debug)]
pub struct InstructionSet(Arch);

impl Default for InstructionSet {
    /// The widest of this machine.
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

/// Runs `f`, which must be inlined, with the widest registers of this machine where `R` has several members.
#[inline(always)]
pub fn dispatch_simd<R: Scalar, O>(f: impl FnOnce() -> O) -> O {
    if R::IS_SINGLE { f() } else { widest(f) }
}

/// Runs `f`, which must be inlined, with registers of four numbers and fused operations in one instruction.
#[inline(always)]
pub fn dispatch_fused<O>(f: impl FnOnce() -> O) -> O {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        return simd.vectorize(f);
    }
    f()
}

/// Vectors of one member are long from here on. Measured on steps of Andrews' mechanism, with 7 coordinates: without wide
/// registers 1.1 of the time.
const LONG: usize = 5;

/// [`dispatch_simd`], and for one member where vectors have such a `length` that they pay for the call.
#[inline(always)]
pub fn dispatch_simd_long<R: Scalar, O>(length: usize, f: impl FnOnce() -> O) -> O {
    if R::IS_SINGLE {
        dispatch_if_long(length, f)
    } else {
        widest(f)
    }
}

/// One copy for short vectors and for machines without wide registers, and one for each wider instruction set.
#[inline(always)]
fn dispatch_if_long<O>(length: usize, f: impl FnOnce() -> O) -> O {
    let arch = if length < LONG {
        Arch::Scalar
    } else {
        Arch::new()
    };
    arch.dispatch(Closure(f))
}

#[inline(always)]
fn widest<O>(f: impl FnOnce() -> O) -> O {
    Arch::new().dispatch(Closure(f))
}

impl InstructionSet {
    /// All of this machine, the widest last.
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self(Arch::Scalar)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|simd| Self(Arch::V3(simd))));
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V4::try_new().map(|simd| Self(Arch::V4(simd))));
        all
    }
}
