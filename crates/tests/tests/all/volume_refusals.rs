//! What is refused: splits that are not what they say, and steps that lead to no number.

use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::tableau::Scheme;
use liouville_fields::problem::{Malformed, Piece, Polynomials, Split};
use liouville_fields::volume::Volume;
use liouville_tests::splits::{Term, cosine, polynomials};
use std::sync::Arc;

/// Why a piece of three variables is refused.
fn defect(piece: Piece) -> Malformed {
    match Split::new(3, vec![piece]) {
        Err(Malformed::Piece { piece: 0, defect }) => *defect,
        other => unreachable!("{other:?}"),
    }
}

fn natural(rows: Vec<usize>, terms: &[Term]) -> Piece {
    Piece::Natural {
        change: polynomials(rows.len(), 3, terms),
        rows,
        functions: Vec::new(),
    }
}

#[test]
fn polynomials_of_nothing_are_refused() {
    let one = |row, factor| Polynomials::new(1, 2, &[row], &[1.0], &[factor], 1);
    assert!(one(0, -1).is_ok());
    let row = Malformed::Row {
        term: 0,
        row: 1,
        rows: 1,
    };
    assert_eq!(one(1, 0), Err(row));
    let factor = Malformed::Factor {
        term: 0,
        factor: 2,
        variables: 2,
    };
    assert_eq!(one(0, 2), Err(factor));
    let infinite = Polynomials::new(1, 2, &[0], &[f64::INFINITY], &[0], 1);
    assert_eq!(
        infinite,
        Err(Malformed::NotFinite {
            name: "coefficient",
            index: 0
        })
    );
    let short = Polynomials::new(1, 2, &[0], &[1.0], &[0], 2);
    assert_eq!(
        short,
        Err(Malformed::Size {
            name: "factors",
            found: 1,
            wanted: 2
        })
    );
}

#[test]
fn pieces_that_change_what_they_read_are_refused() {
    let coupled = Malformed::Coupled {
        row: 0,
        variable: 1,
    };
    assert_eq!(
        defect(natural(vec![0, 1], &[(0, 1.0, vec![2, 1])])),
        coupled
    );
    let through_a_wave = Piece::Natural {
        rows: vec![0, 1],
        change: polynomials(2, 4, &[(0, 1.0, vec![3])]),
        functions: vec![cosine(vec![2, 1], vec![1.0, 2.0], 0.0)],
    };
    assert_eq!(defect(through_a_wave), coupled);
    let rate = polynomials(2, 3, &[(0, 1.0, vec![1])]);
    assert_eq!(
        defect(Piece::Scaling {
            rows: vec![0, 1],
            rate,
            functions: Vec::new(),
        }),
        coupled
    );
    let turn = |terms: &[Term]| Piece::Turn {
        rows: vec![0, 1, 2],
        change: polynomials(6, 4, terms),
        functions: vec![cosine(vec![0, 1, 2], vec![1.0; 3], 0.0)],
        is_cayley: false,
    };
    let own = Malformed::Coupled {
        row: 0,
        variable: 2,
    };
    assert_eq!(defect(turn(&[(0, 1.0, vec![2])])), own);
    let own = Malformed::Coupled {
        row: 0,
        variable: 0,
    };
    assert_eq!(defect(turn(&[(0, 1.0, vec![3]), (4, 1.0, vec![])])), own);
    let late = Piece::Triangular {
        order: vec![0, 1, 2],
        change: polynomials(3, 3, &[(1, 1.0, vec![2])]),
        a: vec![0.0],
        b: vec![1.0],
    };
    assert_eq!(
        defect(late),
        Malformed::Order {
            row: 1,
            variable: 2
        }
    );
    assert_eq!(
        defect(natural(vec![1, 1], &[])),
        Malformed::Repeated { variable: 1 }
    );
    assert_eq!(
        defect(natural(vec![3], &[])),
        Malformed::Variable { variable: 3, n: 3 }
    );
}

#[test]
fn pieces_with_a_divergence_are_refused() {
    let growing = Piece::Exponential {
        rows: vec![0, 1],
        rates: vec![1.0, -1.0],
        monomial: vec![1],
        functions: Vec::new(),
    };
    assert_eq!(defect(growing), Malformed::Divergence { divergence: -1.0 });
    let mut matrix = vec![0.0; 9];
    matrix[4] = 2.0;
    let vector = vec![0.0; 3];
    assert_eq!(
        defect(Piece::Affine { matrix, vector }),
        Malformed::Divergence { divergence: 2.0 }
    );
    let implicit = Piece::Triangular {
        order: vec![0],
        change: polynomials(1, 3, &[]),
        a: vec![0.5],
        b: vec![1.0],
    };
    assert_eq!(defect(implicit), Malformed::Implicit { stage: 0 });
}

/// x' = x² y, y' = −x y² + 1.
fn pole() -> Arc<Split> {
    let growth = Piece::Exponential {
        rows: vec![0, 1],
        rates: vec![1.0, -1.0],
        monomial: vec![0, 0],
        functions: Vec::new(),
    };
    // 3 − 1 ≠ 0: balanced by a third variable
    assert!(Split::new(2, vec![growth]).is_err());
    let growth = Piece::Exponential {
        rows: vec![0, 1],
        rates: vec![1.0, -2.0],
        monomial: vec![0],
        functions: Vec::new(),
    };
    let natural = Piece::Natural {
        rows: vec![1],
        change: polynomials(1, 2, &[(0, 1.0, Vec::new())]),
        functions: Vec::new(),
    };
    Arc::new(Split::new(2, vec![growth, natural]).expect("proper pieces"))
}

#[test]
fn a_pole_within_a_step_is_said_with_its_trajectory() {
    let volume = Volume::<Lanes<32>>::new(pole(), false);
    let mut x = [Lanes::splat(0.5), Lanes::splat(1.0)];
    x[0].set_member(21, 40.0); // x' = x² is over after 1/40
    x[0].set_member(30, 50.0);
    let mut state = volume.state(&x);
    let start = state.clone();
    let mut stepper = Composed::new(volume, Scheme::named("Lie").expect("a scheme"));
    let error = stepper.step(3.0, 0.1, &mut state);
    let singular = StepError::Singular {
        piece: 0,
        member: 21,
        t: 3.0,
    };
    assert_eq!(error, Err(singular));
    assert_eq!(state, start, "the state is as it was");
}

#[test]
fn an_overflow_is_said_with_its_variable() {
    // x is changed by none, so that no flow waits for the next step
    let piece = |row, factors: Vec<usize>| Piece::Natural {
        rows: vec![row],
        change: polynomials(1, 3, &[(0, 1.0, factors)]),
        functions: Vec::new(),
    };
    let pieces = vec![piece(2, Vec::new()), piece(1, vec![0; 4])];
    let split = Arc::new(Split::new(3, pieces).expect("proper pieces"));
    let volume = Volume::<Lanes<16>>::new(split, true);
    let mut x = [Lanes::splat(1.0); 3];
    x[0].set_member(5, 1e80);
    let mut state = volume.state(&x);
    let start = state.clone();
    let mut stepper = Composed::new(volume, Scheme::named("Lie").expect("a scheme"));
    let made = stepper.step(0.0, 1.0, &mut state);
    let overflow = StepError::Overflow {
        index: 1,
        member: 5,
        t: 1.0,
    };
    assert_eq!(made, Err(overflow));
    assert_eq!(state, start, "the state is as it was");
}

#[test]
fn a_monomial_that_overflows_is_no_flow() {
    let volume = Volume::<f64>::new(pole(), false);
    // the time to infinity is past: x² is beyond all numbers, and its flow would be 0 if believed
    for x in [1e200, -1e308] {
        let mut state = volume.state(&[x, 1.0]);
        let mut stepper = Composed::new(volume.clone(), Scheme::named("Lie").expect("a scheme"));
        assert!(stepper.step(0.0, 10.0, &mut state).is_err());
    }
}
