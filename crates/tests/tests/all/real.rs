//! An operation on lanes is the same operation on each number.

use liouville_base::real::{Lanes, Scalar, WIDTH};

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

#[test]
fn lanes_are_arithmetic_in_lock_step() {
    let a = Lanes([1.0, -2.0, 0.5, 0.0, -0.0, 1e300, f64::INFINITY, 3.0]);
    let b = Lanes([0.3, 7.0, -0.5, 0.0, 2.0, 1e300, f64::NEG_INFINITY, 3.0]);
    #[allow(clippy::type_complexity)]
    let pairs: [(Lanes, fn(f64, f64) -> f64); 5] = [
        (a + b, |a, b| a + b),
        (a - b, |a, b| a - b),
        (a * b, |a, b| a * b),
        (a / b, |a, b| a / b),
        (-a, |a, _| -a),
    ];
    for (lanes, one) in pairs {
        for i in 0..WIDTH {
            assert!(same(lanes.0[i], one(a.0[i], b.0[i])), "lane {i}");
        }
    }
    assert_eq!(Lanes::splat(2.0), Lanes([2.0; WIDTH]));
}
