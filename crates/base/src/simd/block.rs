//! Registers of the vector unit.
#![allow(clippy::inline_always)] // a call would lack the instruction set

use crate::elementary::{self, Register};
use crate::number::{Number, number};
use pulp::Simd;
use std::ops::{Add, Div, Mul, Sub};

/// Several registers in lock-step, which hides the latency of each.
#[derive(Clone, Copy)]
pub(super) struct RegisterBlock<S: Simd, const N: usize> {
    pub(super) simd: S,
    pub(super) registers: [S::f64s; N],
}

/// The same for each register of a block. Loops are unrolled all the same, by passes that made up two thirds of the
/// compiler's time for the flows of fields; a closure that is not inlined lacks the instruction set.
macro_rules! for_registers {
    ($i:ident in 0..$n:ident $body:block) => {
        for_registers!(@ $i $n $body 0 1 2 3 4 5 6 7)
    };
    (@ $i:ident $n:ident $body:block $($register:literal)*) => {$(
        if $register < $n {
            let $i: usize = $register;
            $body
        }
    )*};
}

macro_rules! operators {
    ($($operator:ident $name:ident $with:ident,)*) => {$(
        impl<S: Simd, const N: usize> $operator for RegisterBlock<S, N> {
            type Output = Self;
            #[inline(always)]
            fn $name(mut self, other: Self) -> Self {
                for_registers!(i in 0..N {
                    self.registers[i] = self.simd.$with(self.registers[i], other.registers[i]);
                });
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
            for_registers!(i in 0..N {
                a[i] = self.simd.$with(a[i], b[i]);
            });
            a
        }
    )*};
}

impl<S: Simd, const N: usize> Register for RegisterBlock<S, N> {
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
        for_registers!(i in 0..N {
            bits[i] = pulp::cast(self.registers[i]);
        });
        bits
    }
    #[inline(always)]
    fn with_bits(mut self, bits: Self::Bits) -> Self {
        for_registers!(i in 0..N {
            self.registers[i] = pulp::cast(bits[i]);
        });
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
        for_registers!(i in 0..N {
            let is_less = simd.less_than_f64s(self.registers[i], other.registers[i]);
            self.registers[i] = simd.select_f64s(is_less, yes.registers[i], no.registers[i]);
        });
        self
    }
    #[inline(always)]
    fn replace_beyond(self, most: f64, mut values: Self, f: fn(f64) -> f64) -> Self {
        if !self.is_within(most) {
            // copies, for what a call sees in memory is not kept in registers
            let (x, mut replaced) = (self.registers, values.registers);
            let x = pulp::bytemuck::cast_slice::<S::f64s, f64>(&x);
            let of = pulp::bytemuck::cast_slice_mut::<S::f64s, f64>(&mut replaced);
            elementary::replace_each_beyond(x, most, of, f);
            values.registers = replaced;
        }
        values
    }
}

impl<S: Simd, const N: usize> RegisterBlock<S, N> {
    /// The first of these registers.
    #[inline(always)]
    pub(super) fn of(simd: S, from: &[S::f64s]) -> Self {
        let mut registers = [simd.splat_f64s(0.0); N];
        registers.copy_from_slice(&from[..N]);
        Self { simd, registers }
    }

    /// Whether all magnitudes are at most this.
    #[inline(always)]
    fn is_within(self, most: f64) -> bool {
        let (simd, most) = (self.simd, self.simd.splat_f64s(most));
        let mut all = simd.less_than_or_equal_f64s(simd.abs_f64s(self.registers[0]), most);
        for_registers!(i in 0..N {
            let magnitude = simd.abs_f64s(self.registers[i]);
            all = simd.and_m64s(all, simd.less_than_or_equal_f64s(magnitude, most));
        });
        simd.first_true_m64s(simd.not_m64s(all)) == S::F64_LANES
    }
}

impl<S: Simd, const N: usize> Number for RegisterBlock<S, N> {
    number!();
    #[inline(always)]
    fn is_below(self, bound: f64) -> bool {
        let simd = self.simd;
        let bound = simd.splat_f64s(bound);
        let mut all = simd.less_than_f64s(self.registers[0], bound);
        for_registers!(i in 0..N {
            all = simd.and_m64s(all, simd.less_than_f64s(self.registers[i], bound));
        });
        simd.first_true_m64s(simd.not_m64s(all)) == S::F64_LANES
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        self.is_within(f64::MAX)
    }
}
