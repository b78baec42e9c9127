//! The flows of pieces against plain loops; the same bits for lanes, threads and every machine; their
//! adjoints and determinants.

use liouville_base::composition::{Composed, Flow, Parts};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::Lanes;
use liouville_base::simd::{InstructionSet, Stored};
use liouville_base::tableau::Scheme;
use liouville_fields::problem::{Piece, Split};
use liouville_fields::volume::{Determinant, Volume};
use liouville_tests::properties::properties;
use liouville_tests::splits::{Draw, affine, every_kind, lorenz, plain, polynomials, reach};
use proptest::prelude::*;
use std::sync::Arc;

/// A split with a piece of each kind, and a state for it.
fn field(seed: u64) -> (Arc<Split>, Vec<f64>) {
    let mut draw = Draw::new(seed);
    let n = 3 + draw.below(7);
    let pieces = every_kind(&mut draw, n);
    let x = draw.reals(n);
    (Arc::new(Split::new(n, pieces).expect("proper pieces")), x)
}

fn scheme(name: &str) -> &'static Scheme {
    Scheme::named(name).expect("a scheme of this name")
}

/// The values after one flow.
fn flowed(volume: &mut Volume<f64>, flow: Flow, h: f64, x: &[f64]) -> Result<Vec<f64>, StepError> {
    let mut state = volume.state(x);
    volume.flows(&[flow], 0.0, 0.0, h, &mut state)?;
    let mut x = x.to_vec();
    volume.values(&state, &mut x);
    Ok(x)
}

fn whole(part: usize, is_adjoint: bool) -> Flow {
    Flow {
        part,
        is_adjoint,
        weight: 1.0,
        offset: 0.0,
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let far = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
    far.fold(0.0, f64::max)
}

/// `steps` of a scheme from x, the same for every member.
fn stepped<S: Stored>(
    volume: &Volume<S>,
    name: &str,
    steps: u32,
    x: &[f64],
) -> Result<Vec<f64>, StepError> {
    let x: Vec<S> = x.iter().map(|x| S::splat(*x)).collect();
    let mut state = volume.state(&x);
    let mut stepper = Composed::new(volume.clone(), scheme(name));
    for n in 0..steps {
        stepper.step(f64::from(n) * 0.05, 0.05, &mut state)?;
    }
    stepper.synchronize(&mut state)?;
    let mut end = x;
    volume.values(&state, &mut end);
    let members = 0..S::MEMBERS;
    for end in &end {
        let bits = end.member(0).to_bits();
        assert!(members.clone().all(|k| end.member(k).to_bits() == bits));
    }
    Ok(end.iter().map(|x| x.member(0)).collect())
}

fn bits(x: &Result<Vec<f64>, StepError>) -> Result<Vec<u64>, StepError> {
    let x = x.as_ref().map_err(Clone::clone)?;
    Ok(x.iter().map(|x| x.to_bits()).collect())
}

proptest! {
    #![proptest_config(properties(200))]

    #[test]
    fn flows_are_those_of_plain_loops(seed: u64, is_compensated: bool) {
        let (split, x) = field(seed);
        let mut volume = Volume::<f64>::new(Arc::clone(&split), is_compensated);
        for (part, piece) in split.pieces().iter().enumerate() {
            for (is_adjoint, h) in [(false, 0.1), (true, 0.1), (false, -0.3)] {
                let is_adjoint = is_adjoint && !volume.is_exact(part);
                let fast = flowed(&mut volume, whole(part, is_adjoint), h, &x);
                let reach = reach(piece, h, &x);
                if reach >= 1.0 {
                    let singular = StepError::Singular { piece: part, member: 0, t: 0.0 };
                    prop_assert_eq!(fast, Err(singular));
                } else if reach < 0.9 {
                    let mut slow = x.clone();
                    plain(piece, is_adjoint, h, &mut slow);
                    let far = distance(&fast.expect("a flow"), &slow);
                    prop_assert!(far < 1e-13, "part {part} is off by {far:e}");
                }
            }
        }
    }

    #[test]
    fn an_adjoint_undoes_a_flow_backwards(seed: u64) {
        let (split, x) = field(seed);
        let mut volume = Volume::<f64>::new(Arc::clone(&split), false);
        for (part, piece) in split.pieces().iter().enumerate() {
            if reach(piece, -0.1, &x).abs() > 0.9 {
                continue;
            }
            let is_adjoint = !volume.is_exact(part);
            let back = flowed(&mut volume, whole(part, false), -0.1, &x).expect("a flow");
            let again = flowed(&mut volume, whole(part, is_adjoint), 0.1, &back).expect("a flow");
            let far = distance(&again, &x);
            prop_assert!(far < 1e-13, "part {part} is off by {far:e}");
        }
    }

    #[test]
    fn lanes_and_machines_give_the_bits_of_one(seed: u64, is_compensated: bool) {
        let (split, x) = field(seed);
        let single = Volume::<f64>::new(Arc::clone(&split), is_compensated);
        let expected = bits(&stepped(&single, "BM4", 2, &x));
        for machine in InstructionSet::all() {
            prop_assert_eq!(&bits(&stepped(&single.clone().on(machine), "BM4", 2, &x)), &expected);
            let lanes = Volume::<Lanes<8>>::new(Arc::clone(&split), is_compensated);
            prop_assert_eq!(&bits(&stepped(&lanes.on(machine), "BM4", 2, &x)), &expected);
            let lanes = Volume::<Lanes<32>>::new(Arc::clone(&split), is_compensated);
            prop_assert_eq!(&bits(&stepped(&lanes.on(machine), "BM4", 2, &x)), &expected);
        }
    }

    #[test]
    fn determinants_are_one(seed: u64) {
        let (split, x) = field(seed);
        let short = |piece: &&Piece| reach(piece, 0.1, &x).abs() < 0.5;
        for piece in split.pieces().iter().filter(short) {
            let alone = Split::new(split.n(), vec![piece.clone()]).expect("a proper piece");
            let mut stepper = Determinant::new(Arc::new(alone), scheme("BM4"), false);
            let mut state = stepper.state(&x);
            let made = stepper.step(0.0, 0.1, &mut state);
            made.expect("a step can be made");
            prop_assert!(state.largest < 1e-12, "{piece:?} has {:e}", state.largest);
        }
        let mut stepper = Determinant::new(Arc::clone(&split), scheme("S2"), false);
        let mut state = stepper.state(&x);
        let steps = (0..5).try_for_each(|n| stepper.step(f64::from(n) * 0.02, 0.02, &mut state));
        let steps = steps.and_then(|()| stepper.synchronize(&mut state));
        // near a pole the derivative itself is far from known
        prop_assume!(steps.is_ok() && distance(&state.x, &x) < 0.5);
        prop_assert!(state.largest < 1e-12 && state.logarithm.abs() < 5e-12, "{state:?}");
        prop_assert!(distance(&state.x, &x) > 1e-6, "nothing moves");
    }
}

#[test]
fn a_determinant_that_is_not_one_is_seen() {
    // what the core takes the caller's word for
    let change = polynomials(1, 2, &[(0, 0.5, vec![0]), (0, 1.0, vec![1])]);
    let wrong = Piece::Shear {
        places: vec![0],
        direction: vec![1.0],
        change,
        functions: Vec::new(),
    };
    let split = Split::new(2, vec![wrong]).expect("the core does not look");
    let mut stepper = Determinant::new(Arc::new(split), scheme("Lie"), false);
    let mut state = stepper.state(&[0.3, 0.2]);
    for n in 0..2 {
        stepper
            .step(f64::from(n), 0.1, &mut state)
            .expect("a step can be made");
    }
    assert!((state.largest - 0.05).abs() < 1e-14);
    assert!((state.logarithm - 2.0 * 1.05_f64.ln()).abs() < 1e-14);
}

#[test]
fn rows_in_runs_have_the_bits_of_rows_alone() {
    // lanes are not stored in runs; every offset of a run's end from a register's is tried
    for n in (400..440).step_by(4) {
        let split = Arc::new(lorenz(n, 4));
        let x = Draw::new(n as u64).reals(n);
        let alone = stepped(
            &Volume::<Lanes<8>>::new(Arc::clone(&split), false),
            "S2",
            3,
            &x,
        );
        for machine in InstructionSet::all() {
            for is_compensated in [false, true] {
                let volume = Volume::<f64>::new(Arc::clone(&split), is_compensated).on(machine);
                let runs = stepped(&volume, "S2", 3, &x);
                if is_compensated {
                    let both = [runs, alone.clone()].map(|x| x.expect("steps"));
                    assert!(distance(&both[0], &both[1]) < 1e-15);
                } else {
                    assert_eq!(bits(&runs), bits(&alone), "n = {n}");
                }
            }
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let n = 400_000;
    let split = Arc::new(lorenz(n, 4));
    let x = Draw::new(7).reals(n);
    for is_compensated in [false, true] {
        let volume = Volume::<f64>::new(Arc::clone(&split), is_compensated);
        let one = stepped(&volume, "S2", 2, &x);
        for threads in [2, 3] {
            let several = stepped(&volume.clone().with_threads(threads), "S2", 2, &x);
            assert_eq!(bits(&several), bits(&one), "with {threads} threads");
        }
        assert!(distance(&one.expect("steps"), &x) > 1e-3, "nothing moves");
    }
}

#[test]
fn compensated_sums_keep_what_others_lose() {
    // x' = y, y' = -x by two natural pieces: x² + y² + h x y stays, but for rounding
    let piece = |row, coefficient, factor| Piece::Natural {
        rows: vec![row],
        change: polynomials(1, 2, &[(0, coefficient, vec![factor])]),
        functions: Vec::new(),
    };
    let pieces = vec![piece(0, 1.0, 1), piece(1, -1.0, 0)];
    let split = Arc::new(Split::new(2, pieces).expect("proper pieces"));
    let h = 0.01;
    let drift = |is_compensated| {
        let mut volume = Volume::<f64>::new(Arc::clone(&split), is_compensated);
        let mut state = volume.state(&[1.0, 0.0]);
        let flows = [whole(0, false), whole(1, false)];
        let mut largest = 0.0_f64;
        for n in 0..200_000 {
            volume
                .flows(&flows, 0.0, f64::from(n) * h, h, &mut state)
                .expect("flows");
            let mut x = [0.0; 2];
            volume.values(&state, &mut x);
            largest = largest.max((x[0] * x[0] + x[1] * x[1] + h * x[0] * x[1] - 1.0).abs());
        }
        largest
    };
    let (plain, compensated) = (drift(false), drift(true));
    assert!(
        compensated < 1e-15 && plain > 10.0 * compensated,
        "{plain:e} {compensated:e}"
    );
}

#[test]
fn affine_flows_of_many_lengths_add_up() {
    let mut draw = Draw::new(11);
    let split = Arc::new(Split::new(4, vec![affine(&mut draw, 4)]).expect("a proper piece"));
    let mut volume = Volume::<f64>::new(split, false);
    let x = draw.reals(4);
    let mut state = volume.state(&x);
    let mut length = 0.0;
    for n in 0..700 {
        let h = 1e-4 * f64::from(n % 600);
        volume.flow(0, false, 0.0, h, &mut state).expect("a flow");
        length += h;
    }
    let mut end = x.clone();
    volume.values(&state, &mut end);
    let at_once = flowed(&mut volume, whole(0, false), length, &x).expect("a flow");
    let size = at_once.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    let far = end.iter().zip(&at_once).map(|(a, b)| (a - b).abs() / size);
    assert!(far.fold(0.0, f64::max) < 1e-11);
}

#[test]
fn short_rows_have_the_bits_of_programs() {
    // a shear along one variable is a program, however short
    let third = 1.0 / 3.0;
    let (a, b) = (vec![1], vec![2]);
    let (aa, ab, bb, bc) = (vec![1, 1], vec![1, 2], vec![2, 2], vec![2, 3]);
    let (aaa, cc) = (vec![1, 1, 1], vec![3, 3]);
    let rows = [
        vec![(0, third, a.clone())],
        vec![(0, -1.0, a.clone()), (0, 0.7, b.clone())],
        vec![(0, -third, b), (0, 1.0, aa.clone()), (0, -1.0, ab.clone())],
        vec![(0, 1.0, a.clone()), (0, -0.3, bc.clone())],
        vec![(0, third, aa.clone()), (0, 0.2, ab.clone())],
        vec![
            (0, 1.0, aa),
            (0, 0.2, ab.clone()),
            (0, -1.0, bc.clone()),
            (0, third, cc.clone()),
        ],
        vec![(0, 11.0, bb), (0, 1.0, bc), (0, 1.0, vec![1, 1])],
        vec![(0, -1.0, ab.clone())],
        vec![(0, 0.1, ab), (0, 0.3, cc)],
        vec![(0, 0.3, aaa), (0, 0.1, a)],
    ];
    for terms in rows {
        for constant in [0.0, -3.0] {
            let mut terms = terms.clone();
            if constant != 0.0 {
                terms.push((0, constant, Vec::new()));
            }
            let change = polynomials(1, 4, &terms);
            let natural = Piece::Natural {
                rows: vec![0],
                change: change.clone(),
                functions: Vec::new(),
            };
            let shear = Piece::Shear {
                places: vec![0],
                direction: vec![1.0],
                change,
                functions: Vec::new(),
            };
            for x in [[0.3, -0.7, 1.1, 0.9], [0.0, -0.0, 0.0, 0.5]] {
                let ends = [&natural, &shear].map(|piece| {
                    let split = Split::new(4, vec![piece.clone()]).expect("a proper piece");
                    let volume = Volume::<Lanes<16>>::new(Arc::new(split), false);
                    bits(&stepped(&volume, "Lie", 3, &x))
                });
                assert_eq!(ends[0], ends[1], "{terms:?}");
            }
        }
    }
}
