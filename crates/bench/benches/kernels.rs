//! Times of the parts of a step: tape evaluation, small factorisations, one step of each method.
//!
//! Throughputs count instructions of a tape, and for lanes instructions times trajectories.

use criterion::measurement::WallTime;
use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main,
};
use liouville_base::composition::Composed;
use liouville_base::linalg::{Factor, Lu, Pattern, Rows};
use liouville_base::method::Stepper;
use liouville_base::real::{Lanes, Real, WIDTH};
use liouville_base::simd::Stored;
use liouville_base::tableau::Scheme;
use liouville_base::tape::{Line, Op, Tape};
use liouville_fields::problem::{Piece, Split};
use liouville_fields::volume::Volume;
use liouville_problem::Model;
use liouville_spark::{Solver, Spark};
use liouville_waves::method::{Move, Sink, Sweeper};
use liouville_waves::problem::{Diagonals, Hamiltonian, Operator, Update};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

const SLOTS: usize = 24;
const INPUTS: usize = 16;

/// A program over 24 slots: each pair of instructions makes a slot the half of its sum or difference
/// with another; every `rare`-th time of its sine or cosine. Nothing is computed in vain.
fn program(pairs: usize, rare: usize) -> Tape {
    const HALF: usize = SLOTS;
    let mut lines: Vec<Line> = (0..SLOTS)
        .map(|slot| Line::Input {
            slot,
            group: 0,
            element: slot % INPUTS,
        })
        .collect();
    lines.push(Line::Constant {
        slot: HALF,
        value: 0.5,
    });
    let mut random = 1_usize;
    let mut draw = |most: usize| {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (random >> 40) % most
    };
    for k in 0..pairs {
        let (slot, other, choice) = (draw(SLOTS), draw(SLOTS), draw(2));
        let op = if k % rare == rare - 1 {
            [Op::Sin, Op::Cos][choice]
        } else {
            [Op::Add, Op::Sub][choice]
        };
        lines.push(Line::Apply {
            op,
            slot,
            a: slot,
            b: other,
        });
        lines.push(Line::Apply {
            op: Op::Mul,
            slot,
            a: slot,
            b: HALF,
        });
    }
    lines.extend((0..SLOTS).map(|slot| Line::Output {
        element: slot,
        slot,
    }));
    Tape::new(&[INPUTS, 0], SLOTS, &lines).expect("a valid program")
}

/// For each of many links the square of the distance from the link before in space, and its derivatives.
fn chain(links: usize) -> Tape {
    let mut lines = Vec::new();
    for link in 0..links {
        let input = |slot, place| Line::Input {
            slot,
            group: 0,
            element: 3 * place + slot % 3,
        };
        let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
        let output = |k, slot| Line::Output {
            element: 4 * link + k,
            slot,
        };
        for k in 0..3 {
            lines.extend([
                input(k, link),
                input(k + 3, link.saturating_sub(1)),
                apply(Op::Sub, k, k, k + 3),
                apply(Op::Twice, k + 3, k, k),
                output(k + 1, k + 3),
                apply(Op::Sq, k, k, k),
            ]);
        }
        lines.extend([
            apply(Op::Add, 0, 0, 1),
            apply(Op::Add, 0, 0, 2),
            output(0, 0),
        ]);
    }
    Tape::new(&[3 * links, 0], 4 * links, &lines).expect("a valid program")
}

fn evaluate<R: Real>(c: &mut Criterion, scalar: &str, width: usize) {
    let mut group = c.benchmark_group(format!("tape/{scalar}"));
    for (name, tape) in [
        ("arithmetic", program(300, usize::MAX)),
        ("one in eight sines", program(300, 4)),
        ("chain of 10", chain(10)),
        ("chain of 1000", chain(1000)),
    ] {
        let mut registers = tape.bind::<R>(&[]);
        let inputs = 0..tape.inputs()[0];
        let mut x: Vec<R> = inputs.map(|k| R::splat(1.0 + 0.1 * k as f64)).collect();
        group.throughput(Throughput::Elements((tape.len() * width) as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                x[0] = tape.eval(&mut registers, [black_box(&x)])[5];
            });
        });
    }
    group.finish();
}

fn tapes(c: &mut Criterion) {
    evaluate::<f64>(c, "f64", 1);
    evaluate::<Lanes>(c, "lanes", WIDTH);
}

fn factors(c: &mut Criterion) {
    let mut group = c.benchmark_group("factor and solve");
    for n in [3_u8, 6, 12, 24] {
        let order = usize::from(n);
        let mut lu = Lu::new(order);
        let entry =
            |i: u8, j: u8| f64::from((7 * i + 3 * j) % 11) + f64::from(u8::from(i == j)) * 9.0;
        let matrix: Vec<f64> = (0..n)
            .flat_map(|i| (0..n).map(move |j| entry(i, j)))
            .collect();
        let mut x = vec![1.0; order];
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| {
                lu.matrix_mut()
                    .flat_mut()
                    .copy_from_slice(black_box(&matrix));
                x.fill(1.0);
                let regular = lu.factor().is_ok();
                lu.solve(&mut x);
                (regular, x[0])
            });
        });
    }
    group.finish();
}

/// The saddle-point matrix of a chain in the plane, with a diagonal mass.
fn sparse_factors(c: &mut Criterion) {
    let mut group = c.benchmark_group("sparse factor and solve");
    for links in [30_usize, 300, 3000] {
        let (n, order) = (2 * links, 3 * links);
        let mut entries: Vec<(usize, usize)> = (0..n).map(|i| (i, i)).collect();
        for k in 0..links {
            let of_link = (2 * k).saturating_sub(2)..2 * k + 2;
            entries.extend(of_link.flat_map(|i| [(n + k, i), (i, n + k)]));
        }
        let value = |(i, j): &(usize, usize)| 1.0 + 0.1 * ((7 * i + 3 * j) % 11) as f64;
        let values: Vec<f64> = entries.iter().map(value).collect();
        let Ok(pattern) = Pattern::new(order, order, entries) else {
            unreachable!("entries lie inside")
        };
        let mut factor = Factor::new(&pattern);
        let mut x = vec![1.0; order];
        group.throughput(Throughput::Elements(order as u64));
        group.bench_function(BenchmarkId::from_parameter(order), |b| {
            b.iter(|| {
                x.fill(1.0);
                let regular = factor.factor(&pattern, black_box(&values)).is_ok();
                factor.solve(&mut x);
                (regular, x[0])
            });
        });
    }
    group.finish();
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("pendulum step");
    for s in 1..=4 {
        let mut model = Model::new(
            liouville_tests::pendulum().build(),
            &liouville_tests::PENDULUM,
        );
        let mut state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
        let mut spark = Spark::new(model, s, Solver::Auto);
        group.bench_function(BenchmarkId::new("spark", s), |b| {
            b.iter(|| {
                let made = spark.step(0.0, black_box(0.01), &mut state);
                assert!(made.is_ok(), "{made:?}");
            });
        });
    }
    group.finish();
}

/// x' = z − 8 x y, y' = 11 x² + 3 y² + z² + 0.3 x z − 3, z' = −x + 2 y z − 0.3 x y, a stretching,
/// twisting and folding flow: an exponential piece and three natural ones.
fn folding() -> Split {
    let natural = |row: usize, terms: &[(usize, f64, Vec<usize>)]| Piece::Natural {
        rows: vec![row],
        change: liouville_tests::splits::polynomials(1, 3, terms),
        functions: Vec::new(),
    };
    let growth = Piece::Exponential {
        rows: vec![0, 1, 2],
        rates: vec![-8.0, 3.0, 2.0],
        monomial: vec![1],
        functions: Vec::new(),
    };
    let quadratic = [
        (0, 11.0, vec![0, 0]),
        (0, 1.0, vec![2, 2]),
        (0, 0.3, vec![0, 2]),
        (0, -3.0, vec![]),
    ];
    let pieces = vec![
        growth,
        natural(0, &[(0, 1.0, vec![2])]),
        natural(2, &[(0, -1.0, vec![0]), (0, -0.3, vec![0, 1])]),
        natural(1, &quadratic),
    ];
    let Ok(split) = Split::new(3, pieces) else {
        unreachable!("proper pieces")
    };
    split
}

fn composed<S: Stored>(group: &mut Group<'_>, name: &str, split: &Arc<Split>, scheme: &str) {
    let n = split.n();
    let volume = Volume::<S>::new(Arc::clone(split), false);
    let x: Vec<S> = (0..n).map(|k| S::splat((k as f64).sin())).collect();
    let mut state = volume.state(&x);
    let Some(scheme) = Scheme::named(scheme) else {
        unreachable!("a scheme of this name")
    };
    let mut stepper = Composed::new(volume, scheme);
    group.throughput(Throughput::Elements((S::MEMBERS * n) as u64));
    group.bench_function(name, |b| {
        b.iter(|| {
            let made = stepper.step(0.0, black_box(1e-4), &mut state);
            assert!(made.is_ok(), "{made:?}");
        });
    });
}

/// Throughputs count variables.
fn volume(c: &mut Criterion) {
    let mut group = c.benchmark_group("volume");
    let split = Arc::new(folding());
    composed::<f64>(&mut group, "BM4, one trajectory", &split, "BM4");
    composed::<Lanes<32>>(&mut group, "BM4, 32 trajectories", &split, "BM4");
    composed::<Lanes<128>>(&mut group, "BM4, 128 trajectories", &split, "BM4");
    for n in [10_000, 1_000_000] {
        let split = Arc::new(liouville_tests::splits::lorenz(n, 4));
        composed::<f64>(&mut group, &format!("S2, ring of {n}"), &split, "S2");
    }
    group.finish();
}

/// A particle on a square of side², hopping to its four neighbours, over a rugged ground: the diagonals of H.
fn lattice(side: usize) -> Vec<(usize, Vec<f64>)> {
    let n = side * side;
    let ground = (0..n).map(|i| (i as f64).sin());
    let hops = |k: usize| if k % side == side - 1 { 0.0 } else { -1.0 };
    let across = (0..n - 1).map(hops);
    vec![
        (0, ground.collect()),
        (1, across.collect()),
        (side, vec![-1.0; n - side]),
    ]
}

/// The same matrix by rows.
fn by_rows(n: usize, diagonals: &[(usize, Vec<f64>)]) -> Rows {
    let mut entries = Vec::new();
    for (offset, values) in diagonals {
        for (i, value) in values.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            entries.push((i, i + offset, *value));
            if *offset > 0 {
                entries.push((i + offset, i, *value));
            }
        }
    }
    let row: Vec<usize> = entries.iter().map(|(i, ..)| *i).collect();
    let col: Vec<usize> = entries.iter().map(|(_, j, _)| *j).collect();
    let values: Vec<f64> = entries.iter().map(|(.., value)| *value).collect();
    let Ok(rows) = Rows::new((n, n), &row, &col, &values) else {
        unreachable!("entries lie inside")
    };
    rows
}

/// Shears of q by p and of p by q in turn. Throughputs count rows of one shear.
fn shears(c: &mut Criterion) {
    const MOVES: usize = 24;
    let moves: [Move; MOVES] = std::array::from_fn(|k| {
        let into_second = k % 2 == 1;
        let factor = if into_second { -0.01 } else { 0.01 };
        let update = Update::added(factor);
        Move::new(into_second, update)
    });
    let mut group = c.benchmark_group("shear on a lattice");
    for side in [64, 256, 1024] {
        let n = side * side;
        let diagonals = lattice(side);
        let rows = Operator::Rows(Arc::new(by_rows(n, &diagonals)));
        let diagonals = Operator::Diagonals(Arc::new(Diagonals::new(n, &diagonals)));
        group.throughput(Throughput::Elements((MOVES * n) as u64));
        for (name, operator) in [("rows", rows), ("diagonals", diagonals)] {
            let swept = Sweeper::<f64>::new(Arc::new(Hamiltonian::new(vec![operator])));
            let plain = swept.clone().with_blocking(n, 1);
            for (how, mut sweeper) in [("one by one", plain), ("in sweeps", swept)] {
                let mut q: Vec<f64> = (0..n).map(|i| (0.37 * i as f64).cos()).collect();
                let mut p = vec![0.0; n];
                group.bench_function(BenchmarkId::new(format!("{name}, {how}"), n), |b| {
                    b.iter(|| {
                        let made = sweeper.run(black_box(&moves), &mut q, &mut p, Sink::Nothing);
                        assert!(made.is_ok(), "{made:?}");
                    });
                });
            }
        }
    }
    group.finish();
}

type Group<'a> = BenchmarkGroup<'a, WallTime>;

fn quick() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
}

criterion_group! {
    name = kernels;
    config = quick();
    targets = tapes, factors, sparse_factors, steps, volume, shears
}
criterion_main!(kernels);
