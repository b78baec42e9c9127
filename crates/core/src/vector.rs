//! Vector registers: one loop, compiled for each instruction set, chosen when it runs.
//!
//! A [`Kernel`] is written once over any [`Number`]. What is stored (a number, or several trajectories'
//! in lock-step) says through [`Machine::run`] which registers it is computed in. No fused operations
//! are used, so that every instruction set gives the same bits.
#![allow(clippy::inline_always)] // a kernel must be compiled for one instruction set as a whole

use crate::elementary::{self, Register};
use crate::real::{Lanes, Scalar};
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
    /// x^(-1/q) for x > 0 and q = 1, 2, 3.
    #[must_use]
    fn inverse_root(self, q: u32) -> Self;
    /// Whether all values are finite and below a bound.
    fn is_below(self, bound: f64) -> bool;
    /// Whether all values are finite.
    fn is_finite(self) -> bool;
}

/// How a kernel reads and writes one part of what is stored.
pub trait Window: Copy {
    /// What is stored.
    type Stored;
    /// What it is computed in.
    type Number: Number;

    /// A constant.
    fn constant(self, value: f64) -> Self::Number;
    /// Reads this part of `x[place]`, or what follows it.
    fn load(self, x: &[Self::Stored], place: usize) -> Self::Number;
    /// Writes this part of `x[place]`, or what follows it.
    fn store(self, x: &mut [Self::Stored], place: usize, value: Self::Number);
    /// The first trajectory in this part.
    fn first(self) -> usize;
}

/// What is done to each part of what is stored.
pub trait Visit<S> {
    /// Does it for one part; false to stop.
    fn visit<W: Window<Stored = S>>(&mut self, window: W) -> bool;
}

/// How what is stored falls into parts.
pub trait Windows: Copy {
    /// What is stored.
    type Stored;

    /// Visits all parts of each of `count` numbers stored one after another; false where it was stopped.
    fn each<V: Visit<Self::Stored>>(self, count: usize, visitor: &mut V) -> bool;

    /// The same in smaller parts, for what needs many registers.
    fn each_small<V: Visit<Self::Stored>>(self, count: usize, visitor: &mut V) -> bool;
}

/// A computation on what is stored.
pub trait Kernel<S> {
    /// Its result.
    type Output;

    /// Makes it with these windows.
    fn run<W: Windows<Stored = S>>(self, windows: W) -> Self::Output;
}

/// What kernels can work on.
pub trait Stored: Scalar {
    /// Makes a computation on it.
    fn run<K: Kernel<Self>>(machine: Machine, kernel: K) -> K::Output;
}

/// The instruction set a kernel is run with.
#[derive(Clone, Copy, Debug)]
pub struct Machine(Arch);

impl Default for Machine {
    /// The widest this machine has.
    fn default() -> Self {
        Self(Arch::new())
    }
}

impl Machine {
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

/// Several registers, computed with in lock-step to hide the latency of each.
#[derive(Clone, Copy)]
struct Block<S: Simd, const N: usize> {
    simd: S,
    registers: [S::f64s; N],
}

// Loops and no closures: what is not inlined is compiled without the instructions it is for.
macro_rules! operators {
    ($($operator:ident $name:ident $with:ident,)*) => {$(
        impl<S: Simd, const N: usize> $operator for Block<S, N> {
            type Output = Self;
            #[inline(always)]
            fn $name(mut self, other: Self) -> Self {
                for i in 0..N {
                    self.registers[i] = self.simd.$with(self.registers[i], other.registers[i]);
                }
                self
            }
        }
    )*};
}
operators! {
    Add add add_f64s,
    Sub sub sub_f64s,
    Mul mul mul_f64s,
    Div div div_f64s,
}

macro_rules! on_bits {
    ($($name:ident $with:ident,)*) => {$(
        #[inline(always)]
        fn $name(self, mut a: Self::Bits, b: Self::Bits) -> Self::Bits {
            for i in 0..N {
                a[i] = self.simd.$with(a[i], b[i]);
            }
            a
        }
    )*};
}

impl<S: Simd, const N: usize> Register for Block<S, N> {
    type Bits = [S::u64s; N];

    on_bits! {
        add_bits add_u64s,
        sub_bits sub_u64s,
        and_bits and_u64s,
        or_bits or_u64s,
        xor_bits xor_u64s,
    }

    #[inline(always)]
    fn like(mut self, value: f64) -> Self {
        self.registers = [self.simd.splat_f64s(value); N];
        self
    }
    #[inline(always)]
    fn bits_like(self, bits: u64) -> Self::Bits {
        [self.simd.splat_u64s(bits); N]
    }
    #[inline(always)]
    fn bits(self) -> Self::Bits {
        let mut bits = self.bits_like(0);
        for i in 0..N {
            bits[i] = pulp::cast(self.registers[i]);
        }
        bits
    }
    #[inline(always)]
    fn with_bits(mut self, bits: Self::Bits) -> Self {
        for i in 0..N {
            self.registers[i] = pulp::cast(bits[i]);
        }
        self
    }
    #[inline(always)]
    fn up<const BY: u32>(self, mut a: Self::Bits) -> Self::Bits {
        for bits in pulp::bytemuck::cast_slice_mut::<S::u64s, u64>(&mut a) {
            *bits <<= BY;
        }
        a
    }
    #[inline(always)]
    fn down<const BY: u32>(self, mut a: Self::Bits) -> Self::Bits {
        for bits in pulp::bytemuck::cast_slice_mut::<S::u64s, u64>(&mut a) {
            *bits >>= BY;
        }
        a
    }
    #[inline(always)]
    fn if_less(mut self, other: Self, yes: Self, no: Self) -> Self {
        let simd = self.simd;
        for i in 0..N {
            let is_less = simd.less_than_f64s(self.registers[i], other.registers[i]);
            self.registers[i] = simd.select_f64s(is_less, yes.registers[i], no.registers[i]);
        }
        self
    }
    #[inline(always)]
    fn replace_beyond(self, most: f64, values: Self, f: fn(f64) -> f64) -> Self {
        if self.is_within(most) {
            values
        } else {
            replaced(self, most, values, f)
        }
    }
}

impl<S: Simd, const N: usize> Block<S, N> {
    /// Whether all magnitudes are at most this.
    #[inline(always)]
    fn is_within(self, most: f64) -> bool {
        let (simd, most) = (self.simd, self.simd.splat_f64s(most));
        let mut all = simd.less_than_or_equal_f64s(simd.abs_f64s(self.registers[0]), most);
        for i in 1..N {
            let magnitude = simd.abs_f64s(self.registers[i]);
            all = simd.and_m64s(all, simd.less_than_or_equal_f64s(magnitude, most));
        }
        simd.first_true_m64s(simd.not_m64s(all)) == S::F64_LANES
    }
}

#[cold]
#[inline(never)]
fn replaced<S: Simd, const N: usize>(
    x: Block<S, N>,
    most: f64,
    mut values: Block<S, N>,
    f: fn(f64) -> f64,
) -> Block<S, N> {
    let x = pulp::bytemuck::cast_slice::<S::f64s, f64>(&x.registers);
    let values_of = pulp::bytemuck::cast_slice_mut::<S::f64s, f64>(&mut values.registers);
    for (value, &x) in values_of.iter_mut().zip(x) {
        *value = x.replace_beyond(most, *value, f);
    }
    values
}

macro_rules! number {
    () => {
        #[inline(always)]
        fn like(self, value: f64) -> Self {
            Register::like(self, value)
        }
        #[inline(always)]
        fn scaled(self, factor: f64) -> Self {
            self * Register::like(self, factor)
        }
        #[inline(always)]
        fn exp(self) -> Self {
            elementary::exp(self)
        }
        #[inline(always)]
        fn exp_m1(self) -> Self {
            elementary::exp_m1(self)
        }
        #[inline(always)]
        fn ln_1p(self) -> Self {
            elementary::ln_1p(self)
        }
        #[inline(always)]
        fn cos(self) -> Self {
            elementary::cos(self)
        }
        #[inline(always)]
        fn inverse_root(self, q: u32) -> Self {
            match q {
                1 => Register::like(self, 1.0) / self,
                2 => elementary::inverse_sqrt(self),
                _ => elementary::inverse_cbrt(self),
            }
        }
    };
}

impl Number for f64 {
    number!();
    #[inline(always)]
    fn is_below(self, bound: f64) -> bool {
        (-f64::MAX..bound).contains(&self)
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
}

impl<S: Simd, const N: usize> Number for Block<S, N> {
    number!();
    #[inline(always)]
    fn is_below(self, bound: f64) -> bool {
        let simd = self.simd;
        let (least, bound) = (simd.splat_f64s(-f64::MAX), simd.splat_f64s(bound));
        let mut all = simd.less_than_f64s(self.registers[0], bound);
        for i in 0..N {
            all = simd.and_m64s(all, simd.less_than_f64s(self.registers[i], bound));
            let is_finite = simd.greater_than_or_equal_f64s(self.registers[i], least);
            all = simd.and_m64s(all, is_finite);
        }
        simd.first_true_m64s(simd.not_m64s(all)) == S::F64_LANES
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        self.is_within(f64::MAX)
    }
}

/// N registers of consecutive numbers, from some distance on.
#[derive(Clone, Copy)]
struct Consecutive<S, const N: usize> {
    simd: S,
    offset: usize,
}

impl<S: Simd, const N: usize> Window for Consecutive<S, N> {
    type Stored = f64;
    type Number = Block<S, N>;

    #[inline(always)]
    fn constant(self, value: f64) -> Block<S, N> {
        let simd = self.simd;
        let registers = [simd.splat_f64s(value); N];
        Block { simd, registers }
    }
    #[inline(always)]
    fn load(self, x: &[f64], place: usize) -> Block<S, N> {
        let from = place + self.offset;
        let x = &x[from..from + N * S::F64_LANES];
        let simd = self.simd;
        let registers = S::as_simd_f64s(x).0.as_chunks::<N>().0[0];
        Block { simd, registers }
    }
    #[inline(always)]
    fn store(self, x: &mut [f64], place: usize, value: Block<S, N>) {
        let from = place + self.offset;
        let x = &mut x[from..from + N * S::F64_LANES];
        S::as_mut_simd_f64s(x).0.as_chunks_mut::<N>().0[0] = value.registers;
    }
    #[inline(always)]
    fn first(self) -> usize {
        0
    }
}

/// A number alone, at some distance.
#[derive(Clone, Copy)]
struct Alone {
    offset: usize,
}

impl Window for Alone {
    type Stored = f64;
    type Number = f64;

    #[inline(always)]
    fn constant(self, value: f64) -> f64 {
        value
    }
    #[inline(always)]
    fn load(self, x: &[f64], place: usize) -> f64 {
        x[place + self.offset]
    }
    #[inline(always)]
    fn store(self, x: &mut [f64], place: usize, value: f64) {
        x[place + self.offset] = value;
    }
    #[inline(always)]
    fn first(self) -> usize {
        0
    }
}

/// Numbers of one trajectory: runs of them in blocks of N registers, the rest in single ones.
#[derive(Clone, Copy)]
struct InRuns<S> {
    simd: S,
}

impl<S: Simd> InRuns<S> {
    #[inline(always)]
    fn blocks<const N: usize, V: Visit<f64>>(self, count: usize, visitor: &mut V) -> bool {
        let simd = self.simd;
        let mut offset = 0;
        while count - offset >= N * S::F64_LANES {
            if !visitor.visit(Consecutive::<S, N> { simd, offset }) {
                return false;
            }
            offset += N * S::F64_LANES;
        }
        while S::F64_LANES > 1 && count - offset >= S::F64_LANES {
            if !visitor.visit(Consecutive::<S, 1> { simd, offset }) {
                return false;
            }
            offset += S::F64_LANES;
        }
        while offset < count {
            if !visitor.visit(Alone { offset }) {
                return false;
            }
            offset += 1;
        }
        true
    }
}

impl<S: Simd> Windows for InRuns<S> {
    type Stored = f64;

    #[inline(always)]
    fn each<V: Visit<f64>>(self, count: usize, visitor: &mut V) -> bool {
        self.blocks::<8, V>(count, visitor)
    }
    #[inline(always)]
    fn each_small<V: Visit<f64>>(self, count: usize, visitor: &mut V) -> bool {
        self.blocks::<4, V>(count, visitor)
    }
}

struct OfNumbers<K>(K);

impl<K: Kernel<f64>> WithSimd for OfNumbers<K> {
    type Output = K::Output;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        self.0.run(InRuns { simd })
    }
}

impl Stored for f64 {
    fn run<K: Kernel<f64>>(machine: Machine, kernel: K) -> K::Output {
        machine.0.dispatch(OfNumbers(kernel))
    }
}

/// N registers of the trajectories in lock-step.
#[derive(Clone, Copy)]
struct Part<S, const W: usize, const N: usize> {
    simd: S,
    part: usize,
    offset: usize,
}

impl<S: Simd, const W: usize, const N: usize> Window for Part<S, W, N> {
    type Stored = Lanes<W>;
    type Number = Block<S, N>;

    #[inline(always)]
    fn constant(self, value: f64) -> Block<S, N> {
        let simd = self.simd;
        let registers = [simd.splat_f64s(value); N];
        Block { simd, registers }
    }
    #[inline(always)]
    fn load(self, x: &[Lanes<W>], place: usize) -> Block<S, N> {
        let simd = self.simd;
        let parts = S::as_simd_f64s(&x[place + self.offset].0).0;
        let registers = parts.as_chunks::<N>().0[self.part];
        Block { simd, registers }
    }
    #[inline(always)]
    fn store(self, x: &mut [Lanes<W>], place: usize, value: Block<S, N>) {
        let parts = S::as_mut_simd_f64s(&mut x[place + self.offset].0).0;
        parts.as_chunks_mut::<N>().0[self.part] = value.registers;
    }
    #[inline(always)]
    fn first(self) -> usize {
        self.part * N * S::F64_LANES
    }
}

/// Trajectories in lock-step: in parts of at most 8 registers.
#[derive(Clone, Copy)]
struct InParts<S, const W: usize> {
    simd: S,
}

impl<S: Simd, const W: usize> InParts<S, W> {
    #[inline(always)]
    fn parts<const N: usize, V: Visit<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        let simd = self.simd;
        for offset in 0..count {
            for part in 0..W / (N * S::F64_LANES) {
                if !visitor.visit(Part::<S, W, N> { simd, part, offset }) {
                    return false;
                }
            }
        }
        true
    }
}

impl<S: Simd, const W: usize> Windows for InParts<S, W> {
    type Stored = Lanes<W>;

    #[inline(always)]
    fn each<V: Visit<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        match W / S::F64_LANES {
            1 => self.parts::<1, V>(count, visitor),
            2 => self.parts::<2, V>(count, visitor),
            4 => self.parts::<4, V>(count, visitor),
            _ => self.parts::<8, V>(count, visitor),
        }
    }
    #[inline(always)]
    fn each_small<V: Visit<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        match W / S::F64_LANES {
            1 => self.parts::<1, V>(count, visitor),
            2 => self.parts::<2, V>(count, visitor),
            _ => self.parts::<4, V>(count, visitor),
        }
    }
}

struct OfLanes<K>(K);

impl<const W: usize, K: Kernel<Lanes<W>>> WithSimd for OfLanes<(K, [(); W])> {
    type Output = K::Output;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        self.0.0.run(InParts::<S, W> { simd })
    }
}

impl<const W: usize> Stored for Lanes<W> {
    fn run<K: Kernel<Lanes<W>>>(machine: Machine, kernel: K) -> K::Output {
        const { assert!(W.is_power_of_two() && W >= 8, "lanes fill whole registers") };
        machine.0.dispatch(OfLanes((kernel, [(); W])))
    }
}
