//! A tape with terms is its program plus products and forms of matrices, however often it runs.

use liouville_base::linalg::{PatternError, Rows};
use liouville_base::real::{Lanes, WIDTH};
use liouville_base::tape::{Line, Op, Tape, TapeError, Term};
use liouville_tests::properties::properties;
use proptest::prelude::*;
use std::sync::Arc;

/// (x, y; p) → (x₀ y₀, p², 2 p², 1, x₀ y₀ + p²): written by every evaluation, once, once, once, every.
fn program() -> Tape {
    let input = |slot, group| Line::Input {
        slot,
        group,
        element: 0,
    };
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let output = |element, slot| Line::Output { element, slot };
    let lines = [
        input(0, 0),
        input(1, 1),
        input(2, 2),
        apply(Op::Mul, 0, 0, 1),
        apply(Op::Mul, 2, 2, 2),
        output(1, 2),
        apply(Op::Add, 1, 2, 2),
        output(2, 1),
        apply(Op::Add, 1, 0, 2), // reads what output 1 is
        output(4, 1),
        output(0, 0),
        Line::Constant {
            slot: 1,
            value: 1.0,
        },
        output(3, 1),
    ];
    Tape::new(&[3, 2, 1], 5, &lines).expect("a valid program")
}

fn wanted_of_program(x: &[f64], y: &[f64], p: f64) -> Vec<f64> {
    vec![x[0] * y[0], p * p, 2.0 * p * p, 1.0, x[0] * y[0] + p * p]
}

/// A dense matrix of few values, many of them zero, and its rows.
fn matrix(rows: usize, cols: usize) -> impl Strategy<Value = (Vec<Vec<f64>>, Arc<Rows>)> {
    let entry = prop_oneof![Just(0.0), -2.0..2.0];
    prop::collection::vec(prop::collection::vec(entry, cols), rows).prop_map(move |dense| {
        let entries: Vec<(usize, usize)> = (0..cols)
            .flat_map(|j| (0..rows).map(move |i| (i, j)))
            .filter(|(i, j)| dense[*i][*j] != 0.0)
            .collect();
        let (row, col): (Vec<_>, Vec<_>) = entries.iter().copied().unzip();
        let values: Vec<f64> = entries.iter().map(|(i, j)| dense[*i][*j]).collect();
        let rows = Rows::new((rows, cols), &row, &col, &values).expect("entries inside");
        (dense, Arc::new(rows))
    })
}

fn times(matrix: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    let row = |row: &Vec<f64>| row.iter().zip(x).map(|(a, x)| a * x).sum();
    matrix.iter().map(row).collect()
}

fn near(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-13)
}

proptest! {
    #![proptest_config(properties(256))]

    #[test]
    fn terms_are_added_to_the_program(
        (a, a_rows) in matrix(4, 3),
        (b, b_rows) in matrix(2, 2),
        (c, c_rows) in matrix(2, 2),
        constant in prop::collection::vec(prop_oneof![Just(0.0), -2.0..2.0], 5),
        points in prop::collection::vec(prop::array::uniform5(-2.0..2.0_f64), WIDTH + 1),
        p in -2.0..2.0_f64,
    ) {
        let terms = vec![
            Term::Product { first: 1, group: 0, factor: -2.0, matrix: a_rows },
            Term::Product { first: 0, group: 1, factor: 1.0, matrix: b_rows },
            Term::Form { output: 2, group: 1, factor: 0.5, matrix: c_rows },
        ];
        let tape = program().with_terms(&constant, terms).expect("terms that fit");
        let wanted = |point: &[f64; 5]| {
            let (x, y) = point.split_at(3);
            let mut wanted = wanted_of_program(x, y, p);
            wanted.iter_mut().zip(&constant).for_each(|(out, c)| *out += c);
            wanted[1..].iter_mut().zip(times(&a, x)).for_each(|(out, value)| *out -= 2.0 * value);
            wanted.iter_mut().zip(times(&b, y)).for_each(|(out, value)| *out += value);
            wanted[2] += 0.5 * y.iter().zip(times(&c, y)).map(|(y, value)| y * value).sum::<f64>();
            wanted
        };
        let mut registers = tape.bind(&[p]);
        let mut single = Vec::new();
        for point in &points {
            let values = tape.eval(&mut registers, [&point[..3], &point[3..]]);
            prop_assert!(near(values, &wanted(point)), "{values:?} for {:?}", wanted(point));
            single.extend_from_slice(values);
        }
        let lanes = |range: std::ops::Range<usize>| -> Vec<Lanes> {
            range.map(|k| Lanes(std::array::from_fn(|i| points[i][k]))).collect()
        };
        let mut registers = tape.bind(&[Lanes([p; WIDTH])]);
        for _ in 0..2 {
            let values = tape.eval(&mut registers, [&lanes(0..3), &lanes(3..5)]);
            for (k, value) in values.iter().enumerate() {
                let own: Vec<f64> = (0..WIDTH).map(|i| single[5 * i + k]).collect();
                prop_assert_eq!(&value.0[..], &own[..], "every lane has the bits of one number");
            }
        }
        let rows = |range: std::ops::Range<usize>| -> Vec<f64> {
            points.iter().flat_map(|point| point[range.clone()].to_vec()).collect()
        };
        prop_assert_eq!(tape.map(&[p], &[&rows(0..3), &rows(3..5)], points.len()), single);
    }
}

fn identity(n: usize) -> Arc<Rows> {
    let diagonal: Vec<usize> = (0..n).collect();
    Arc::new(Rows::new((n, n), &diagonal, &diagonal, &vec![1.0; n]).expect("entries inside"))
}

#[test]
fn constants_alone_leave_nothing_to_evaluate() {
    let lines = [
        Line::Constant {
            slot: 0,
            value: 1.0,
        },
        Line::Output {
            element: 0,
            slot: 0,
        },
        Line::Output {
            element: 1,
            slot: 0,
        },
    ];
    let tape = Tape::new(&[2, 0], 2, &lines).expect("a valid program");
    let tape = tape
        .with_terms(&[0.5, 0.0], Vec::new())
        .expect("terms that fit");
    assert!(tape.is_empty());
    let mut registers = tape.bind(&[]);
    for _ in 0..2 {
        assert_eq!(tape.eval(&mut registers, [&[8.0, 9.0]]), [1.5, 1.0]);
    }
    let product = Term::Product {
        first: 0,
        group: 0,
        factor: 1.0,
        matrix: identity(2),
    };
    let tape = tape.with_terms(&[], vec![product]).expect("terms that fit");
    assert!(!tape.is_empty());
    assert_eq!(tape.eval(&mut tape.bind(&[]), [&[8.0, 9.0]]), [9.0, 10.0]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let refusal = |constant: &[f64], term: Option<Term>| {
        let terms = term.into_iter().collect();
        program().with_terms(constant, terms).expect_err("no fit")
    };
    let product = |first, group, n| {
        let (factor, matrix) = (1.0, identity(n));
        Some(Term::Product {
            first,
            group,
            factor,
            matrix,
        })
    };
    assert_eq!(
        refusal(&[1.0], None),
        TapeError::Constant {
            found: 1,
            outputs: 5
        }
    );
    assert_eq!(
        refusal(&[], product(0, 3, 1)),
        TapeError::Group { term: 0, group: 3 }
    );
    assert_eq!(
        refusal(&[], product(0, 0, 2)),
        TapeError::Shape {
            term: 0,
            rows: 2,
            cols: 2,
            size: 3
        }
    );
    for first in [3, usize::MAX] {
        assert_eq!(
            refusal(&[], product(first, 0, 3)),
            TapeError::Range {
                term: 0,
                first,
                count: 3,
                outputs: 5
            }
        );
    }
    let matrix = Rows::new((1, 2), &[0], &[1], &[1.0]).expect("entries inside");
    let form = Term::Form {
        output: 0,
        group: 1,
        factor: 1.0,
        matrix: Arc::new(matrix),
    };
    assert_eq!(
        refusal(&[], Some(form)),
        TapeError::Shape {
            term: 0,
            rows: 1,
            cols: 2,
            size: 2
        }
    );
}

#[test]
fn a_matrix_has_its_entries_inside() {
    assert_eq!(
        Rows::new((2, 3), &[1, 2], &[2, 0], &[1.0, 1.0]),
        Err(PatternError {
            row: 2,
            col: 0,
            rows: 2,
            cols: 3
        })
    );
}
