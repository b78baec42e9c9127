//! Kinetic energy by Fourier transforms, and the split operator with it.

use liouville_base::composition::{Composed, Parts};
use liouville_base::error::StepError;
use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::InstructionSet;
use liouville_tests::quantum::{distance, energies, flows, kinetic, packet, places, rotor};
use liouville_waves::method::{Phases, Wave};
use liouville_waves::problem::{Hamiltonian, Kinetic, ProductScratch, Update};
use std::f64::consts::TAU;
use std::sync::Arc;

const POINTS: u32 = 32;

/// The places of all numbers of an array, the last axis fastest.
fn indices(shape: &[u32]) -> Vec<Vec<u32>> {
    shape.iter().fold(vec![vec![]], |all, n| {
        let longer = |place: &Vec<u32>| {
            let place = place.clone();
            (0..*n).map(move |j| [place.clone(), vec![j]].concat())
        };
        all.iter().flat_map(longer).collect()
    })
}

/// The plane wave of a wave vector.
fn wave(shape: &[u32], k: &[u32], shift: f64) -> Vec<f64> {
    let angle = |place: &Vec<u32>| {
        let turns = place.iter().zip(k).zip(shape);
        turns
            .map(|((j, k), n)| f64::from(j * k % n) / f64::from(*n))
            .sum::<f64>()
            * TAU
    };
    indices(shape)
        .iter()
        .map(|place| (angle(place) + shift).cos())
        .collect()
}

#[test]
fn plane_waves_have_their_energies() {
    for shape in [
        &[1][..],
        &[6],
        &[9],
        &[4, 6],
        &[5, 3],
        &[19, 8],
        &[3, 4, 6],
        &[4, 2, 5],
    ] {
        let hamiltonian = Hamiltonian::new(vec![kinetic(shape)]);
        let mut scratch = ProductScratch::default();
        let largest: f64 = shape.iter().map(|n| energies(*n)[*n as usize / 2]).sum();
        for k in indices(shape) {
            let energy = k.iter().zip(shape).map(|(k, n)| energies(*n)[*k as usize]);
            let energy: f64 = energy.sum();
            let x = wave(shape, &k, 0.3);
            let mut out = vec![0.5; x.len()];
            let (keep, factor, diagonal) = (2.0, -0.5, 0.25);
            let update = Update {
                keep,
                factor,
                diagonal,
            };
            (hamiltonian.sum().update(
                InstructionSet::default(),
                update,
                &x,
                &mut out,
                &mut scratch,
            ))
            .expect("a product");
            for (out, x) in out.iter().zip(&x) {
                let wanted = 1.0 - 0.5 * energy * x + 0.25 * x;
                assert!(
                    (out - wanted).abs() < 1e-14 * (1.0 + largest),
                    "{shape:?} {k:?}"
                );
            }
        }
    }
}

#[test]
fn members_side_by_side_have_the_bits_of_each_alone() {
    let hamiltonian = Hamiltonian::new(vec![kinetic(&[5, 6])]);
    let alone = |member: usize| wave(&[5, 6], &[1, 2], 0.1 * member as f64);
    let mut x = vec![Lanes::<8>::splat(0.0); 30];
    for member in 0..8 {
        for (x, value) in x.iter_mut().zip(alone(member)) {
            x.set_member(member, value);
        }
    }
    let (mut scratch, machine) = (ProductScratch::default(), InstructionSet::default());
    let mut all = x.clone();
    let sum = hamiltonian.sum();
    sum.multiply(machine, &x, &mut all, &mut scratch)
        .expect("a product");
    for member in 0..8 {
        let mut out = vec![0.0; 30];
        sum.multiply(machine, &alone(member), &mut out, &mut scratch)
            .expect("a product");
        let same = all
            .iter()
            .zip(&out)
            .all(|(a, b)| a.member(member).to_bits() == b.to_bits());
        assert!(same, "member {member}");
    }
}

#[test]
fn energies_that_are_not_even_are_refused() {
    assert!(Kinetic::new(&[vec![0.0, 1.0, 4.0, 1.0]]).is_some());
    assert!(Kinetic::new(&[vec![0.0, 1.0, 4.0, 1.5]]).is_none());
    assert!(Kinetic::new(&[vec![]]).is_none());
    assert!(Kinetic::new(&[]).is_none());
    assert!(Kinetic::new(&[vec![f64::NAN]]).is_none());
    assert_eq!(
        Kinetic::new(&[vec![0.5, 1.0], vec![-3.0, 2.0]]).map(|k| k.bounds()),
        Some((-2.5, 3.0))
    );
}

fn split(hamiltonian: Hamiltonian, name: &str) -> Composed<Phases> {
    let phases = Phases::new(Arc::new(hamiltonian), 1e-10).expect("T and diagonals");
    Composed::following(phases, flows(name))
}

fn walk(
    stepper: &mut Composed<Phases>,
    mut psi: Wave<f64>,
    t: f64,
    h: f64,
    steps: u32,
) -> Wave<f64> {
    for n in 0..steps {
        stepper
            .step(t + f64::from(n) * h, h, &mut psi)
            .expect("a step");
    }
    stepper.synchronize(&mut psi).expect("a state to look at");
    psi
}

#[test]
fn splittings_have_their_orders() {
    for a in [0.0, 1.5] {
        let end = |name: &str, steps: u32| {
            let h = 2.0 / f64::from(steps);
            walk(
                &mut split(rotor(POINTS, a), name),
                packet(POINTS),
                0.3,
                h,
                steps,
            )
        };
        let reference = end("SS10s35", 100);
        for (name, order, steps) in [
            ("S2", 2.0, 128),
            ("BM4", 4.0, 32),
            ("RKN4s6", 4.0, 32),
            ("BM6", 6.0, 12),
            ("RKN6s11", 6.0, 8),
        ] {
            let coarse = distance(&end(name, steps), &reference);
            let fine = distance(&end(name, 2 * steps), &reference);
            let seen = (coarse / fine).log2();
            assert!(
                (seen - order).abs() < 0.1,
                "{name}, a = {a}: {seen}, {coarse:e} {fine:e}"
            );
        }
    }
}

#[test]
fn a_product_state_of_a_separable_problem_stays_one() {
    let shape = [9, 8, 6];
    let alone = |points: u32| {
        let psi = packet(points);
        walk(
            &mut split(Hamiltonian::new(vec![kinetic(&[points])]), "S2"),
            psi,
            0.0,
            0.05,
            20,
        )
    };
    let v: Vec<f64> = indices(&shape)
        .iter()
        .map(|place| f64::from(place[1]) * 0.7)
        .collect();
    let times = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    // the middle axis has a potential besides
    let middle = {
        let v: Vec<f64> = (0..8).map(|j| f64::from(j) * 0.7).collect();
        let hamiltonian =
            Hamiltonian::new(vec![liouville_tests::quantum::diagonal(&v), kinetic(&[8])]);
        walk(&mut split(hamiltonian, "S2"), packet(8), 0.0, 0.05, 20)
    };
    let product = |axes: [&Wave<f64>; 3]| {
        let at = |place: &Vec<u32>| {
            let values = place
                .iter()
                .zip(axes)
                .map(|(j, psi)| (psi.q[*j as usize], psi.p[*j as usize]));
            values.fold((1.0, 0.0), times)
        };
        let (q, p) = indices(&shape).iter().map(at).unzip();
        Wave::new(q, p)
    };
    let start = shape.map(packet);
    let start = product([&start[0], &start[1], &start[2]]);
    let hamiltonian = Hamiltonian::new(vec![
        kinetic(&shape),
        liouville_tests::quantum::diagonal(&v),
    ]);
    let end = walk(&mut split(hamiltonian, "S2"), start, 0.0, 0.05, 20);
    let wanted = product([&alone(9), &middle, &alone(6)]);
    assert!(
        distance(&end, &wanted) < 1e-12,
        "{}",
        distance(&end, &wanted)
    );
}

#[test]
fn steps_back_undo_steps() {
    for name in ["S2", "BM6", "RKN4s6", "RKN6s11"] {
        let mut stepper = split(rotor(POINTS, 1.5), name);
        let there = walk(&mut stepper, packet(POINTS), 0.0, 0.05, 40);
        let back = walk(&mut stepper, there, 2.0, -0.05, 40);
        let error = distance(&back, &packet(POINTS));
        assert!(error < 1e-12, "{name}: {error:e}");
    }
}

#[test]
fn the_norm_stays_at_roundoff() {
    let psi = packet(POINTS);
    let norm = |psi: &Wave<f64>| Wave::new(psi.q.clone(), psi.p.clone()).start.sqrt();
    let end = walk(
        &mut split(rotor(POINTS, 1.5), "RKN6s11"),
        psi.clone(),
        0.0,
        0.05,
        10_000,
    );
    let drift = norm(&end) / norm(&psi) - 1.0;
    assert!(drift.abs() < 1e-11, "{drift:e}");
}

#[test]
fn a_state_whose_norm_is_off_is_refused() {
    let hamiltonian = Arc::new(rotor(POINTS, 0.0));
    let phases = Phases::new(hamiltonian, 1e-10).expect("T and diagonals");
    let mut psi = packet(POINTS);
    psi.q[0] += 1e-3;
    let outcome = phases.check(1.0, &psi);
    assert!(
        matches!(outcome, Err(StepError::Norm { t: 1.0, .. })),
        "{outcome:?}"
    );
    psi.q[0] = f64::NAN;
    assert!(phases.check(1.0, &psi).is_err());
}

#[test]
fn only_sums_of_kinetic_energy_and_diagonals_are_split() {
    let ring = [(0, 1), (1, 0)];
    let (row, col): (Vec<usize>, Vec<usize>) = ring.into_iter().unzip();
    let rows = liouville_base::linalg::Rows::new((32, 32), &row, &col, &[1.0; 2]).expect("entries");
    let coupled = liouville_waves::problem::Operator::Rows(Arc::new(rows));
    let v = liouville_tests::quantum::diagonal(&places(32));
    let is_split = |terms| Phases::new(Arc::new(Hamiltonian::new(terms)), 1e-10).is_some();
    assert!(is_split(vec![v.clone(), kinetic(&[4, 8])]));
    assert!(!is_split(vec![v.clone()]));
    assert!(!is_split(vec![kinetic(&[32]), kinetic(&[32])]));
    assert!(!is_split(vec![kinetic(&[32]), coupled]));
}
