//! Elementary functions without branches, over registers of any width.
//!
//! They are within 2 ulp and use no fused operations: a single number, a lane, and any machine give
//! the same bits. Methods: reduction by Cody and Waite and the kernels of fdlibm, with polynomials of
//! our own for the exponentials. Results of [`exp`] below 1e-307 are 0; [`sin`] and [`cos`] are those
//! of the standard library beyond [`REDUCIBLE`].
#![allow(clippy::inline_always)] // a call would end the vector loop around it

use std::ops::{Add, Div, Mul, Sub};

/// A number, or several in lock-step, with access to the bits.
pub trait Register:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The bits of each number.
    type Bits: Copy;

    /// The same number everywhere.
    #[must_use]
    fn like(self, value: f64) -> Self;
    /// The same bits everywhere.
    fn bits_like(self, bits: u64) -> Self::Bits;
    /// The bits of this.
    fn bits(self) -> Self::Bits;
    /// The number with these bits.
    #[must_use]
    fn with_bits(self, bits: Self::Bits) -> Self;
    /// a + b, wrapping.
    fn add_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// a - b, wrapping.
    fn sub_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// a & b
    fn and_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// a | b
    fn or_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// a ^ b
    fn xor_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// a << BY
    fn up<const BY: u32>(self, a: Self::Bits) -> Self::Bits;
    /// a >> BY
    fn down<const BY: u32>(self, a: Self::Bits) -> Self::Bits;
    /// `yes` where this is less than `other`, `no` elsewhere, also where one is not a number.
    #[must_use]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
    /// Applies a function to those numbers beyond `most` in magnitude, which are rare.
    #[must_use]
    fn replace_beyond(self, most: f64, values: Self, f: fn(f64) -> f64) -> Self;
}

impl Register for f64 {
    type Bits = u64;

    #[inline(always)]
    fn like(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn bits_like(self, bits: u64) -> u64 {
        bits
    }
    #[inline(always)]
    fn bits(self) -> u64 {
        self.to_bits()
    }
    #[inline(always)]
    fn with_bits(self, bits: u64) -> Self {
        f64::from_bits(bits)
    }
    #[inline(always)]
    fn add_bits(self, a: u64, b: u64) -> u64 {
        a.wrapping_add(b)
    }
    #[inline(always)]
    fn sub_bits(self, a: u64, b: u64) -> u64 {
        a.wrapping_sub(b)
    }
    #[inline(always)]
    fn and_bits(self, a: u64, b: u64) -> u64 {
        a & b
    }
    #[inline(always)]
    fn or_bits(self, a: u64, b: u64) -> u64 {
        a | b
    }
    #[inline(always)]
    fn xor_bits(self, a: u64, b: u64) -> u64 {
        a ^ b
    }
    #[inline(always)]
    fn up<const BY: u32>(self, a: u64) -> u64 {
        a << BY
    }
    #[inline(always)]
    fn down<const BY: u32>(self, a: u64) -> u64 {
        a >> BY
    }
    #[inline(always)]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
        if self < other { yes } else { no }
    }
    #[inline(always)]
    fn replace_beyond(self, most: f64, value: Self, f: fn(f64) -> f64) -> Self {
        if self.abs() <= most {
            value
        } else {
            rare(self, f)
        }
    }
}

/// A call that stays behind its branch: the compiler takes the functions of the standard library for cheap enough to be
/// called always, and half of a sine was that.
#[cold]
#[inline(never)]
fn rare(x: f64, f: fn(f64) -> f64) -> f64 {
    f(x)
}

/// [`Register::replace_beyond`] of each number of a register.
#[cold]
#[inline(never)]
pub(crate) fn replace_each_beyond(x: &[f64], most: f64, values: &mut [f64], f: fn(f64) -> f64) {
    for (value, &x) in values.iter_mut().zip(x) {
        *value = x.replace_beyond(most, *value, f);
    }
}

/// 1.5 * 2^52: added to a number below 2^51 it leaves the nearest integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
const BIAS: u64 = 1023;
const MANTISSA_BITS: u32 = 52;
/// Beyond this e^x is infinite.
const LARGEST_LOG: f64 = 709.782_712_893_384;

/// ln 2 in two parts, the first of 33 bits.
const LN2: [f64; 2] = [0.693_147_180_485_539_1, 7.440_617_110_012_397e-11];

/// Evaluates a polynomial; pairs first, which shortens the chain of dependent operations.
macro_rules! polynomial {
    ($x:expr, $x2:expr; $a:expr) => { $x.like($a) };
    ($x:expr, $x2:expr; $a:expr, $b:expr) => { $x.like($a) + $x.like($b) * $x };
    ($x:expr, $x2:expr; $a:expr, $b:expr, $($rest:expr),+) => {
        ($x.like($a) + $x.like($b) * $x) + $x2 * (polynomial!($x, $x2; $($rest),+))
    };
}

/// 2^(k + shift) for an integer k in the low bits, -1022 <= k + shift <= 1023.
#[inline(always)]
fn power_of_two<R: Register>(x: R, k: R::Bits, shift: i64) -> R {
    let biased = x.add_bits(k, x.bits_like(BIAS.wrapping_add_signed(shift)));
    x.with_bits(x.up::<MANTISSA_BITS>(biased))
}

/// The nearest integer, and a number that has it in the low bits.
#[inline(always)]
fn rounded<R: Register>(x: R) -> (R, R::Bits) {
    let shifted = x + x.like(ROUND);
    (shifted - x.like(ROUND), shifted.bits())
}

/// e^x; 0 below -708, infinite where it overflows.
#[inline(always)]
pub fn exp<R: Register>(x: R) -> R {
    const LEAST: f64 = -708.0;
    let (k, bits) = rounded(x * x.like(std::f64::consts::LOG2_E));
    let r = (x - k * x.like(LN2[0])) - k * x.like(LN2[1]);
    // of 2 e^r, so that the power of two is never beyond the largest number
    let r2 = r * r;
    let tail = polynomial!(r, r2;
        1.000_000_000_000_000_2, 0.333_333_333_333_333_4, 0.083_333_333_333_247_98,
        0.016_666_666_666_660_1, 0.002_777_777_783_456_359, 0.000_396_825_397_262_119_4,
        4.960_304_238_043_55e-5, 5.511_453_675_736_838e-6, 5.524_027_743_946_799e-7,
        5.020_084_831_401_013e-8);
    let value = (x.like(2.0) + ((r + r) + r2 * tail)) * power_of_two(x, bits, -1);
    let value = x.if_less(x.like(LEAST), x.like(0.0), value);
    x.like(LARGEST_LOG).if_less(x, x.like(f64::INFINITY), value)
}

/// e^x - 1, accurate near 0 too.
#[inline(always)]
pub fn exp_m1<R: Register>(x: R) -> R {
    const LEAST: f64 = -40.0; // -1 to roundoff
    let least = x.like(LEAST);
    let x = x.if_less(least, least, x);
    let (k, bits) = rounded(x * x.like(std::f64::consts::LOG2_E));
    let high = x - k * x.like(LN2[0]);
    let low = k * x.like(LN2[1]);
    let r = high - low;
    let lost = (high - r) - low;
    let r2 = r * r;
    let tail = polynomial!(r, r2;
        0.5, 0.166_666_666_666_666_7, 0.041_666_666_666_666_67, 0.008_333_333_333_326_112,
        0.001_388_888_888_888_373, 0.000_198_412_698_749_012_6, 2.480_158_732_560_532_4e-5,
        2.755_725_529_796_964_3e-6, 2.755_727_357_010_214e-7, 2.510_525_953_844_849_4e-8,
        2.091_471_734_171_637_8e-9);
    // 2^k ((1 - 2^-k) + (e^r - 1)), the first bracket summed with r exactly
    let most = x.like(1000.0);
    let capped = most.if_less(k, most, k);
    let inverse = power_of_two(x, (x.like(ROUND) - capped).bits(), 0);
    let head = x.like(1.0) - inverse;
    let sum = head + r;
    let rest = (r - (sum - head)) + (lost + lost * r) + r2 * tail;
    let value = (sum + rest) * power_of_two(x, bits, -1) * x.like(2.0);
    x.like(LARGEST_LOG).if_less(x, x.like(f64::INFINITY), value)
}

/// ln(1 + x), accurate near 0 too; not a number below -1.
#[inline(always)]
pub fn ln_1p<R: Register>(x: R) -> R {
    const SQRT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
    const MANTISSA: u64 = (1 << MANTISSA_BITS) - 1;
    const ONE: u64 = BIAS << MANTISSA_BITS;
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    let one = x.like(1.0);
    let u = one + x;
    let back = u - one;
    let lost = (one - (u - back)) + (x - back);
    // u = 2^k (1 + f) with 1 + f between sqrt(1/2) and sqrt(2)
    let shifted = x.add_bits(u.bits(), x.bits_like(ONE - SQRT_HALF));
    let biased = x.down::<MANTISSA_BITS>(shifted);
    let k = x.with_bits(x.or_bits(biased, x.bits_like(TWO_52.to_bits()))) - x.like(TWO_52 + 1023.0);
    let mantissa = x.and_bits(shifted, x.bits_like(MANTISSA));
    let f = x.with_bits(x.add_bits(mantissa, x.bits_like(SQRT_HALF))) - one;
    let inverse = x.up::<MANTISSA_BITS>(x.sub_bits(x.bits_like(2 * BIAS), biased));
    let lost = x.if_less(
        x.like(2.0 * TWO_52),
        lost * x.with_bits(inverse),
        x.like(0.0),
    );
    let s = f / (x.like(2.0) + f);
    let z = s * s;
    let series = z * polynomial!(z, (z * z);
        6.666_666_666_666_735e-1, 3.999_999_999_940_942e-1, 2.857_142_874_366_239e-1,
        2.222_219_843_214_978_4e-1, 1.818_357_216_161_805e-1, 1.531_383_769_920_937_3e-1,
        1.479_819_860_511_658_6e-1);
    let half_square = x.like(0.5) * f * f;
    let small = s * (half_square + series) + (k * x.like(LN2[1]) + (lost - lost * f));
    let value = k * x.like(LN2[0]) - ((half_square - small) - f);
    // special values: ln 0, and the logarithms of negative numbers, infinity and NaN
    let infinity = x.like(f64::INFINITY);
    let value = x.if_less(infinity, value, x);
    let end = x.if_less(x.like(-1.0), x.like(f64::NAN), x * infinity);
    let is_inside = x.like(-1.0).if_less(x, one, x.like(0.0));
    x.like(0.5).if_less(is_inside, value, end)
}

/// Largest magnitude that [`sin`] and [`cos`] reduce by themselves.
pub const REDUCIBLE: f64 = 8e5;

/// The sine and the cosine of x up to signs and places, and the quadrant that tells them.
#[inline(always)]
fn in_quadrant<R: Register>(x: R) -> ((R, R), R::Bits) {
    const PARTS: [f64; 3] = [
        1.570_796_326_734_125_6,
        6.077_100_506_303_966e-11,
        2.022_266_248_795_950_6e-21,
    ];
    let (n, bits) = rounded(x * x.like(std::f64::consts::FRAC_2_PI));
    // x = n pi/2 + r + lost, |r| <= pi/4; r is not rounded once more, so that nothing waits for what is lost
    let first = x - n * x.like(PARTS[0]);
    let second = n * x.like(PARTS[1]);
    let r = first - second;
    let lost = ((first - r) - second) - n * x.like(PARTS[2]);
    (sin_cos(r, lost), bits)
}

/// The sine a quarter turn `quadrants` times further on, of what [`in_quadrant`] found.
#[inline(always)]
fn turned<R: Register>((sin, cos): (R, R), bits: R::Bits, quadrants: u64) -> R {
    let bits = sin.add_bits(bits, sin.bits_like(quadrants));
    let one = sin.bits_like(1);
    let odd = sin.or_bits(sin.and_bits(bits, one), sin.bits_like(1.0_f64.to_bits()));
    let value = sin.like(1.0).if_less(sin.with_bits(odd), cos, sin);
    let sign = sin.up::<62>(sin.and_bits(bits, sin.bits_like(2)));
    sin.with_bits(sin.xor_bits(value.bits(), sign))
}

/// sin(r + lost) and cos(r + lost) for |r| <= pi/4.
///
/// A single trajectory waits for them, so that the chain of dependent operations is as short as it can be.
#[inline(always)]
fn sin_cos<R: Register>(r: R, lost: R) -> (R, R) {
    let z = r * r;
    let (z2, cube, half) = (z * z, z * r, r.like(0.5) * z);
    let tail = three_pairs(
        (z, z2),
        [
            1.666_666_666_666_663_2e-1,
            -8.333_333_333_322_49e-3,
            1.984_126_982_985_795e-4,
            -2.755_731_370_707_006_8e-6,
            2.505_076_025_340_686_3e-8,
            -1.589_690_995_211_55e-10,
        ],
    );
    let sin = r - (cube * tail + (lost * half - lost));
    let tail = three_pairs(
        (z, z2),
        [
            4.166_666_666_666_66e-2,
            -1.388_888_888_887_411e-3,
            2.480_158_728_947_673e-5,
            -2.755_731_435_139_066_3e-7,
            2.087_572_321_298_175e-9,
            -1.135_964_755_778_819_5e-11,
        ],
    );
    let head = r.like(1.0) - half;
    let cos = head + (((r.like(1.0) - head) - half) + (z2 * tail - r * lost));
    (sin, cos)
}

/// A polynomial of degree 5 in z, its pairs side by side.
#[inline(always)]
fn three_pairs<R: Register>((z, z2): (R, R), c: [f64; 6]) -> R {
    // written out: what maps an array is compiled by itself, without the registers it is for
    let low = z.like(c[0]) + z.like(c[1]) * z;
    let middle = z.like(c[2]) + z.like(c[3]) * z;
    let high = z.like(c[4]) + z.like(c[5]) * z;
    (low + z2 * middle) + (z2 * z2) * high
}

/// sin x
#[inline(always)]
pub fn sin<R: Register>(x: R) -> R {
    let (found, bits) = in_quadrant(x);
    x.replace_beyond(REDUCIBLE, turned(found, bits, 0), f64::sin)
}

/// cos x
#[inline(always)]
pub fn cos<R: Register>(x: R) -> R {
    let (found, bits) = in_quadrant(x);
    x.replace_beyond(REDUCIBLE, turned(found, bits, 1), f64::cos)
}

/// [`sin`] and [`cos`], nearly at the price of one.
#[inline(always)]
pub fn sin_and_cos<R: Register>(x: R) -> (R, R) {
    let (found, bits) = in_quadrant(x);
    (
        x.replace_beyond(REDUCIBLE, turned(found, bits, 0), f64::sin),
        x.replace_beyond(REDUCIBLE, turned(found, bits, 1), f64::cos),
    )
}

/// x^(-1/2) by a guess from the exponent and two corrections.
#[inline(always)]
pub fn inverse_sqrt<R: Register>(x: R) -> R {
    let y = inverse_root_guess(x, 0.5, 6_590_334_613_690.777);
    let e = x.like(1.0) - x * (y * y);
    let e2 = e * e;
    let y = y * polynomial!(e, e2;
        0.999_999_257_744_548_6, 0.499_999_283_945_774, 0.376_276_076_910_575_85,
        0.313_669_208_508_954_3);
    let e = x.like(1.0) - x * (y * y);
    y + y * (e * (x.like(0.5) + x.like(0.375) * e))
}

/// x^(-1/3) for x > 0, by a guess from the exponent and two corrections.
#[inline(always)]
pub fn inverse_cbrt<R: Register>(x: R) -> R {
    const THIRD: f64 = 1.0 / 3.0;
    let y = inverse_root_guess(x, THIRD, 5_858_043_119_219.507);
    let e = x.like(1.0) - x * (y * y * y);
    let e2 = e * e;
    let y = y * polynomial!(e, e2;
        0.999_998_025_760_664_2, 0.333_331_466_153_214_3, 0.223_735_051_141_698_62,
        0.174_180_867_687_085_93);
    let e = x.like(1.0) - x * (y * y * y);
    y + y * (e * (x.like(THIRD) + x.like(2.0 * THIRD * THIRD) * e))
}

/// x^-power to some digits: the upper bits of x, read as an integer, are nearly its logarithm.
#[inline(always)]
fn inverse_root_guess<R: Register>(x: R, power: f64, origin: f64) -> R {
    const DROPPED: u32 = 20;
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    let upper = x.or_bits(x.down::<DROPPED>(x.bits()), x.bits_like(TWO_52.to_bits()));
    let guess = x.like(ROUND + origin + TWO_52 * power) - x.with_bits(upper) * x.like(power);
    x.with_bits(x.up::<DROPPED>(guess.bits()))
}
