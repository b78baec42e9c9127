//! Numbers: `f64`, and several of them in lock-step.
//!
//! An operation on [`Lanes`] is the same operation on each `f64`, so a lane's result has the same bits as the scalar
//! one. The compiler turns these loops over arrays into the vector instructions of the target.
#![allow(clippy::inline_always)] // an operation on lanes must vanish into the loop around it
#![allow(clippy::needless_range_loop)] // and be one that is sure to be unrolled

use crate::checkpoint::{Checkpoint, CheckpointMismatch, Numbers};
use crate::elementary::{self, Register};
pub use crate::number::Number;
use crate::number::number;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Compiles generic functions that are never inlined here, for each of these numbers: the crates above take them from here
/// instead of compiling them anew.
#[macro_export]
macro_rules! compiled {
    ($R:ident in [$($number:ty),*] $functions:tt) => {
        const _: () = {
            static _COMPILED: fn() = || { $($crate::compiled!(@ $R $number, $functions);)* };
        };
    };
    (@ $R:ident $number:ty, { $($function:expr),* $(,)? }) => {{
        type $R = $number;
        $(std::hint::black_box($function);)*
    }};
}

/// An element of a state: a number, or the same number of several trajectories.
pub trait Scalar: Checkpoint + Copy + Send + Sync + 'static {
    /// How many trajectories advance in lock-step.
    const MEMBERS: usize;
    /// Whether it is one: a branch on this constant is not compiled where it is not taken.
    const IS_SINGLE: bool = Self::MEMBERS == 1;

    /// The same value for every member.
    fn splat(value: f64) -> Self;
    /// The value of one member.
    fn member(&self, member: usize) -> f64;
    /// Sets the value of one member.
    fn set_member(&mut self, member: usize, value: f64);
    /// The values themselves, where there is one member only.
    fn alone(_x: &[Self]) -> Option<&[f64]> {
        None
    }
    /// The same, to write.
    fn alone_mut(_x: &mut [Self]) -> Option<&mut [f64]> {
        None
    }
}

impl<const W: usize> Number for Lanes<W> {
    number!();
    #[inline(always)]
    fn is_below(self, bound: f64) -> bool {
        self.all(
            #[inline(always)]
            |x| x < bound,
        )
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        self.all(f64::is_finite)
    }
}

/// A real number of a state, or several in lock-step.
pub trait Real:
    Scalar + Number + Mul<f64, Output = Self> + Neg<Output = Self> + AddAssign + SubAssign + MulAssign
{
    /// Applies a scalar function lane by lane.
    #[must_use]
    fn map(self, f: impl Fn(f64) -> f64) -> Self;
    /// Applies a scalar function of two arguments lane by lane.
    #[must_use]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self;
    /// Applies a scalar function of several arguments lane by lane.
    #[must_use]
    fn each<const K: usize>(of: [Self; K], f: impl Fn([f64; K]) -> f64) -> Self;
    /// Whether it holds for every member.
    fn all(self, f: impl Fn(f64) -> bool) -> bool;

    /// `yes` where this is not zero, `no` where it is.
    #[inline(always)]
    #[must_use]
    fn choose(self, yes: Self, no: Self) -> Self {
        Self::each(
            [self, yes, no],
            #[inline(always)]
            |[chosen, yes, no]| if chosen == 0.0 { no } else { yes },
        )
    }
}

impl Scalar for f64 {
    const MEMBERS: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn member(&self, _: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set_member(&mut self, _: usize, value: f64) {
        *self = value;
    }
    #[inline(always)]
    fn alone(x: &[f64]) -> Option<&[f64]> {
        Some(x)
    }
    #[inline(always)]
    fn alone_mut(x: &mut [f64]) -> Option<&mut [f64]> {
        Some(x)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        f(self)
    }
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        f(self, other)
    }
    #[inline(always)]
    fn each<const K: usize>(of: [Self; K], f: impl Fn([f64; K]) -> f64) -> Self {
        f(of)
    }
    #[inline(always)]
    fn all(self, f: impl Fn(f64) -> bool) -> bool {
        f(self)
    }
}

/// How many `f64` advance together in [`Lanes`], unless said otherwise.
pub const WIDTH: usize = 8;
/// How many members a block has: two of the widest registers, so that one does not wait for the other.
pub const BATCH: usize = 16;

/// Several `f64` in lock-step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Lanes<const W: usize = WIDTH>(pub [f64; W]);

impl<const W: usize> Checkpoint for Lanes<W> {
    fn save(&self, member: usize, out: &mut dyn Numbers) {
        self.0[member].save(0, out);
    }

    fn restore(&mut self, member: usize, saved: &mut &[f64]) -> Result<(), CheckpointMismatch> {
        self.0[member].restore(0, saved)
    }
}

impl<const W: usize> Scalar for Lanes<W> {
    const MEMBERS: usize = W;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; W])
    }
    #[inline(always)]
    fn member(&self, member: usize) -> f64 {
        self.0[member]
    }
    #[inline(always)]
    fn set_member(&mut self, member: usize, value: f64) {
        self.0[member] = value;
    }
}

impl<const W: usize> Real for Lanes<W> {
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        let mut out = self;
        for i in 0..W {
            out.0[i] = f(self.0[i]);
        }
        out
    }
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut out = self;
        for i in 0..W {
            out.0[i] = f(self.0[i], other.0[i]);
        }
        out
    }
    #[inline(always)]
    fn each<const K: usize>(of: [Self; K], f: impl Fn([f64; K]) -> f64) -> Self {
        let mut out = Self([0.0; W]);
        for i in 0..W {
            let mut x = [0.0; K];
            for k in 0..K {
                x[k] = of[k].0[i];
            }
            out.0[i] = f(x);
        }
        out
    }
    #[inline(always)]
    fn all(self, f: impl Fn(f64) -> bool) -> bool {
        // without a way out, so that several are looked at in one instruction
        let mut all = true;
        for i in 0..W {
            all &= f(self.0[i]);
        }
        all
    }
}

// Loops, not closures: a closure that is not inlined lacks the instruction set.
macro_rules! lanewise {
    ($($operator:ident $name:ident $assigned:tt,)*) => {$(
        impl<const W: usize> $operator for Lanes<W> {
            type Output = Self;
            #[inline(always)]
            fn $name(mut self, other: Self) -> Self {
                for i in 0..W {
                    self.0[i] $assigned other.0[i];
                }
                self
            }
        }
    )*};
}

lanewise! { Add add +=, Sub sub -=, Mul mul *=, Div div /=, }

impl<const W: usize> Mul<f64> for Lanes<W> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, factor: f64) -> Self {
        for i in 0..W {
            self.0[i] *= factor;
        }
        self
    }
}

impl<const W: usize> AddAssign for Lanes<W> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const W: usize> SubAssign for Lanes<W> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<const W: usize> MulAssign for Lanes<W> {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl<const W: usize> Neg for Lanes<W> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(
            #[inline(always)]
            |a| -a,
        )
    }
}

macro_rules! on_bits {
    ($($name:ident |$a:ident, $b:ident| $value:expr;)*) => {$(
        #[inline(always)]
        fn $name(self, mut a: Self::Bits, b: Self::Bits) -> Self::Bits {
            for i in 0..W {
                let ($a, $b) = (a[i], b[i]);
                a[i] = $value;
            }
            a
        }
    )*};
}

impl<const W: usize> Register for Lanes<W> {
    type Bits = [u64; W];

    on_bits! {
        add_bits |a, b| a.wrapping_add(b);
        sub_bits |a, b| a.wrapping_sub(b);
        and_bits |a, b| a & b;
        or_bits |a, b| a | b;
        xor_bits |a, b| a ^ b;
    }

    #[inline(always)]
    fn like(self, value: f64) -> Self {
        Self([value; W])
    }
    #[inline(always)]
    fn bits_like(self, bits: u64) -> Self::Bits {
        [bits; W]
    }
    #[inline(always)]
    fn bits(self) -> Self::Bits {
        let mut bits = [0; W];
        for i in 0..W {
            bits[i] = self.0[i].to_bits();
        }
        bits
    }
    #[inline(always)]
    fn with_bits(mut self, bits: Self::Bits) -> Self {
        for i in 0..W {
            self.0[i] = f64::from_bits(bits[i]);
        }
        self
    }
    #[inline(always)]
    fn up<const BY: u32>(self, mut a: Self::Bits) -> Self::Bits {
        for i in 0..W {
            a[i] <<= BY;
        }
        a
    }
    #[inline(always)]
    fn down<const BY: u32>(self, mut a: Self::Bits) -> Self::Bits {
        for i in 0..W {
            a[i] >>= BY;
        }
        a
    }
    #[inline(always)]
    fn if_less(mut self, other: Self, yes: Self, no: Self) -> Self {
        for i in 0..W {
            self.0[i] = if self.0[i] < other.0[i] {
                yes.0[i]
            } else {
                no.0[i]
            };
        }
        self
    }
    #[inline(always)]
    fn replace_beyond(self, most: f64, mut values: Self, f: fn(f64) -> f64) -> Self {
        if !self.all(|x| x.abs() <= most) {
            // copies, for what a call sees in memory is not kept in registers
            let (x, mut replaced) = (self.0, values.0);
            elementary::replace_each_beyond(&x, most, &mut replaced, f);
            values.0 = replaced;
        }
        values
    }
}
