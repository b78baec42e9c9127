//! Elementary functions against the standard library's, and over registers of every width.

#![allow(clippy::float_cmp)] // what is compared here is exact

use liouville_base::elementary;
use liouville_base::real::Lanes;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use liouville_tests::properties::properties;
use proptest::prelude::*;

type Function = fn(f64) -> f64;

/// Ours, the standard library's, and arguments over the whole range where they differ from a limit.
const FUNCTIONS: [(&str, Function, Function, f64, f64); 7] = [
    ("exp", elementary::exp, f64::exp, -707.9, 709.7),
    ("exp_m1", elementary::exp_m1, f64::exp_m1, -60.0, 709.7),
    ("ln_1p", elementary::ln_1p, f64::ln_1p, -1.0, 1e3),
    ("sin", elementary::sin, f64::sin, -1e6, 1e6),
    ("cos", elementary::cos, f64::cos, -1e6, 1e6),
    (
        "inverse_sqrt",
        elementary::inverse_sqrt,
        |x| 1.0 / x.sqrt(),
        1e-300,
        1e3,
    ),
    (
        "inverse_cbrt",
        elementary::inverse_cbrt,
        |x| 1.0 / x.cbrt(),
        1e-300,
        1e3,
    ),
];

/// Distance in units of the last place of `b`; infinite where only one is not a number.
fn ulps(a: f64, b: f64) -> f64 {
    if a == b || (a.is_nan() && b.is_nan()) {
        return 0.0;
    }
    let unit = f64::from_bits(b.abs().to_bits() + 1) - b.abs();
    let far = (a - b).abs() / unit;
    if far.is_nan() { f64::INFINITY } else { far }
}

proptest! {
    #![proptest_config(properties(20_000))]

    #[test]
    fn they_are_within_two_ulp(part in 0.0..1.0_f64, small in -300.0..0.0_f64) {
        for (name, ours, theirs, least, most) in FUNCTIONS {
            let wide = least + part * (most - least);
            let near = if least < 0.0 { 2.0 * part - 1.0 } else { 2.0 * part };
            let tiny = near * 10.0_f64.powf(small);
            let huge = most * 10.0_f64.powf(-small);
            for x in [wide, near, tiny, huge.min(1e300)] {
                prop_assert!(ulps(ours(x), theirs(x)) <= 2.0, "{name}({x:e})");
            }
        }
    }

    #[test]
    fn sines_next_to_multiples_of_a_quarter_turn_keep_their_digits(n in -500_000..500_000_i32, k in -3..4_i64) {
        let near = f64::from(n) * std::f64::consts::FRAC_PI_2;
        let x = f64::from_bits(near.to_bits().wrapping_add_signed(k));
        prop_assert!(ulps(elementary::sin(x), x.sin()) <= 2.0, "sin({x:e})");
        prop_assert!(ulps(elementary::cos(x), x.cos()) <= 2.0, "cos({x:e})");
    }
}

#[test]
fn they_have_the_limits_of_the_standard_library() {
    let ends = [
        0.0,
        -1.0,
        1e-310,
        -1e-310,
        709.79,
        1e300,
        f64::MAX,
        f64::INFINITY,
        -40.0,
        -1e300,
        f64::NEG_INFINITY,
        f64::NAN,
        1e17,
    ];
    for (name, ours, theirs, ..) in &FUNCTIONS[..5] {
        for x in ends {
            assert!(
                ulps(ours(x), theirs(x)) <= 2.0,
                "{name}({x:e}) = {:e}",
                ours(x)
            );
        }
    }
    // what the standard library makes subnormal
    assert_eq!(elementary::exp(-708.1), 0.0);
    assert_eq!(elementary::exp(-740.0), 0.0);
    assert_eq!(
        elementary::ln_1p(-2.0).to_bits() << 1,
        f64::NAN.to_bits() << 1
    );
}

/// Applies a function to all numbers.
struct Apply<'a, S> {
    function: usize,
    x: &'a mut [S],
}

impl<S> ForEach<S> for Apply<'_, S> {
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let x = window.load(self.x, 0);
        let y = match self.function {
            0 => x.exp(),
            1 => x.exp_m1(),
            2 => x.ln_1p(),
            3 => x.cos(),
            4 => x.inverse_root(2),
            _ => x.inverse_root(3),
        };
        window.store(self.x, 0, y);
        true
    }
}

impl<S> Kernel<S> for Apply<'_, S> {
    type Output = ();

    fn run<W: SimdViews<Stored = S>>(mut self, windows: W) {
        windows.each(self.x.len(), &mut self);
    }
}

/// Bits of the results, trajectory after trajectory; all that is not a number is the same.
fn applied<S: Stored>(machine: InstructionSet, function: usize, x: &[f64]) -> Vec<u64> {
    let mut stored = vec![S::splat(0.0); x.len() / S::MEMBERS];
    for (k, x) in x.iter().enumerate() {
        stored[k / S::MEMBERS].set_member(k % S::MEMBERS, *x);
    }
    let x = &mut stored;
    S::run(machine, Apply { function, x });
    let members = |x: &S| (0..S::MEMBERS).map(|k| x.member(k)).collect::<Vec<_>>();
    let bits = |x: f64| if x.is_nan() { 0 } else { x.to_bits() };
    stored.iter().flat_map(members).map(bits).collect()
}

#[test]
fn registers_have_the_bits_of_single_numbers() {
    let special = [
        0.0,
        -0.0,
        -1.0,
        -2.0,
        1e300,
        -1e300,
        f64::NAN,
        f64::INFINITY,
        1e6,
        3.5e8,
    ];
    let plain = (0..1014).map(|k| (f64::from(k) - 507.0) * 1.37);
    let x: Vec<f64> = special.into_iter().chain(plain).collect();
    for function in 0..6 {
        // positive numbers only, where there is a root
        let x: Vec<f64> = x
            .iter()
            .map(|x| if function < 4 { *x } else { x.abs() + 1e-3 })
            .collect();
        let alone: Vec<u64> = x
            .iter()
            .flat_map(|x| applied::<f64>(InstructionSet::default(), function, &[*x]))
            .collect();
        for machine in InstructionSet::all() {
            assert_eq!(applied::<f64>(machine, function, &x), alone);
            assert_eq!(applied::<Lanes<8>>(machine, function, &x), alone);
            assert_eq!(applied::<Lanes<64>>(machine, function, &x), alone);
        }
    }
}
