//! Magnus methods on a driven chain, against a Runge–Kutta method.

use liouville_base::error::StepError;
use liouville_base::linalg::Rows;
use liouville_base::method::Stepper;
use liouville_base::observe::Observe;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::{InstructionSet, Stored};
use liouville_tests::quantum::{diagonal, distance, flows, potential};
use liouville_tests::{T, input, tape};
use liouville_waves::method::{
    Magnus, Nodes, Observable, Observer, ShearProgram, Sweeper, TermBounds, Wave,
};
use liouville_waves::problem::{Drive, Hamiltonian, Operator, ProductScratch};
use std::collections::BTreeMap;
use std::sync::Arc;

const SITES: u32 = 8;

/// A chain whose hopping is modulated and whose sites are shaken:
/// H = (1 + sin(2t)/2) hopping + cos(3t) tilt + a potential that travels.
fn driven() -> Arc<Hamiltonian> {
    let n = SITES as usize;
    let (row, col): (Vec<usize>, Vec<usize>) =
        (1..n).flat_map(|j| [(j - 1, j), (j, j - 1)]).unzip();
    let rows = Rows::new((n, n), &row, &col, &vec![-1.0; row.len()]).expect("entries inside");
    let x: Vec<f64> = (0..SITES).map(|j| f64::from(j) / 4.0 - 1.0).collect();
    let terms = vec![Operator::Rows(Arc::new(rows)), diagonal(&x)];
    let t = input(T, 0);
    let weights = [(&t * 2.0).sin() * 0.5 + 1.0, (&t * 3.0).cos()];
    let drive = Drive::new(Arc::new(tape([1, 0], &weights)), &[], 2).expect("two weights");
    let wave = (input(1, 0) * 2.0 - &t).sin();
    let potential = potential(&x, &wave);
    Arc::new(
        Hamiltonian::new(terms)
            .with_drive(drive)
            .with_potential(potential),
    )
}

/// Bounds of the hopping and of the tilt.
fn bounds() -> TermBounds {
    of_parts(&[(-2.0, 2.0), (-1.0, 0.75)])
}

/// Bounds of parts of one term each.
fn of_parts(parts: &[(f64, f64)]) -> TermBounds {
    TermBounds {
        groups: vec![1; parts.len()],
        parts: parts.to_vec(),
        ..TermBounds::default()
    }
}

fn nodes(order: usize, exponentials: usize) -> Nodes {
    Nodes::find(order, exponentials).expect("a method")
}

fn magnus<S: Stored>(nodes: Nodes) -> Magnus<S> {
    let exponential = ShearProgram {
        program: flows("SS10s35"),
        theta: 0.5,
        tolerance: 1e-10,
    };
    Magnus::new(Sweeper::new(driven()), nodes, exponential, bounds())
}

fn start() -> Wave<f64> {
    let q = (0..SITES).map(|j| (-0.5 * (f64::from(j) - 3.0).powi(2)).exp());
    let p = (0..SITES).map(|j| 0.3 * (f64::from(j) - 2.0).sin());
    Wave::new(q.collect(), p.collect())
}

const T0: f64 = 0.4;
const T1: f64 = 2.4;

/// q' = H(t) p, p' = −H(t) q by the classical Runge–Kutta method.
fn reference() -> Wave<f64> {
    let hamiltonian = driven();
    let mut present = hamiltonian.current().expect("a driven Hamiltonian");
    let mut scratch = ProductScratch::default();
    let mut field = |t: f64, psi: &Wave<f64>| {
        present.set(&hamiltonian, &[(1.0, t)]).expect("H");
        let h = hamiltonian.at(Some(&present));
        let (mut q, mut p) = (psi.p.clone(), psi.q.clone());
        let machine = InstructionSet::default();
        h.multiply(machine, &psi.p, &mut q, &mut scratch)
            .expect("a product");
        h.multiply(machine, &psi.q, &mut p, &mut scratch)
            .expect("a product");
        for p in &mut p {
            *p = -*p;
        }
        Wave {
            q,
            p,
            ..psi.clone()
        }
    };
    let along = |x: &[f64], h: f64, k: &[f64]| x.iter().zip(k).map(|(x, k)| x + h * k).collect();
    let to = |psi: &Wave<f64>, h: f64, k: &Wave<f64>| Wave {
        q: along(&psi.q, h, &k.q),
        p: along(&psi.p, h, &k.p),
        ..psi.clone()
    };
    let (steps, mut psi) = (4000, start());
    let h = (T1 - T0) / f64::from(steps);
    for n in 0..steps {
        let t = T0 + f64::from(n) * h;
        let k1 = field(t, &psi);
        let k2 = field(t + h / 2.0, &to(&psi, h / 2.0, &k1));
        let k3 = field(t + h / 2.0, &to(&psi, h / 2.0, &k2));
        let k4 = field(t + h, &to(&psi, h, &k3));
        for (k, part) in [
            (&k1, h / 6.0),
            (&k2, h / 3.0),
            (&k3, h / 3.0),
            (&k4, h / 6.0),
        ] {
            psi = to(&psi, part, k);
        }
    }
    psi
}

fn walk<S: Stored>(
    method: &mut Magnus<S>,
    mut psi: Wave<S>,
    t: f64,
    h: f64,
    steps: u32,
) -> Wave<S> {
    for n in 0..steps {
        method
            .step(t + f64::from(n) * h, h, &mut psi)
            .expect("a step");
    }
    method.synchronize(&mut psi).expect("a state to look at");
    psi
}

#[test]
fn orders_in_a_field_that_depends_on_time() {
    let wanted = reference();
    for (nodes, order, steps) in [
        (nodes(2, 1), 2.0, 64),
        (nodes(4, 2), 4.0, 64),
        (nodes(4, 3), 4.0, 64),
        (nodes(6, 5), 6.0, 8),
        (nodes(8, 8), 8.0, 4),
    ] {
        let error = |steps: u32| {
            let h = (T1 - T0) / f64::from(steps);
            distance(
                &walk(&mut magnus(nodes.clone()), start(), T0, h, steps),
                &wanted,
            )
        };
        let (coarse, fine) = (error(steps), error(2 * steps));
        let seen = (coarse / fine).log2();
        // few steps for order 8, as twice as many have errors of roundoff
        let room = [0.1, 0.5, 1.1][usize::from(steps < 64) + usize::from(steps < 8)];
        assert!((seen - order).abs() < room, "{seen}: {coarse:e} {fine:e}");
    }
}

/// Coefficients of words in letters of weights 1, 2, ..., up to a weight.
type Words = BTreeMap<Vec<usize>, f64>;

fn times(a: &Words, b: &Words, weight: usize) -> Words {
    let mut found = Words::new();
    for (u, x) in a {
        for (v, y) in b {
            let word: Vec<usize> = u.iter().chain(v).copied().collect();
            if word.iter().sum::<usize>() <= weight {
                *found.entry(word).or_default() += x * y;
            }
        }
    }
    found
}

/// P_{n−1}(2s − 1) in powers of s.
fn legendre(n: usize) -> Vec<f64> {
    let (mut before, mut now) = (vec![0.0], vec![1.0]);
    for k in 1..n {
        let m = k as f64;
        let mut next = vec![0.0; k + 1];
        for (power, x) in now.iter().enumerate() {
            next[power + 1] += 2.0 * (2.0 * m - 1.0) / m * x;
            next[power] -= (2.0 * m - 1.0) / m * x;
        }
        for (power, x) in before.iter().enumerate() {
            next[power] -= (m - 1.0) / m * x;
        }
        before = std::mem::replace(&mut now, next);
    }
    now
}

/// All words of the flow of U' = Σ A_n P_{n−1}(2s − 1) U, as polynomials of s.
fn flow(weight: usize) -> BTreeMap<Vec<usize>, Vec<f64>> {
    let mut found = BTreeMap::from([(vec![], vec![1.0])]);
    for size in 1..=weight {
        for n in 1..=size {
            let shorter: Vec<_> = found
                .iter()
                .filter(|(word, _)| word.iter().sum::<usize>() == size - n)
                .map(|(word, s)| (word.clone(), s.clone()))
                .collect();
            for (word, s) in shorter {
                let p = legendre(n);
                let mut integral = vec![0.0; p.len() + s.len()];
                for (i, x) in p.iter().enumerate() {
                    for (j, y) in s.iter().enumerate() {
                        integral[i + j + 1] += x * y / (i + j + 1) as f64;
                    }
                }
                found.insert([vec![n], word].concat(), integral);
            }
        }
    }
    found
}

#[test]
fn coefficients_satisfy_every_order_condition() {
    for (order, exponentials) in [(2, 1), (4, 2), (4, 3), (6, 5), (8, 8)] {
        let Nodes { nodes, rows, .. } = nodes(order, exponentials);
        let mut product = Words::from([(vec![], 1.0)]);
        for row in &rows {
            let letter = |n: usize| {
                let p = legendre(n);
                let at = |c: f64| p.iter().rev().fold(0.0, |sum, x| sum * c + x);
                let sum: f64 = row.iter().zip(&nodes).map(|(a, c)| a * at(*c)).sum();
                (vec![n], sum)
            };
            let exponent: Words = (1..=order).map(letter).collect();
            let (mut power, mut exponential) = (Words::from([(vec![], 1.0)]), Words::new());
            for k in 0..=order {
                for (word, x) in &power {
                    *exponential.entry(word.clone()).or_default() += x;
                }
                power = times(&power, &exponent, order);
                for x in power.values_mut() {
                    *x /= (k + 1) as f64;
                }
            }
            // later factors are on the left
            product = times(&exponential, &product, order);
        }
        for (word, integral) in flow(order) {
            let exact: f64 = integral.iter().sum();
            let off = (product.get(&word).unwrap_or(&0.0) - exact).abs();
            // values of P_7 in powers lose three digits
            assert!(off < 1e-12, "order {order}, word {word:?}: {off:e}");
        }
    }
}

#[test]
fn steps_back_undo_steps() {
    for nodes in [
        nodes(2, 1),
        nodes(4, 2),
        nodes(4, 3),
        nodes(6, 5),
        nodes(8, 8),
    ] {
        let mut method = magnus(nodes);
        let there = walk(&mut method, start(), T0, 0.1, 20);
        let back = walk(&mut method, there, T0 + 2.0, -0.1, 20);
        let error = distance(&back, &start());
        assert!(error < 1e-12, "{error:e}");
    }
}

#[test]
fn a_hamiltonian_at_rest_needs_no_small_steps() {
    let n = 4;
    let values: Vec<f64> = (0..n).map(f64::from).collect();
    let sweeper = Sweeper::new(Arc::new(Hamiltonian::new(vec![diagonal(&values)])));
    let exponential = ShearProgram {
        program: flows("SS10s35"),
        theta: 0.2,
        tolerance: 1e-10,
    };
    let mut method = Magnus::new(sweeper, nodes(4, 3), exponential, of_parts(&[(0.0, 3.0)]));
    let psi = walk(
        &mut method,
        Wave::new(vec![0.5; 4], vec![0.0; 4]),
        0.0,
        7.0,
        1,
    );
    let (q, p) = values
        .iter()
        .map(|e| (0.5 * (7.0 * e).cos(), -0.5 * (7.0 * e).sin()))
        .unzip();
    let error = distance(&psi, &Wave::new(q, p));
    assert!(error < 1e-12, "{error:e}");
}

#[test]
fn states_side_by_side_have_the_bits_of_each_alone() {
    let splat = |x: &[f64]| -> Vec<Lanes<8>> { x.iter().map(|x| Lanes::splat(*x)).collect() };
    let (q, mut p) = (splat(&start().q), splat(&start().p));
    p[1].set_member(3, 0.7);
    let together = Wave::new(q, p);
    let alone = {
        let Wave { q, mut p, .. } = start();
        p[1] = 0.7;
        Wave::new(q, p)
    };
    let together = walk(&mut magnus(nodes(4, 3)), together, T0, 0.1, 5);
    for (member, psi) in [(0, start()), (3, alone)] {
        let psi = walk(&mut magnus(nodes(4, 3)), psi, T0, 0.1, 5);
        let pairs = psi
            .q
            .iter()
            .zip(&together.q)
            .chain(psi.p.iter().zip(&together.p));
        let same = |(a, b): (&f64, &Lanes<8>)| a.to_bits() == b.member(member).to_bits();
        assert!(pairs.into_iter().all(same), "member {member}");
    }
}

#[test]
fn a_spectrum_without_bounds_is_refused_and_the_state_is_lost() {
    let exponential = ShearProgram {
        program: flows("S2"),
        theta: 0.5,
        tolerance: 1e-10,
    };
    let bounds = of_parts(&[(-2.0, 2.0), (-1.0, f64::INFINITY)]);
    let mut method = Magnus::new(Sweeper::new(driven()), nodes(4, 3), exponential, bounds);
    let mut psi = start();
    let outcome = method.step(0.0, 0.1, &mut psi);
    assert!(
        matches!(outcome, Err(StepError::Spectrum { .. })),
        "{outcome:?}"
    );
    assert!(method.synchronize(&mut psi).is_err());
}

#[test]
fn an_energy_is_that_of_its_time() {
    let observables = vec![Observable::Symmetric(driven())];
    let mut observer = Observer::new(1, false, observables);
    let psi = Wave::new(
        vec![0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        vec![0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    for t in [0.0, 0.7] {
        let mut row = Vec::new();
        observer.observe(t, &psi, &mut row).expect("a record");
        let site = |x: f64| (3.0 * t).cos() * x + (2.0 * x - t).sin();
        let wanted = 0.36 * site(-1.0) + 0.64 * site(-0.75);
        assert!((row[1] - wanted).abs() < 1e-15, "{} {wanted}", row[1]);
    }
}
