//! The views of stored numbers in registers.
#![allow(clippy::inline_always)] // a call would lack the instruction set

use super::block::RegisterBlock;
use super::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use crate::real::{Lanes, Scalar, WIDTH};
use pulp::{Simd, WithSimd};
use std::marker::PhantomData;

/// Registers of a part for long formulas.
const NARROW: usize = 2;

/// N registers of consecutive numbers, from an offset on.
#[derive(Clone, Copy)]
struct BlockView<S, const N: usize> {
    simd: S,
    offset: usize,
}

impl<S: Simd, const N: usize> SimdView for BlockView<S, N> {
    type Stored = f64;
    type Number = RegisterBlock<S, N>;

    #[inline(always)]
    fn constant(self, value: f64) -> RegisterBlock<S, N> {
        let simd = self.simd;
        let registers = [simd.splat_f64s(value); N];
        RegisterBlock { simd, registers }
    }
    #[inline(always)]
    fn load(self, x: &[f64], place: usize) -> RegisterBlock<S, N> {
        let from = place + self.offset;
        let x = &x[from..from + N * S::F64_LANES];
        RegisterBlock::of(self.simd, S::as_simd_f64s(x).0)
    }
    #[inline(always)]
    fn shared(self, values: &[f64], place: usize) -> RegisterBlock<S, N> {
        self.load(values, place)
    }
    #[inline(always)]
    fn every(self, x: &[f64], place: usize) -> RegisterBlock<S, N> {
        self.constant(x[place])
    }
    #[inline(always)]
    fn store(self, x: &mut [f64], place: usize, value: RegisterBlock<S, N>) {
        let from = place + self.offset;
        let x = &mut x[from..from + N * S::F64_LANES];
        S::as_mut_simd_f64s(x).0.copy_from_slice(&value.registers);
    }
    #[inline(always)]
    fn first(self) -> usize {
        0
    }
}

/// One number, at an offset.
#[derive(Clone, Copy)]
struct ScalarView<S> {
    offset: usize,
    stored: PhantomData<S>,
}

impl<S: Scalar + Number> SimdView for ScalarView<S> {
    type Stored = S;
    type Number = S;

    #[inline(always)]
    fn constant(self, value: f64) -> S {
        S::splat(value)
    }
    #[inline(always)]
    fn load(self, x: &[S], place: usize) -> S {
        x[place + self.offset]
    }
    #[inline(always)]
    fn shared(self, values: &[f64], place: usize) -> S {
        S::splat(values[place + self.offset])
    }
    #[inline(always)]
    fn every(self, x: &[S], place: usize) -> S {
        x[place]
    }
    #[inline(always)]
    fn store(self, x: &mut [S], place: usize, value: S) {
        x[place + self.offset] = value;
    }
    #[inline(always)]
    fn first(self) -> usize {
        0
    }
}

/// Calls a computation by the function that pulp makes for an instruction set, and by one of ours where it makes none.
#[inline(always)]
fn call<S: Simd, C: WithSimd>(simd: S, computation: C) -> C::Output {
    fn scalar<S: Simd, C: WithSimd>(simd: S, computation: C) -> C::Output {
        simd.vectorize(computation)
    }
    if S::F64_LANES > 1 {
        simd.vectorize(computation)
    } else {
        scalar(simd, computation)
    }
}

/// Numbers of one trajectory: blocks of N registers, then single registers, then single numbers.
#[derive(Clone, Copy)]
struct BlockViews<S> {
    simd: S,
}

impl<S: Simd> BlockViews<S> {
    /// Whether a register has more than one number.
    const IS_VECTOR: bool = S::F64_LANES > 1;

    #[inline(always)]
    fn blocks<const N: usize, V: ForEach<f64>>(self, count: usize, visitor: &mut V) -> bool {
        let simd = self.simd;
        let mut offset = 0;
        while count - offset >= N * S::F64_LANES {
            if !visitor.visit(BlockView::<S, N> { simd, offset }) {
                return false;
            }
            offset += N * S::F64_LANES;
        }
        if Self::IS_VECTOR {
            while count - offset >= S::F64_LANES {
                if !visitor.visit(BlockView::<S, 1> { simd, offset }) {
                    return false;
                }
                offset += S::F64_LANES;
            }
        }
        while offset < count {
            if !visitor.visit(ScalarView {
                offset,
                stored: PhantomData,
            }) {
                return false;
            }
            offset += 1;
        }
        true
    }
}

impl<S: Simd> SimdViews for BlockViews<S> {
    type Stored = f64;

    #[inline(always)]
    fn each<V: ForEach<f64>>(self, count: usize, visitor: &mut V) -> bool {
        self.blocks::<8, V>(count, visitor)
    }
    #[inline(always)]
    fn each_narrow<V: ForEach<f64>>(self, count: usize, visitor: &mut V) -> bool {
        self.blocks::<NARROW, V>(count, visitor)
    }
    #[inline(always)]
    fn one<V: ForEach<f64>>(self, visitor: &mut V) -> bool {
        visitor.visit(ScalarView {
            offset: 0,
            stored: PhantomData,
        })
    }
    #[inline(always)]
    fn one_quarter<V: ForEach<f64>>(self, visitor: &mut V) -> bool {
        self.one(visitor)
    }
    #[inline(always)]
    fn one_narrow<V: ForEach<f64>>(self, visitor: &mut V) -> bool {
        self.one(visitor)
    }
    #[inline(always)]
    fn call<K: Kernel<f64>>(self, kernel: K) -> K::Output {
        call(self.simd, OnBlocks(kernel))
    }
}

struct OnBlocks<K>(K);

impl<K: Kernel<f64>> WithSimd for OnBlocks<K> {
    type Output = K::Output;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        self.0.run(BlockViews { simd })
    }
}

impl Stored for f64 {
    type Group = Self;

    #[inline(always)]
    fn group(&self, _: usize) -> Self {
        *self
    }
    #[inline(always)]
    fn set_group(&mut self, _: usize, value: Self) {
        *self = value;
    }
    fn run<K: Kernel<f64>>(machine: InstructionSet, kernel: K) -> K::Output {
        machine.0.dispatch(OnBlocks(kernel))
    }
}

/// N registers of the trajectories in lock-step.
#[derive(Clone, Copy)]
struct LaneView<S, const W: usize, const N: usize> {
    simd: S,
    part: usize,
    offset: usize,
}

impl<S: Simd, const W: usize, const N: usize> SimdView for LaneView<S, W, N> {
    type Stored = Lanes<W>;
    type Number = RegisterBlock<S, N>;

    #[inline(always)]
    fn constant(self, value: f64) -> RegisterBlock<S, N> {
        let simd = self.simd;
        let registers = [simd.splat_f64s(value); N];
        RegisterBlock { simd, registers }
    }
    #[inline(always)]
    fn load(self, x: &[Lanes<W>], place: usize) -> RegisterBlock<S, N> {
        self.every(x, place + self.offset)
    }
    #[inline(always)]
    fn shared(self, values: &[f64], place: usize) -> RegisterBlock<S, N> {
        self.constant(values[place + self.offset])
    }
    #[inline(always)]
    fn every(self, x: &[Lanes<W>], place: usize) -> RegisterBlock<S, N> {
        let registers = S::as_simd_f64s(&x[place].0).0;
        RegisterBlock::of(self.simd, &registers[self.part * N..])
    }
    #[inline(always)]
    fn store(self, x: &mut [Lanes<W>], place: usize, value: RegisterBlock<S, N>) {
        let registers = S::as_mut_simd_f64s(&mut x[place + self.offset].0).0;
        registers[self.part * N..][..N].copy_from_slice(&value.registers);
    }
    #[inline(always)]
    fn first(self) -> usize {
        self.part * N * S::F64_LANES
    }
}

/// Trajectories in lock-step: in parts of at most 8 registers.
#[derive(Clone, Copy)]
struct LaneViews<S, const W: usize> {
    simd: S,
}

impl<S: Simd, const W: usize> LaneViews<S, W> {
    /// Registers of all trajectories. A match on this constant compiles the branch taken only.
    const REGISTERS: usize = W / S::F64_LANES;

    #[inline(always)]
    fn parts<const N: usize, V: ForEach<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        let simd = self.simd;
        for offset in 0..count {
            for part in 0..W / (N * S::F64_LANES) {
                if !visitor.visit(LaneView::<S, W, N> { simd, part, offset }) {
                    return false;
                }
            }
        }
        true
    }
}

impl<S: Simd, const W: usize> SimdViews for LaneViews<S, W> {
    type Stored = Lanes<W>;

    #[inline(always)]
    fn each<V: ForEach<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        match Self::REGISTERS {
            1 => self.parts::<1, V>(count, visitor),
            2 => self.parts::<2, V>(count, visitor),
            // machines without registers of several numbers: what is unrolled for them takes long to compile
            _ if S::F64_LANES == 1 => self.parts::<2, V>(count, visitor),
            4 => self.parts::<4, V>(count, visitor),
            _ => self.parts::<8, V>(count, visitor),
        }
    }
    #[inline(always)]
    fn each_narrow<V: ForEach<Lanes<W>>>(self, count: usize, visitor: &mut V) -> bool {
        match Self::REGISTERS {
            1 => self.parts::<1, V>(count, visitor),
            _ => self.parts::<NARROW, V>(count, visitor),
        }
    }
    #[inline(always)]
    fn one<V: ForEach<Lanes<W>>>(self, visitor: &mut V) -> bool {
        self.each(1, visitor)
    }
    #[inline(always)]
    fn one_quarter<V: ForEach<Lanes<W>>>(self, visitor: &mut V) -> bool {
        match Self::REGISTERS {
            // machines with registers of eight numbers have 32, others 16
            8.. if S::F64_LANES == 4 => self.parts::<4, V>(1, visitor),
            _ => self.each(1, visitor),
        }
    }
    #[inline(always)]
    fn one_narrow<V: ForEach<Lanes<W>>>(self, visitor: &mut V) -> bool {
        self.each_narrow(1, visitor)
    }
    #[inline(always)]
    fn call<K: Kernel<Lanes<W>>>(self, kernel: K) -> K::Output {
        call(self.simd, OnLanes((kernel, [(); W])))
    }
}

struct OnLanes<K>(K);

impl<const W: usize, K: Kernel<Lanes<W>>> WithSimd for OnLanes<(K, [(); W])> {
    type Output = K::Output;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        self.0.0.run(LaneViews::<S, W> { simd })
    }
}

impl<const W: usize> Stored for Lanes<W> {
    type Group = Lanes;

    #[inline(always)]
    fn group(&self, group: usize) -> Lanes {
        let mut values = Lanes::splat(0.0);
        values.0.copy_from_slice(&self.0[group * WIDTH..][..WIDTH]);
        values
    }
    #[inline(always)]
    fn set_group(&mut self, group: usize, values: Lanes) {
        self.0[group * WIDTH..][..WIDTH].copy_from_slice(&values.0);
    }
    fn run<K: Kernel<Lanes<W>>>(machine: InstructionSet, kernel: K) -> K::Output {
        const { assert!(W.is_power_of_two() && W >= 8, "lanes fill whole registers") };
        machine.0.dispatch(OnLanes((kernel, [(); W])))
    }
}
