//! Compensated numbers: a value, and to first order its rounding error.
//!
//!     a + b = fl(a + b) + e,   a b = fl(a b) + e   with e a number of the same precision
//!
//! The value has the bits of the plain computation; value and low part together are about as good as a computation in
//! twice the precision. The error of a product is found by a fused operation: e itself is exact, so that all machines
//! give the same bits. Source: higham2002, chapter 4; ogita2005.
#![allow(clippy::inline_always)] // an operation must vanish into the loop around it

use crate::real::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its low part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensated<R> {
    /// The value.
    pub high: R,
    /// Its rounding error.
    pub low: R,
}

/// a b + c, rounded once.
#[inline(always)]
fn fused<R: Real>(a: R, b: R, c: R) -> R {
    R::each(
        [a, b, c],
        #[inline(always)]
        |[a, b, c]| a.mul_add(b, c),
    )
}

impl<R: Real> Compensated<R> {
    /// A value that is exact.
    #[inline(always)]
    pub fn exact(high: R) -> Self {
        Self {
            high,
            low: R::splat(0.0),
        }
    }

    /// The sum of two numbers.
    #[inline(always)]
    pub fn sum(a: R, b: R) -> Self {
        let high = a + b;
        let part = high - a;
        Self {
            high,
            low: (a - (high - part)) + (b - part),
        }
    }

    /// The square root; its low part is not finite at zero.
    #[inline(always)]
    #[must_use]
    pub fn sqrt(self) -> Self {
        let high = self.high.map(f64::sqrt);
        let rest = fused(-high, high, self.high) + self.low;
        Self {
            high,
            low: rest / (high + high),
        }
    }
}

impl<R: Real> Add for Compensated<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let Self { high, low } = Self::sum(self.high, other.high);
        Self {
            high,
            low: low + (self.low + other.low),
        }
    }
}

impl<R: Real> Sub for Compensated<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<R: Real> Neg for Compensated<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            high: -self.high,
            low: -self.low,
        }
    }
}

impl<R: Real> Mul for Compensated<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let high = self.high * other.high;
        let error = fused(self.high, other.high, -high);
        Self {
            high,
            low: error + (self.high * other.low + self.low * other.high),
        }
    }
}

impl<R: Real> Div for Compensated<R> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let high = self.high / other.high;
        let rest = fused(-high, other.high, self.high) + (self.low - high * other.low);
        Self {
            high,
            low: rest / other.high,
        }
    }
}
