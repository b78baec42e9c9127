//! Chebyshev series: their coefficients, their errors, their costs, and bounds that are wrong. One file, since nearly
//! all step one chain with the same helpers.

use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::Stored;
use liouville_tests::waves::{
    Parts, anyhow, at_site, chain, chain_after, distance, edge, ring, ring_after,
};
use liouville_waves::method::bessel::{bessel, degree, series};
use liouville_waves::method::{Chebyshev, Sweeper, Wave, Windows};
use liouville_waves::problem::Hamiltonian;
use std::f64::consts::PI;
use std::sync::Arc;

/// (x, k, J_k(x)) in 20 digits: mpmath's besselj at 40 digits; from x = 10⁴ on the recurrence backwards
/// in 50 digits from k = 12000 and 1006000.
#[rustfmt::skip]
#[allow(clippy::excessive_precision, clippy::unreadable_literal)] // digits as they were printed
const BESSEL: &[(f64, usize, f64)] = &[
    (1e-6, 0, 0.99999999999975), (1e-6, 1, 4.9999999999993747737e-7), (1e-6, 3, 2.0833333333332028422e-20),
    (0.5, 0, 0.93846980724081290423), (0.5, 5, 8.053627241357474086e-6),
    (1.0, 1, 0.44005058574493351596), (1.0, 10, 2.630615123687453207e-10),
    (2.5, 0, -0.048383776468197996327), (2.5, 3, 0.21660039103911352477),
    (10.0, 1, 0.04347274616886143667), (10.0, 10, 0.2074861066333588577), (10.0, 30, 1.5510960782574670069e-12),
    (100.0, 0, 0.019985850304223122424), (100.0, 50, -0.038698339728525383467),
    (100.0, 99, 0.11524392532303779883), (100.0, 124, 8.073660626739589948e-7), (100.0, 150, 2.7229021718820480749e-16),
    (1e3, 7, -0.0053217830764436153538), (1e3, 500, -0.019033209321675450179),
    (1e3, 999, 0.048830228770221781319), (1e3, 1050, 6.0113443126943295966e-7),
    (1e4, 0, -0.0070961603533888014773), (1e4, 5000, 0.0056254556975457295692),
    (1e4, 10000, 0.020762165277200784504), (1e4, 10100, 8.502383831161799138e-7),
    (1e6, 0, 0.00033104301373987374099), (1e6, 123_456, 0.000068027268627945604365),
    (1e6, 500_000, 0.000083486412914364965226), (1e6, 999_990, 0.0048823706256747007542),
    (1e6, 1_000_000, 0.004473073183377774297), (1e6, 1_000_500, 5.8937878343328887313e-8),
];

#[test]
fn bessel_functions_are_right_to_rounding_errors() {
    for &(x, k, exact) in BESSEL {
        let values = bessel(x);
        let largest = values
            .iter()
            .fold(0.0_f64, |most, value| most.max(value.abs()));
        let error = (values[k] - exact).abs() / largest / f64::EPSILON;
        assert!(error < 4.0, "J_{k}({x}): {error} ε of the largest");
    }
}

#[test]
fn bessel_functions_satisfy_their_sums() {
    for x in [1e-30, 1e-6, 0.3, 7.0, 123.4, 5e4] {
        let values = bessel(x);
        let squares: f64 = values[1..].iter().map(|value| value * value).sum();
        assert!((values[0].powi(2) + 2.0 * squares - 1.0).abs() < 1e-14);
        let even: f64 = values[2..].iter().step_by(2).sum();
        assert!((values[0] + 2.0 * even - 1.0).abs() < 1e-13, "{x}");
    }
    assert_eq!(bessel(0.0)[..2], [1.0, 0.0]);
}

#[test]
fn a_degree_is_the_least_that_leaves_the_tolerance() {
    for theta in [1e-3, 1.0, 30.0, 1000.0] {
        for tolerance in [1e-2, 1e-6, 1e-12] {
            let m = degree(theta, tolerance);
            let tail = |from: usize| -> f64 {
                bessel(theta)
                    .iter()
                    .skip(from)
                    .map(|value| 2.0 * value.abs())
                    .sum()
            };
            assert!(tail(m + 1) <= tolerance);
            assert!(m == 1 || tail(m) > tolerance);
            let mut backward = series(-theta, tolerance);
            for c in backward.iter_mut().skip(1).step_by(2) {
                *c = -*c;
            }
            assert_eq!(backward, series(theta, tolerance));
        }
    }
}

fn wave((q, p): &Parts) -> Wave<f64> {
    Wave::new(q.clone(), p.clone())
}

fn stepper(hamiltonian: &Arc<Hamiltonian>, bounds: (f64, f64), rate: f64) -> Chebyshev<f64> {
    let sweeper = Sweeper::new(hamiltonian.clone());
    Chebyshev::new(sweeper, bounds, rate, (1e3 * rate).max(1e-10))
}

/// ψ_j(10) on a chain of 50 from site 25, j from 1, summed in 40 digits.
#[allow(clippy::excessive_precision, clippy::unreadable_literal)] // digits as they were printed
const HOPPING: [(usize, f64, f64); 6] = [
    (1, 0.024452914481425112298, 0.0),
    (10, 0.0, 0.00081260483925030351563),
    (20, 0.0, 0.15116976798149382997),
    (25, 0.16702466434058358168, 0.0),
    (30, 0.0, 0.15116976798244091135),
    (44, 0.0, -0.21886719276425369212),
];

#[test]
fn a_chain_is_as_published() {
    let mut state = wave(&at_site(50, 24));
    let mut chebyshev = stepper(&chain(50, 0.0), (-edge(50), edge(50)), 1e-15);
    chebyshev.step(0.0, 10.0, &mut state).expect("a step");
    for (j, re, im) in HOPPING {
        let error = (state.q[j - 1] - re).hypot(state.p[j - 1] - im);
        assert!(error < 1e-14, "site {j}: {error}");
    }
}

#[test]
fn tolerances_hold_and_products_are_as_many_as_the_degree() {
    let (n, potential) = (60, 0.7);
    let (low, high) = (potential - edge(n), potential + edge(n));
    let hamiltonian = chain(n, potential);
    for theta in [1.0, 10.0, 100.0, 1000.0] {
        for tolerance in [1e-3, 1e-6, 1e-9, 1e-12] {
            let t = theta / edge(n);
            for (start, parts) in [(anyhow(n), 2), (at_site(n, 7), 1)] {
                let mut chebyshev = stepper(&hamiltonian, (low, high), tolerance / t);
                let mut state = wave(&start);
                chebyshev.step(0.0, t, &mut state).expect("a step");
                let error = distance(&state, &chain_after(potential, t, &start));
                assert!(error < tolerance, "{theta} {tolerance}: {error}");
                let beta = 0.5 * (high - low);
                let products = parts * degree(beta * t, tolerance / t * t);
                assert_eq!(chebyshev.stats().evaluations, products);
            }
        }
    }
}

#[test]
fn a_series_of_many_terms_is_as_exact_as_the_phases() {
    let (n, theta) = (30, 1e5);
    let t = theta / edge(n);
    let mut chebyshev = stepper(&chain(n, 0.0), (-edge(n), edge(n)), 1e-9 / t);
    let mut state = wave(&anyhow(n));
    chebyshev.step(0.0, t, &mut state).expect("a step");
    let error = distance(&state, &chain_after(0.0, t, &anyhow(n)));
    assert!(error < 1e-9, "{error}");
}

#[test]
fn what_is_allowed_in_a_step_is_rate_times_its_length() {
    let n = 40;
    let mut chebyshev = stepper(&chain(n, 0.0), (-edge(n), edge(n)), 1e-5);
    let mut state = wave(&anyhow(n));
    let mut products = 0;
    let mut t = 0.0;
    for k in 1..=30 {
        let h = [0.3, 1.1, 4.0][k % 3];
        chebyshev.step(t, h, &mut state).expect("a step");
        products += 2 * degree(edge(n) * h, 1e-5 * h);
        t += h;
    }
    assert_eq!(chebyshev.stats().evaluations, products);
    let error = distance(&state, &chain_after(0.0, t, &anyhow(n)));
    assert!(error < 1e-5 * t && error > 1e-9, "{error}");
}

#[test]
fn a_step_back_undoes_a_step() {
    let n = 50;
    for start in [anyhow(n), at_site(n, 20)] {
        let mut chebyshev = stepper(&chain(n, 0.3), (0.3 - edge(n), 0.3 + edge(n)), 1e-15);
        let mut state = wave(&start);
        chebyshev.step(0.0, 17.0, &mut state).expect("a step");
        assert!(distance(&state, &start) > 0.1);
        chebyshev.step(17.0, -17.0, &mut state).expect("a step");
        let error = distance(&state, &start);
        assert!(error < 1e-13, "{error}");
    }
}

#[test]
fn a_ring_with_a_flux_through_it_is_exact_too() {
    let (n, theta) = (30, 0.21);
    let (tolerance, t) = (1e-9, 12.5);
    for start in [anyhow(n), at_site(n, 3)] {
        let mut chebyshev = stepper(&ring(n, theta), (-2.0, 2.0), tolerance / t);
        let mut state = wave(&start);
        for k in 0..2 {
            chebyshev
                .step(0.5 * t * f64::from(k), 0.5 * t, &mut state)
                .expect("a step");
        }
        let error = distance(&state, &ring_after(theta, t, &start));
        assert!(error < tolerance, "{error}");
        // each product is with a complex vector
        assert_eq!(
            chebyshev.stats().evaluations,
            2 * 2 * degree(t, 0.5 * tolerance)
        );
    }
}

/// The error of a step with wrong bounds in units of the tolerance, and how often it was begun again.
fn with_bounds(bounds: (f64, f64), theta: f64, tolerance: f64, start: &Parts) -> (f64, usize) {
    let n = start.0.len();
    let t = theta / edge(n);
    // the norm is free, so that the terms alone must tell
    let sweeper = Sweeper::new(chain(n, 0.0));
    let mut chebyshev = Chebyshev::new(sweeper, bounds, tolerance / t, 1.0);
    let mut state = wave(start);
    chebyshev.step(0.0, t, &mut state).expect("a step");
    let error = distance(&state, &chain_after(0.0, t, start)) / tolerance;
    (error, chebyshev.stats().cold_starts)
}

#[test]
fn bounds_that_are_too_narrow_are_never_silently_wrong() {
    let n = 60;
    let mode = |k: usize| {
        let angle = PI * k as f64 / (n as f64 + 1.0);
        (1..=n).map(move |i| (2.0 / (n as f64 + 1.0)).sqrt() * (angle * i as f64).sin())
    };
    // hardly any of it is outside
    let hidden = |amount: f64| -> Parts {
        let q = mode(n / 2)
            .zip(mode(n))
            .map(|(inside, outside)| inside + amount * outside);
        (q.collect(), vec![0.0; n])
    };
    let starts = [
        anyhow(n),
        at_site(n, 30),
        hidden(1e-2),
        hidden(1e-5),
        hidden(1e-8),
    ];
    let (mut made, mut again) = (0, 0);
    for narrow in [1e-5, 1e-3, 0.01, 0.03, 0.1, 0.3, 0.9] {
        let (whole, less) = (edge(n), (1.0 - narrow) * edge(n));
        for bounds in [(-whole, less), (-less, whole), (-less, less)] {
            for theta in [0.1, 1.0, 10.0, 100.0, 1000.0] {
                for tolerance in [1e-3, 1e-6, 1e-9, 1e-12] {
                    for start in &starts {
                        let (error, times) = with_bounds(bounds, theta, tolerance, start);
                        made += usize::from(times == 0);
                        again += usize::from(times > 0);
                        assert!(times <= 8, "{times}");
                        // with bounds of a tenth, what hides is worth a few tolerances
                        let most = if narrow > 0.5 { 5.0 } else { 1.0 };
                        let rounding = 1e-16 * theta / tolerance;
                        let at = (narrow, theta, tolerance);
                        assert!(error < most + rounding, "{at:?}: {error}");
                    }
                }
            }
        }
    }
    assert!(
        made > 500 && again > 500,
        "{made} made, {again} begun again"
    );
}

/// The states of a run at outputs in these windows, and the real products that it took.
fn outputs<S: Stored>(
    chebyshev: Chebyshev<S>,
    state: &Wave<S>,
    (times, counts): (&[f64], Vec<usize>),
) -> (Vec<Wave<S>>, usize) {
    let windows = Windows::new(counts)
        .of(times.to_vec())
        .expect("windows of all outputs");
    let mut chebyshev = chebyshev.with_windows(windows);
    let (mut state, mut t) = (state.clone(), 0.0);
    let mut found = Vec::new();
    for &time in times {
        chebyshev.step(t, time - t, &mut state).expect("a step");
        found.push(state.clone());
        t = time;
    }
    (found, chebyshev.stats().evaluations)
}

#[test]
fn all_outputs_of_a_window_are_within_the_tolerance_and_take_the_products_of_its_end() {
    let (n, tolerance) = (60, 1e-9);
    for back in [1.0, -1.0] {
        let times: Vec<f64> = [0.0, 0.1, 0.11, 3.0, 7.0, 20.0, 20.5, 41.0, 50.0]
            .map(|t| back * t)
            .to_vec();
        for counts in [vec![9], vec![4, 5], vec![1, 6, 1, 1]] {
            for (start, parts) in [(anyhow(n), 2), (at_site(n, 7), 1)] {
                let edge = edge(n);
                let sweeper = Sweeper::new(chain(n, 0.0));
                let chebyshev = Chebyshev::new(sweeper, (-edge, edge), tolerance / 50.0, 1e-6);
                let given = (&times[..], counts.clone());
                let (found, products) = outputs(chebyshev, &wave(&start), given);
                for (state, t) in found.iter().zip(&times) {
                    let error = distance(state, &chain_after(0.0, *t, &start));
                    assert!(error < tolerance, "{t}: {error}");
                }
                let (mut first, mut end, mut wanted, mut parts) = (0.0, 0, 0, parts);
                for count in &counts {
                    end += count;
                    let length: f64 = times[end - 1] - first;
                    let rate = tolerance / 50.0;
                    wanted += parts * degree(edge * length, rate * length.abs());
                    (first, parts) = (times[end - 1], if length == 0.0 { parts } else { 2 });
                }
                assert_eq!(products, wanted, "{counts:?}");
            }
        }
    }
}

#[test]
fn windows_of_a_ring_with_a_flux_are_exact_too() {
    let (n, theta, tolerance) = (30, 0.21, 1e-9);
    let times = [0.7, 5.0, 5.5, 12.5];
    for counts in [vec![4], vec![3, 1]] {
        let sweeper = Sweeper::new(ring(n, theta));
        let series = Chebyshev::new(sweeper, (-2.0, 2.0), tolerance / 12.5, 1e-6);
        let start = anyhow(n);
        let (found, _) = outputs(series, &wave(&start), (&times, counts));
        for (state, t) in found.iter().zip(times) {
            let error = distance(state, &ring_after(theta, t, &start));
            assert!(error < tolerance, "{t}: {error}");
        }
    }
}

#[test]
fn bounds_are_widened_in_a_window_of_several_outputs_too() {
    let n = 60;
    let sweeper = Sweeper::new(chain(n, 0.0));
    let series = Chebyshev::new(sweeper, (-0.97 * edge(n), edge(n)), 1e-9 / 20.0, 1e-6);
    let (found, _) = outputs(series, &wave(&anyhow(n)), (&[1.0, 10.0, 20.0], vec![2, 1]));
    for (state, t) in found.iter().zip([1.0, 10.0, 20.0]) {
        assert!(distance(state, &chain_after(0.0, t, &anyhow(n))) < 1e-9);
    }
}

#[test]
fn windows_do_not_depend_on_threads() {
    let n = 40_000;
    let times = [0.5, 0.7, 2.0];
    let run = |threads: usize| {
        let sweeper = Sweeper::new(chain(n, 0.0)).with_threads(threads);
        let series = Chebyshev::new(sweeper.with_blocking(3000, 4), (-2.0, 2.0), 1e-9, 1e-6);
        outputs(series, &wave(&anyhow(n)), (&times, vec![3])).0
    };
    let alone = run(1);
    assert!(run(2) == alone && run(3) == alone);
}

#[test]
fn wave_functions_side_by_side_are_as_alone() {
    let n = 33;
    let hamiltonian = chain(n, 0.1);
    let bounds = (0.1 - edge(n), 0.1 + edge(n));
    let starts: Vec<Parts> = (0..8)
        .map(|k| if k == 5 { anyhow(n) } else { at_site(n, 4 * k) })
        .collect();
    let part = |of: fn(&Parts) -> &Vec<f64>| -> Vec<Lanes> {
        (0..n)
            .map(|i| Lanes(std::array::from_fn(|k| of(&starts[k])[i])))
            .collect()
    };
    let together = Wave::new(part(|parts| &parts.0), part(|parts| &parts.1));
    let sweeper = Sweeper::<Lanes>::new(hamiltonian.clone());
    let given: (&[f64], _) = (&[2.0, 5.0, 6.0], vec![2, 1]);
    let chebyshev = Chebyshev::new(sweeper, bounds, 1e-9, 1e-6);
    let (found, products) = outputs(chebyshev, &together, given.clone());
    assert_eq!(
        products,
        2 * (degree(5.0 * edge(n), 5e-9) + degree(edge(n), 1e-9)),
        "of each member"
    );
    for (k, start) in starts.iter().enumerate() {
        let (alone, _) = outputs(
            stepper(&hamiltonian, bounds, 1e-9),
            &wave(start),
            given.clone(),
        );
        let member = |x: &[Lanes]| -> Vec<f64> { x.iter().map(|x| x.member(k)).collect() };
        for (together, alone) in found.iter().zip(&alone) {
            assert_eq!(
                (member(&together.q), member(&together.p)),
                (alone.q.clone(), alone.p.clone())
            );
        }
    }
}

#[test]
fn a_spectrum_of_one_number_only_turns() {
    let hamiltonian = liouville_tests::waves::sparse(3, &[(0, 0, 2.5), (1, 1, 2.5), (2, 2, 2.5)]);
    let mut state = wave(&anyhow(3));
    stepper(&hamiltonian, (2.5, 2.5), 1e-9)
        .step(0.0, 1.2, &mut state)
        .expect("a step");
    let (sin, cos) = 3.0_f64.sin_cos();
    let (q, p) = anyhow(3);
    let turned = |sign: f64, x: &[f64], y: &[f64]| -> Vec<f64> {
        x.iter()
            .zip(y)
            .map(|(x, y)| x * cos + sign * y * sin)
            .collect()
    };
    let exact = (turned(1.0, &q, &p), turned(-1.0, &p, &q));
    assert!(distance(&state, &exact) < 1e-14);
    // and bounds that leave it out are found to be wrong
    let mut state = wave(&anyhow(3));
    let mut narrow = stepper(&hamiltonian, (2.4, 2.4), 1e-9);
    narrow.step(0.0, 1.2, &mut state).expect("a step");
    assert!(distance(&state, &exact) < 1e-9 && narrow.stats().cold_starts > 0);
}
