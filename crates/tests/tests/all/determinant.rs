//! The derivatives of steps, and their determinants.
#![allow(clippy::cast_possible_wrap)] // a handful of variables

use liouville_base::composition::Composed;
use liouville_base::error::{Quantity, StepError};
use liouville_base::method::Stepper;
use liouville_base::run::{Advance, Fixed, Run, Status};
use liouville_base::tableau::Scheme;
use liouville_fields::problem::{Piece, Polynomials, Split};
use liouville_fields::volume::{Determinant, Determined, Tangents, UserVariables, Volume};
use liouville_tests::splits::cosine;
use std::sync::Arc;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);
const START: [f64; 3] = [0.7, -0.4, 0.9];

fn scheme(name: &str) -> &'static Scheme {
    Scheme::named(name).expect("a scheme")
}

/// Σ c x_j x_k .. by rows, from (row, c, [j, k, ..]) with factors −1 where there are none.
fn polynomials(rows: usize, variables: usize, terms: &[(usize, f64, [i64; 2])]) -> Polynomials {
    let places: Vec<usize> = terms.iter().map(|term| term.0).collect();
    let coefficients: Vec<f64> = terms.iter().map(|term| term.1).collect();
    let factors: Vec<i64> = terms.iter().flat_map(|term| term.2).collect();
    Polynomials::new(rows, variables, &places, &coefficients, &factors, 2).expect("polynomials")
}

fn split(n: usize, pieces: Vec<Piece>) -> Arc<Split> {
    Arc::new(Split::new(n, pieces).expect("a split"))
}

fn natural(row: usize, n: usize, terms: &[(usize, f64, [i64; 2])]) -> Piece {
    Piece::Natural {
        rows: vec![row],
        change: polynomials(1, n, terms),
        functions: vec![],
    }
}

fn exponential(rates: &[f64], monomial: &[usize]) -> Piece {
    Piece::Exponential {
        rows: (0..rates.len()).collect(),
        rates: rates.to_vec(),
        monomial: monomial.to_vec(),
        functions: vec![],
    }
}

fn triangular(a: &[f64], b: &[f64]) -> Piece {
    let terms = [
        (1, 0.8, [0, 0]),
        (1, 0.3, [-1, 0]),
        (2, -0.5, [0, 1]),
        (2, 0.9, [1, 1]),
    ];
    Piece::Triangular {
        order: vec![0, 1, 2],
        change: polynomials(3, 3, &terms),
        a: a.to_vec(),
        b: b.to_vec(),
    }
}

/// About this axis, with a push.
fn turn(axis: [f64; 3], is_cayley: bool) -> Piece {
    let axis = axis.iter().enumerate().map(|(row, w)| (row, *w, [-1; 2]));
    let push = [(3, 0.2, [-1; 2]), (5, -0.7, [-1; 2])].into_iter();
    let terms: Vec<_> = axis.chain(push.filter(|_| !is_cayley)).collect();
    Piece::Turn {
        rows: vec![0, 1, 2],
        change: polynomials(6, 3, &terms),
        functions: vec![],
        is_cayley,
    }
}

/// One piece of each kind, and of each way to make its flow, of three variables.
fn kinds() -> Vec<(&'static str, Piece)> {
    let wave = |k: &[f64]| vec![cosine(vec![1, 2], k.to_vec(), 0.3)];
    let waving = [(0, 0.7, [1, 3]), (0, -0.2, [-1, 2])];
    // of y = x0 - 2 x1 + x2, which (1, 1, 1) does not change
    let square = [
        (0, 1.0, [0, 0]),
        (0, -4.0, [0, 1]),
        (0, 2.0, [0, 2]),
        (0, 4.0, [1, 1]),
        (0, -4.0, [1, 2]),
        (0, 1.0, [2, 2]),
    ];
    let shear = |direction: [f64; 3], change, functions| Piece::Shear {
        places: vec![0, 1, 2],
        direction: direction.to_vec(),
        change,
        functions,
    };
    let rate = polynomials(2, 3, &[(0, 0.6, [2, 2]), (1, -0.6, [2, 2])]);
    #[rustfmt::skip]
    let rk4 = [0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let root = 2_f64.sqrt();
    vec![
        (
            "natural",
            Piece::Natural {
                rows: vec![0],
                change: polynomials(1, 4, &waving),
                functions: wave(&[1.5, -0.8]),
            },
        ),
        ("shear", shear([0.1; 3], polynomials(1, 3, &square), vec![])),
        (
            "shear with a wave",
            shear(
                [0.5, 1.0, 2.0],
                polynomials(1, 4, &[(0, 0.9, [-1, 3])]),
                wave(&[2.0, -1.0]),
            ),
        ),
        (
            "scaling",
            Piece::Scaling {
                rows: vec![0, 1],
                rate,
                functions: vec![],
            },
        ),
        ("exponential", exponential(&[1.0, root, -2.0 - root], &[0])),
        ("products", exponential(&[-2.0, 4.0], &[0])),
        ("square roots", exponential(&[1.0, -3.0], &[0, 0])),
        ("cube roots", exponential(&[1.0, -4.0], &[0; 3])),
        ("exponential of α = 0", exponential(&[0.5, -0.5], &[0, 1])),
        ("Euler", triangular(&[0.0], &[1.0])),
        (
            "Runge-Kutta",
            triangular(&rk4, &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0]),
        ),
        ("turn", turn([0.3, -1.1, 0.8], false)),
        ("far turn", turn([20.0, 31.0, -17.0], false)),
        ("Cayley", turn([0.3, -1.1, 0.8], true)),
        (
            "affine",
            Piece::Affine {
                matrix: vec![0.4, 1.0, -0.3, 0.2, -0.9, 0.1, 0.7, -0.5, 0.5],
                vector: vec![0.1, -0.2, 0.3],
            },
        ),
    ]
}

/// A piece of this kind, and one more so that a step has flows to compose.
fn moving(piece: Piece) -> Arc<Split> {
    split(3, vec![piece, natural(2, 3, &[(0, 1.1, [0, 1])])])
}

/// A step of h = 0.1.
fn stepped(split: &Arc<Split>, name: &str, x: &[f64]) -> Vec<f64> {
    let volume = Volume::<f64>::new(Arc::clone(split), false);
    let mut state = volume.state(x);
    let mut stepper = Composed::new(volume.clone(), scheme(name));
    stepper.step(0.0, 0.1, &mut state).expect("a step");
    stepper.synchronize(&mut state).expect("a state");
    let mut x = x.to_vec();
    volume.values(&state, &mut x);
    x
}

/// The derivatives of that by x: a row for each variable at the start.
fn derivative(split: &Arc<Split>, name: &str, x: &[f64]) -> Vec<Vec<f64>> {
    let n = x.len();
    let one = |k: usize| f64::from(u8::from(k / n == k % n));
    let directions: Vec<f64> = (0..n * n).map(one).collect();
    let mut stepper = Tangents::new(Arc::clone(split), scheme(name), false, n);
    let mut state = stepper.state(x, &directions);
    stepper.step(0.0, 0.1, &mut state).expect("a step");
    state.tangents.chunks(n).map(<[f64]>::to_vec).collect()
}

/// What is found in steps of h = 0.1.
fn determined(
    split: &Arc<Split>,
    name: &str,
    x: &[f64],
    steps: usize,
) -> Result<Determined, StepError> {
    let mut stepper = Determinant::new(Arc::clone(split), scheme(name), false);
    let mut state = stepper.state(x);
    for n in 0..steps {
        stepper.step(0.1 * n as f64, 0.1, &mut state)?;
    }
    stepper.synchronize(&mut state)?;
    Ok(state)
}

fn assert_near(found: f64, wanted: f64, tolerance: f64, what: &str) {
    let error = (found - wanted).abs() / wanted.abs().max(1.0);
    assert!(error <= tolerance, "{what}: {found:e}, not {wanted:e}");
}

#[test]
fn the_derivative_of_a_step_is_that_of_its_differences() {
    for (kind, piece) in kinds() {
        let split = moving(piece);
        for name in ["Lie", "S2", "BM4"] {
            let found = derivative(&split, name, &START);
            for j in 0..3 {
                let apart = |by: f64| {
                    let mut x = START;
                    x[j] += by;
                    stepped(&split, name, &x)
                };
                let d = 1e-3;
                let (near, far) = ((apart(d), apart(-d)), (apart(2.0 * d), apart(-2.0 * d)));
                for i in 0..3 {
                    let slope = |(a, b): &(Vec<f64>, Vec<f64>)| a[i] - b[i];
                    // of order 4
                    let wanted = (8.0 * slope(&near) - slope(&far)) / (12.0 * d);
                    let what = format!("{kind}, {name}, d x{i} / d x{j}");
                    assert_near(found[j][i], wanted, 1e-10, &what);
                }
            }
        }
    }
}

#[test]
fn a_step_of_a_pendulum_has_its_printed_derivative() {
    // x' = y, y' = -x²: half a kick, a drift, half a kick
    let split = split(
        2,
        vec![
            natural(0, 2, &[(0, 1.0, [-1, 1])]),
            natural(1, 2, &[(0, -1.0, [0, 0])]),
        ],
    );
    let (x, y, h) = (0.6, -0.3, 0.1);
    let found = derivative(&split, "S2", &[x, y]);
    let end = x + h * (y - 0.5 * h * x * x);
    let drift = 1.0 - h * h * x;
    let wanted = [[drift, h], [-h * x - h * end * drift, 1.0 - h * h * end]];
    for i in 0..2 {
        for j in 0..2 {
            assert_near(found[j][i], wanted[i][j], 1e-15, "an entry");
        }
    }
}

#[test]
fn steps_of_every_piece_keep_volume() {
    for (kind, piece) in kinds() {
        let split = moving(piece);
        for name in ["Lie", "S2", "BM4"] {
            let end = determined(&split, name, &START, 5).expect(kind);
            assert!(end.largest <= 1e-13, "{kind}, {name}: {:e}", end.largest);
            assert!(
                end.logarithm.abs() <= 1e-13,
                "{kind}, {name}: {:e}",
                end.logarithm
            );
        }
    }
}

/// x_i += h c x_i², which is no shear: the determinant of a step is 1 + 2 h c x_i.
fn spoiled(n: usize, i: usize, c: f64) -> Arc<Split> {
    let square = [i as i64, i as i64];
    let false_shear = Piece::Shear {
        places: vec![i],
        direction: vec![1.0],
        change: polynomials(1, n, &[(0, c, square)]),
        functions: vec![],
    };
    // what couples all variables, where there are others
    let next = |j: usize| ((j + 1) % n) as i64;
    let others = (0..n).map(|j| natural(j, n, &[(0, 0.5, [next(j), -1])]));
    let others = others.take(if n > 1 { n } else { 0 });
    split(n, std::iter::once(false_shear).chain(others).collect())
}

#[test]
fn a_map_that_does_not_keep_volume_is_found_out() {
    // in the first block of directions, and in the others
    for (n, i) in [(1, 0), (3, 2), (8, 7), (9, 8), (20, 11)] {
        let mut x = vec![0.3; n];
        x[i] = 0.8;
        let end = determined(&spoiled(n, i, 1.0), "Lie", &x, 1).expect("a step");
        assert_near(end.largest, 2.0 * 0.1 * 0.8, 1e-14, "defect");
        assert_near(end.logarithm, f64::ln(1.16), 1e-14, "logarithm");
    }
}

#[test]
fn determinants_are_those_of_whole_steps() {
    // x0 *= exp(h x1²) is a flow, though not of this volume: flows of it add up between steps
    let growth = Piece::Scaling {
        rows: vec![0],
        rate: polynomials(1, 3, &[(0, 1.0, [1, 1])]),
        functions: vec![],
    };
    let cycle = (0..3).map(|j| natural(j, 3, &[(0, 0.5, [(j as i64 + 1) % 3, -1])]));
    let split = split(3, std::iter::once(growth).chain(cycle).collect());
    for name in ["Lie", "S2", "BM4"] {
        let mut x = vec![0.8, -0.4, 0.2];
        let (mut logarithm, mut largest) = (0.0, 0.0_f64);
        for _ in 0..5 {
            let d = derivative(&split, name, &x);
            let minor = |i: usize, j: usize| d[1][i] * d[2][j] - d[1][j] * d[2][i];
            let det = d[0][0] * minor(1, 2) - d[0][1] * minor(0, 2) + d[0][2] * minor(0, 1);
            logarithm += det.ln();
            largest = largest.max(det - 1.0);
            x = stepped(&split, name, &x);
        }
        let end = determined(&split, name, &[0.8, -0.4, 0.2], 5).expect("steps");
        assert_near(end.logarithm, logarithm, 1e-14, name);
        assert_near(end.largest, largest, 1e-14, name);
    }
}

#[test]
fn a_reflection_has_the_volume_but_not_the_determinant() {
    // 1 + 2 h c x = -1
    let end = determined(&spoiled(3, 0, -10.0), "Lie", &[1.0, 0.0, 0.0], 1).expect("a step");
    assert_near(end.largest, 2.0, 1e-14, "defect");
    assert_near(end.logarithm, 0.0, 1e-14, "logarithm");
}

#[test]
fn a_derivative_without_inverse_is_a_trouble_and_leaves_the_state() {
    // 1 + 2 h c x = 0
    let split = spoiled(3, 0, -5.0);
    let mut stepper = Determinant::new(split, scheme("Lie"), false);
    let mut state = stepper.state(&[1.0, 0.5, 0.25]);
    let before = state.clone();
    let unknown = StepError::NotFinite {
        quantity: Quantity::Observable,
        index: 0,
        t: 0.0,
    };
    assert_eq!(stepper.step(0.0, 0.1, &mut state), Err(unknown));
    assert_eq!(state, before);
}

#[test]
fn determinants_leave_the_trajectory_as_it_is() {
    for (kind, piece) in kinds() {
        let split = moving(piece);
        for (every, is_compensated) in [(1, false), (1, true), (4, false), (4, true)] {
            let seen = UserVariables { n: 3, basis: None };
            let stepper = Determinant::new(Arc::clone(&split), scheme("BM4"), is_compensated);
            let state = stepper.state(&START);
            let control = Box::new(Fixed::new(Box::new(stepper), 0.0, 0.05, 10));
            let mut run = Run::new(control, Box::new(seen), state, (every, 0)).expect("a start");
            assert_eq!(run.advance(ALL_DAY), Status::Done);
            let (_, found) = run.take();

            let volume = Volume::<f64>::new(Arc::clone(&split), is_compensated);
            let mut stepper = Composed::new(volume.clone(), scheme("BM4"));
            let mut state = volume.state(&START);
            let mut x = START;
            let mut rows = found.chunks(5);
            assert_eq!(rows.next().map(|row| &row[..3]), Some(&START[..]));
            for n in 1..=10 {
                stepper
                    .step(0.05 * (n - 1) as f64, 0.05, &mut state)
                    .expect("a step");
                if n % every == 0 || n == 10 {
                    stepper.synchronize(&mut state).expect("a state");
                    volume.values(&state, &mut x);
                    let row = rows.next().expect("a row");
                    assert_eq!(&row[..3], &x, "{kind}, one in {every}, {is_compensated}");
                    assert!(row[4] <= 1e-13);
                }
            }
            assert_eq!(rows.next(), None);
        }
    }
}
