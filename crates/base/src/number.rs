//! The trait of numbers that kernels compute with.
#![allow(clippy::inline_always)] // an operation must vanish into the loop around it

use std::ops::{Add, Div, Mul, Sub};

/// Arithmetic and elementary functions: of `f64`, lanes and registers.
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
    /// sin x and cos x
    #[must_use]
    fn sin_and_cos(self) -> (Self, Self);
    /// x^(-1/q) for x > 0 and q = 1, 2, 3.
    #[must_use]
    fn inverse_root(self, q: u32) -> Self;
    /// `yes` where this is less than `other`, `no` elsewhere.
    #[must_use]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
    /// Whether all values are below a bound; what is not a number is not.
    fn is_below(self, bound: f64) -> bool;
    /// Whether all values are finite.
    fn is_finite(self) -> bool;
}

/// The functions of a [`Number`] that follow from a [`Register`].
macro_rules! number {
    () => {
        #[inline(always)]
        fn like(self, value: f64) -> Self {
            $crate::elementary::Register::like(self, value)
        }
        #[inline(always)]
        fn scaled(self, factor: f64) -> Self {
            self * $crate::elementary::Register::like(self, factor)
        }
        #[inline(always)]
        fn exp(self) -> Self {
            $crate::elementary::exp(self)
        }
        #[inline(always)]
        fn exp_m1(self) -> Self {
            $crate::elementary::exp_m1(self)
        }
        #[inline(always)]
        fn ln_1p(self) -> Self {
            $crate::elementary::ln_1p(self)
        }
        #[inline(always)]
        fn cos(self) -> Self {
            $crate::elementary::cos(self)
        }
        #[inline(always)]
        fn sin(self) -> Self {
            $crate::elementary::sin(self)
        }
        #[inline(always)]
        fn sin_and_cos(self) -> (Self, Self) {
            $crate::elementary::sin_and_cos(self)
        }
        #[inline(always)]
        fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
            $crate::elementary::Register::if_less(self, other, yes, no)
        }
        #[inline(always)]
        fn inverse_root(self, q: u32) -> Self {
            match q {
                1 => $crate::elementary::Register::like(self, 1.0) / self,
                2 => $crate::elementary::inverse_sqrt(self),
                _ => $crate::elementary::inverse_cbrt(self),
            }
        }
    };
}
pub(crate) use number;

impl Number for f64 {
    number!();
    #[inline(always)]
    fn is_below(self, bound: f64) -> bool {
        self < bound
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        Self::is_finite(self)
    }
}
