//! Dual numbers: a value and its derivatives along eight directions at once.
//!
//!     f(a + ε u) = f(a) + ε f'(a) u,   ε² = 0
#![allow(clippy::inline_always)] // an operation must vanish into the loop around it

use crate::elementary;
use crate::real::{Number, Scalar};
use crate::simd::{InstructionSet, Kernel, ScalarViews, Stored};
use std::ops::{Add, Div, Mul, Sub};

/// How many directions a dual number has.
pub const DIRECTIONS: usize = 8;

/// A value and its derivatives along each direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// The value.
    pub value: f64,
    /// Its derivatives.
    pub tangents: [f64; DIRECTIONS],
}

impl Dual {
    /// A value whose derivatives are zero.
    pub const fn constant(value: f64) -> Self {
        Self {
            value,
            tangents: [0.0; DIRECTIONS],
        }
    }

    /// f(self), given f and f' there.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Self {
            value,
            tangents: self.tangents.map(|tangent| slope * tangent),
        }
    }

    /// A function of two numbers, given its value and partial derivatives.
    #[inline(always)]
    fn joined(self, other: Self, value: f64, slopes: [f64; 2]) -> Self {
        let tangent = |k: usize| slopes[0] * self.tangents[k] + slopes[1] * other.tangents[k];
        Self {
            value,
            tangents: std::array::from_fn(tangent),
        }
    }
}

impl Add for Dual {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.joined(other, self.value + other.value, [1.0, 1.0])
    }
}

impl Sub for Dual {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.joined(other, self.value - other.value, [1.0, -1.0])
    }
}

impl Mul for Dual {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.joined(other, self.value * other.value, [other.value, self.value])
    }
}

impl Div for Dual {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.joined(other, value, [1.0 / other.value, -value / other.value])
    }
}

crate::checkpoint!(Dual { value });

impl Scalar for Dual {
    const MEMBERS: usize = 1;

    fn splat(value: f64) -> Self {
        Self::constant(value)
    }
    fn member(&self, _: usize) -> f64 {
        self.value
    }
    fn set_member(&mut self, _: usize, value: f64) {
        self.value = value;
    }
    const HAS_DERIVATIVES: bool = true;
    fn set_function(&mut self, _: usize, value: f64, slopes: impl Iterator<Item = (Self, f64)>) {
        *self = slopes.fold(Self::constant(value), |mut sum, (x, slope)| {
            for (sum, tangent) in sum.tangents.iter_mut().zip(x.tangents) {
                *sum += slope * tangent;
            }
            sum
        });
    }
}

impl Number for Dual {
    fn like(self, value: f64) -> Self {
        Self::constant(value)
    }
    fn scaled(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }
    fn exp(self) -> Self {
        let value = elementary::exp(self.value);
        self.chain(value, value)
    }
    fn exp_m1(self) -> Self {
        self.chain(elementary::exp_m1(self.value), elementary::exp(self.value))
    }
    fn ln_1p(self) -> Self {
        self.chain(elementary::ln_1p(self.value), 1.0 / (1.0 + self.value))
    }
    fn cos(self) -> Self {
        self.chain(elementary::cos(self.value), -elementary::sin(self.value))
    }
    fn sin(self) -> Self {
        self.chain(elementary::sin(self.value), elementary::cos(self.value))
    }
    fn sin_and_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }
    fn inverse_root(self, q: u32) -> Self {
        let value = self.value.inverse_root(q);
        self.chain(value, -value / (f64::from(q) * self.value))
    }
    fn is_below(self, bound: f64) -> bool {
        self.value.is_below(bound)
    }
    /// Derivatives are not looked at.
    fn is_finite(self) -> bool {
        self.value.is_finite()
    }
}

impl Stored for Dual {
    fn run<K: Kernel<Self>>(_: InstructionSet, kernel: K) -> K::Output {
        kernel.run(ScalarViews::default())
    }
}
