//! Compensated numbers against whole numbers, and a tape near its root.

use liouville_base::compensated::Compensated;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::tape::{Column, Line, Op, Tape};
use std::sync::Arc;

/// A number with few zeros in it, by its place in a sequence: a fraction of 2^53.
fn fraction(k: u64) -> u64 {
    (k.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) | 1
}

#[allow(clippy::cast_precision_loss)] // of numbers below 2^53
fn compensated(a: u64) -> Compensated<f64> {
    Compensated::exact(a as f64 / 2.0_f64.powi(53))
}

/// x 2^106, exactly: what a product or a sum of fractions is.
#[allow(clippy::cast_possible_truncation)]
fn whole(x: Compensated<f64>) -> i128 {
    let part = |x: f64| (x * 2.0_f64.powi(53)) * 2.0_f64.powi(53);
    part(x.high) as i128 + part(x.low) as i128
}

#[test]
fn sums_and_products_lose_nothing() {
    for k in 1..200 {
        let (a, b) = (fraction(k), fraction(k + 1000));
        let (x, y) = (compensated(a), compensated(b));
        let (a, b) = (i128::from(a), i128::from(b));
        assert_eq!(whole(x * y), a * b);
        assert_eq!(whole(x + y), (a + b) << 53);
        assert_eq!(whole(x - y), (a - b) << 53);
        // low parts of operands, too: (x y − x) + y
        assert_eq!(whole((x * y - x) + y), a * b + ((b - a) << 53));
        assert_eq!((x * y).high.to_bits(), (x.high * y.high).to_bits());
    }
}

#[test]
fn quotients_and_roots_are_undone_by_products() {
    let least = 2.0_f64.powi(-100);
    for k in 1..200 {
        let (x, y) = (compensated(fraction(k)), compensated(fraction(k + 1000)));
        let back = x / y * y - x;
        assert!(
            (back.high + back.low).abs() <= least,
            "quotient {k}: {back:?}"
        );
        let root = (x * y).sqrt();
        let back = root * root - x * y;
        assert!((back.high + back.low).abs() <= least, "root {k}: {back:?}");
    }
}

/// (t + y · y − l²) / 2 and λ y, with parameters l.
fn circle() -> Tape {
    let input = |slot, group, element| Line::Input {
        slot,
        group,
        element,
    };
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let lines = [
        input(0, 0, 0),
        input(1, 1, 0),
        input(2, 1, 1),
        input(3, 2, 0),
        input(4, 3, 0),
        apply(Op::Sq, 5, 1, 1),
        apply(Op::Mul, 6, 2, 2),
        apply(Op::Add, 5, 5, 6),
        apply(Op::Sq, 6, 4, 4),
        apply(Op::Sub, 5, 5, 6),
        apply(Op::Add, 5, 5, 0),
        Line::Constant {
            slot: 6,
            value: 0.5,
        },
        apply(Op::Mul, 5, 5, 6),
        Line::Output {
            element: 0,
            slot: 5,
        },
        apply(Op::Sin, 7, 1, 1),
        apply(Op::Mul, 7, 3, 7),
        Line::Output {
            element: 1,
            slot: 7,
        },
    ];
    Tape::new(&[1, 2, 1, 1], 2, &lines).expect("a valid program")
}

#[test]
fn a_tape_near_its_root_gets_what_roundings_took() {
    let tape = circle();
    assert!(tape.compensated(2).is_none(), "of a sine");
    let mut bound = tape.bind(&[1.0]);
    let program = Arc::new(tape.compensated(1).expect("arithmetic"));
    let mut own = program.bind(&bound);
    for angle in [0.3_f64, 1.1, 2.0] {
        let cut = |x: f64| (x * 2.0_f64.powi(53)).round() / 2.0_f64.powi(53);
        let (high, low) = ([angle.cos(), angle.sin()].map(cut), [3e-18, -5e-18]);
        let plain = tape.eval(&mut bound, [&[0.0], &high, &[2.0]])[0];
        let mut value = [plain];
        own.add_low(|_| 0.0, [&high, &low], (&mut value, 1.0));
        // in numbers of 2^-106, with the half twice
        #[allow(clippy::cast_possible_truncation)]
        let squares = high.map(|x| ((x * 2.0_f64.powi(53)) as i128).pow(2));
        #[allow(clippy::cast_precision_loss)]
        let of_high = (squares[0] + squares[1] - (1 << 106)) as f64 / 2.0_f64.powi(107);
        let exact = of_high + (high[0] * low[0] + high[1] * low[1]);
        assert!(
            (value[0] - exact).abs() <= 1e-29,
            "{} for {exact}",
            value[0]
        );
        assert!((plain - exact).abs() > 1e-18, "roundings show: {plain}");

        let mut lanes = program.bind(&tape.bind(&[Lanes::<8>::splat(1.0)]));
        let mut values = [Lanes::splat(plain)];
        let splat = |x: [f64; 2]| x.map(Lanes::splat);
        lanes.add_low(
            |_| 0.0,
            [&splat(high), &splat(low)],
            (&mut values, Lanes::splat(1.0)),
        );
        for member in 0..8 {
            assert_eq!(values[0].member(member).to_bits(), value[0].to_bits());
        }
    }
}

/// y (y − 1/3) below 1/2 and 3 y (y − 7/9) above, near both roots.
#[test]
fn pieces_of_a_table_are_compensated_too() {
    let number = |slot, value| Line::Constant { slot, value };
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let (root, other) = (1.0 / 3.0, 7.0 / 9.0);
    let columns = [vec![0.5], vec![1.0, 3.0], vec![root, other]].map(Column::from);
    let lines = [
        number(0, 0.0),
        number(1, 1.0),
        number(2, 2.0),
        Line::Input {
            slot: 3,
            group: 1,
            element: 0,
        },
        apply(Op::Search, 4, 3, 0),
        apply(Op::Entry, 5, 4, 1),
        apply(Op::Entry, 6, 4, 2),
        apply(Op::Sub, 6, 3, 6),
        apply(Op::Mul, 6, 6, 3),
        apply(Op::Mul, 6, 6, 5),
        Line::Output {
            element: 0,
            slot: 6,
        },
    ];
    let tape = Tape::with_columns(&[1, 1, 0], 1, &lines, Box::from(columns)).expect("valid");
    let mut bound = tape.bind::<f64>(&[]);
    let mut own = Arc::new(tape.compensated(1).expect("known")).bind(&bound);
    for (factor, root) in [(1.0, root), (3.0, other)] {
        let (y, low) = (root + 2.0_f64.powi(-40), 1e-18);
        let plain = tape.eval(&mut bound, [&[0.0], &[y]])[0];
        let mut value = [plain];
        own.add_low(|_| 0.0, [&[y], &[low]], (&mut value, 1.0));
        let [x, root, factor] = [y, root, factor].map(Compensated::exact);
        let x = x + Compensated::exact(low);
        let exact = (x - root) * x * factor;
        let error = |found: f64| ((found - exact.high) - exact.low).abs();
        let roundoff = f64::EPSILON * plain;
        assert!(error(value[0]) <= roundoff, "{} for {exact:?}", value[0]);
        assert!(error(plain) > 1e-19, "low parts show: {plain}");
    }
}
