//! The hot loop allocates nothing. This binary counts what the global allocator hands out, which is why every stepper
//! has its test in this one file.

mod controlled;
mod counting;
mod events;

use counting::allocations;
use liouville_alpha::{Alpha, Reactions};
use liouville_base::composition::Composed;
use liouville_base::linalg::{Factor, Matrix, Pattern, Rows};
use liouville_base::method::Tolerance;
use liouville_base::method::{Estimating, Stepper};
use liouville_base::observe::Monitor;
use liouville_base::real::{BATCH, Lanes, Scalar};
use liouville_base::recorder::{Recordable, Recorded, Recorder, SharedRecords, StepRecord};
use liouville_base::tableau;
use liouville_fields::problem::{Piece, Polynomials, Split};
use liouville_fields::volume::{Determinant, Volume};
use liouville_index2::Index2;
use liouville_index2::semi_explicit::SemiExplicitModel;
use liouville_problem::{
    Acceleration, Cotangents, Directions, Model, SecondOrderModel, SensitivityModel,
    SeparableModel, TimeScale,
};
use liouville_spark::rattle::Rattle;
use liouville_spark::{Solver, Spark, SparkAdjoint, SparkBatch, SparkTangents};
use liouville_tests::quantum::{flows, kinetic, packet, rotor};
use liouville_tests::splits::{Draw, every_kind};
use liouville_tests::walk::{START, driven_start, heavy};
use liouville_tests::waves::{anyhow, chain, ring};
use liouville_tests::{
    Expr, FOURTH, Functions, LAM, PENDULUM, T, Y, Z, dot, input, inputs, pendulum, semi_explicit,
    turning,
};
use liouville_waves::method::{
    Arnoldi, Chebyshev, Lanczos, Magnus, MagnusSteps, MagnusTolerance, Nodes, Phases, ShearProgram,
    Shears, Sweeper, TermBounds, Wave,
};
use liouville_waves::problem::{Bond, Dense, Diagonals, Hamiltonian, Operator, Spins};
use std::sync::Arc;

/// Two coupled arms with v ≠ z, a full mass matrix, and a reaction that is nonlinear in λ.
fn general() -> Functions {
    let (y, z) = (inputs(Y, 4), inputs(Z, 4));
    let driven = (input(T, 0) * 0.1).sin();
    let arm = [&y[2] - &y[0], &y[3] - &y[1]];
    let mut functions = Functions {
        v: Some(vec![
            &z[0] + &z[1] * 0.1,
            &z[1] + &z[0] * 0.1,
            z[2].clone(),
            &z[3] + z[3].sin() * 0.1,
        ]),
        p: vec![
            &z[0] + &z[2] * 0.2,
            &z[1] + &y[0] * 0.1,
            &z[2] + &z[0] * 0.2,
            z[3].clone(),
        ],
        f: vec![-&z[0], (-9.81).into(), &driven * &y[1], (-9.81).into()],
        r: None,
        g: vec![
            (dot(&y[..2], &y[..2]) - 1.0) * 0.5,
            (dot(&arm, &arm) - 1.0) * 0.5,
        ],
        params: 0,
    };
    let ideal = functions.ideal_reaction();
    let grown = (input(LAM, 0) * 0.01).sin();
    functions.r = Some(ideal.iter().map(|r| r + &grown * &y[1] * 0.1).collect());
    functions
}

/// Allocations of 50 steps, the first apart: (first, others).
fn steps(
    functions: &Functions,
    params: &[f64],
    y: &[f64],
    s: usize,
    solver: Solver,
) -> (usize, usize) {
    let mut model = Model::new(functions.build(), params);
    let mut state = model.state(0.0, y, &vec![0.0; y.len()]);
    let mut spark = Spark::new(model, s, solver);
    let mut n = 0;
    let mut step = || {
        let t = 0.01 * f64::from(n);
        spark.step(t, 0.01, &mut state).expect("a step can be made");
        n += 1;
    };
    let first = allocations(&mut step);
    (first, allocations(|| (1..50).for_each(|_| step())))
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(Arc::new([0_u8; 100]))), 1);
}

#[test]
fn a_step_takes_no_memory() {
    for solver in [Solver::NodeSchur, Solver::Newton] {
        for s in [1, 3, 6] {
            let plain = steps(&pendulum(), &PENDULUM, &[1.0, 0.0], s, solver);
            assert_eq!(plain.1, 0, "with {solver:?}, s = {s}");
            let general = steps(&general(), &[], &[0.0, -1.0, 1.0, -1.0], s, solver);
            assert_eq!(general.1, 0, "with {solver:?}, s = {s}");
        }
    }
}

/// Allocations of 50 steps with two directions and of following 40 of them back, the first 10 apart.
fn tangents(functions: &Functions, params: &[f64], y: &[f64], solver: Solver) -> [usize; 2] {
    let problem = functions.build();
    let sensitivity = SensitivityModel::new(functions.sensitivity(&problem), params);
    let mut model = Model::new(problem, params);
    let (n, width) = (y.len(), 1 + params.len());
    let state = model.state(0.0, y, &vec![0.0; n]);
    let spark = Spark::new(model, 3, solver);
    let records = SharedRecords::default();
    let mut adjoint = SparkAdjoint::new(&spark, sensitivity.clone());
    let mut recorder = Recorder::new(spark.clone(), records.clone());
    let mut recorded = state.clone();
    let directions = Directions {
        tau: Matrix::from_fn(2, width, |i, j| (i + j) as f64),
        stretch: vec![0.1, 0.0],
    };
    let zeros = || Matrix::zeros(2, n);
    let start = (zeros(), zeros(), vec![0.0; 2]);
    let made = SparkTangents::new(spark, sensitivity, directions, (0.0, state, &[]), start);
    let (mut stepper, mut state) = made.expect("derivatives are finite");
    let mut n_steps = 0;
    let mut forward = |count: usize| {
        for _ in 0..count {
            let t = 0.01 * f64::from(n_steps);
            stepper.step(t, 0.01, &mut state).expect("a step");
            recorder
                .step(t, 0.01, &mut recorded)
                .expect("the same step");
            n_steps += 1;
        }
    };
    forward(10);
    let piece = || records.lock().clear();
    piece();
    let of_steps = allocations(|| {
        for _ in 0..4 {
            forward(10);
            piece();
        }
    });
    forward(10);
    let mut of = Cotangents::zeros([n; 3], width);
    of.y.fill(1.0);
    let steps = records.lock();
    let mut record = StepRecord::like(&recorded);
    let mut follow = |k: usize| {
        steps.read(k, &mut record);
        adjoint.follow(&record, &mut of).expect("a step back");
    };
    follow(9);
    [of_steps, allocations(|| (0..9).rev().for_each(&mut follow))]
}

#[test]
fn steps_with_tangents_and_steps_back_take_no_memory() {
    let [auto, schur] = [Solver::Auto, Solver::NodeSchur];
    assert_eq!(tangents(&pendulum(), &PENDULUM, &[1.0, 0.0], auto), [0; 2]);
    // full Newton, to which roundoff may lead, takes its memory with its first step
    let start = [0.0, -1.0, 1.0, -1.0];
    assert_eq!(tangents(&general(), &[], &start, schur), [0; 2]);
    let (functions, y) = zigzag(60);
    assert_eq!(tangents(&functions, &[], &y, auto), [0; 2]);
}

/// A zigzag of links in the plane, as many as make matrices sparse.
fn zigzag(links: usize) -> (Functions, Vec<f64>) {
    let (y, z) = (inputs(Y, 2 * links), inputs(Z, 2 * links));
    let link = |k: usize| {
        let arm: Vec<Expr> = (2 * k..2 * k + 2)
            .map(|j| {
                if k == 0 {
                    y[j].clone()
                } else {
                    &y[j] - &y[j - 2]
                }
            })
            .collect();
        (dot(&arm, &arm) - 1.0) * 0.5
    };
    let functions = Functions {
        v: None,
        p: (0..2 * links).map(|k| &z[k] + &z[k ^ 1] * 0.1).collect(),
        f: (0..2 * links).map(|k| y[k].sin() * -0.3).collect(),
        r: None,
        g: (0..links).map(link).collect(),
        params: 0,
    };
    let bead = |k: usize| [0.8 * k as f64, 0.6 * (k % 2) as f64];
    (functions, (1..=links).flat_map(bead).collect())
}

#[test]
fn a_step_of_a_large_mechanism_takes_no_memory() {
    let (functions, y) = zigzag(60);
    for s in [1, 2, 4] {
        let found = steps(&functions, &[], &y, s, Solver::NodeSchur);
        assert_eq!(found.1, 0, "s = {s}");
    }
}

/// A pendulum of two arms that hang on each other, with masses that one spring couples, or not.
fn arms(coupling: f64) -> Functions {
    let (y, z) = (inputs(Y, 4), inputs(Z, 4));
    let arm = [&y[2] - &y[0], &y[3] - &y[1]];
    Functions {
        v: None,
        p: vec![
            &z[0] + &z[2] * coupling,
            z[1].clone(),
            &z[2] + &z[0] * coupling,
            z[3].clone(),
        ],
        f: vec![-&y[0], (-9.81).into(), input(T, 0).sin(), (-9.81).into()],
        r: None,
        g: vec![
            (dot(&y[..2], &y[..2]) - 1.0) * 0.5,
            (dot(&arm, &arm) - 1.0) * 0.5,
        ],
        params: 0,
    }
}

#[test]
fn a_step_of_rattle_takes_no_memory() {
    for coupling in [0.0, 0.2] {
        let mut model = SeparableModel::new(arms(coupling).separable(), &[]);
        let y = [0.0, -1.0, 1.0, -1.0];
        let mut state = model.general.state(0.0, &y, &[0.0; 4]);
        let mut rattle = Rattle::new(model).expect("a mass");
        assert_eq!(others(&mut rattle, &mut state), 0, "coupled by {coupling}");
    }
}

#[test]
fn a_step_with_nonholonomic_constraints_takes_no_memory() {
    let (functions, z) = (general(), inputs(Z, 4));
    let (fast, nu) = (dot(&z, &z) - 1.0, input(FOURTH, 0));
    let pushes: Vec<_> = z.iter().map(|z| -(z * &nu)).collect();
    let mut model = Model::new(functions.nonholonomic(&[fast], &pushes), &[]);
    let (y, z) = (
        [0.0, -1.0, 1.0, -1.0],
        [0.5, -0.05, 0.495, -0.502_475_f64.sqrt()],
    );
    let mut acceleration = Acceleration::new(&model);
    for tableau in [
        tableau::Spark::gauss(3),
        tableau::Spark::lobatto(3, tableau::Force::B),
    ] {
        let mut state = model.state(0.0, &y, &z);
        let mut spark = Spark::of(model.clone(), tableau, Solver::Auto);
        let mut n = 0;
        let mut step = || {
            let t = 0.01 * f64::from(n);
            spark.step(t, 0.01, &mut state).expect("a step can be made");
            n += 1;
        };
        step();
        assert_eq!(allocations(|| (1..50).for_each(|_| step())), 0);
        let mut solve = || acceleration.solve(&mut model, 0.5, &state.y, &state.z);
        solve().expect("a solution");
        assert_eq!(allocations(|| drop(solve())), 0);
    }
}

#[test]
fn a_step_of_the_alpha_family_takes_no_memory() {
    let model = SecondOrderModel::new(heavy().second_order(), &[]);
    let hht = tableau::Alpha {
        alpha_m: 0.0,
        alpha_f: 0.1,
        gamma: 0.6,
        beta: 0.3025,
    };
    let extended = |predicted| Reactions::Extended { b: 0.0, predicted };
    let tolerance = Tolerance {
        rtol: 1e-6,
        atol: vec![1e-6; 3],
        longest: 0.01,
    };
    for reactions in [extended(false), extended(true), Reactions::Position] {
        let mut alpha = Alpha::new(model.clone(), hht, reactions, Some(tolerance.clone()));
        let (y, z) = driven_start();
        let mut state = alpha.start(START, &y, &z, None).expect("a start");
        let mut t = START;
        let mut step = |h| {
            alpha.step(t, h, &mut state).expect("a step can be made");
            t += h;
        };
        step(0.01);
        let count = allocations(|| [0.01, 0.01, 0.005, 0.02].into_iter().for_each(&mut step));
        assert_eq!(count, 0, "with {reactions:?}");
        let count = recorded(alpha, t, &mut state);
        assert_eq!(count, 0, "recorded, with {reactions:?}");
    }
}

/// Allocations of recorded steps, where as many were recorded before.
fn recorded<M: Recordable>(method: M, mut t: f64, state: &mut M::State) -> usize
where
    M::State: Recorded,
{
    let records = SharedRecords::default();
    let mut recorder = Recorder::new(method, records.clone());
    let mut steps = || {
        for _ in 0..5 {
            recorder.step(t, 0.01, state).expect("a step can be made");
            t += 0.01;
        }
    };
    steps();
    records.lock().clear();
    allocations(steps)
}

/// Allocations of steps after the first.
fn others<S: Stepper>(stepper: &mut S, state: &mut S::State) -> usize {
    let mut step = |n| {
        let t = 0.01 * f64::from(n);
        stepper.step(t, 0.01, state).expect("a step can be made");
        stepper.synchronize(state).expect("it can be settled");
    };
    step(0);
    allocations(|| (1..20).for_each(step))
}

#[test]
fn a_step_of_several_members_takes_no_memory() {
    let params = PENDULUM.map(Lanes::<BATCH>::splat);
    let y = [1.0, 0.0].map(Lanes::splat);
    let z = [
        Lanes::splat(0.0),
        Lanes(std::array::from_fn(|k| 0.2 * k as f64)),
    ];
    for s in [1, 3, 6] {
        let tableau = tableau::Spark::gauss(s);
        let mut together =
            SparkBatch::of(&pendulum().build(), (&params, 11), tableau, Solver::Auto);
        let mut state = together.state(0.0, &y, &z);
        let count = others(&mut together, &mut state);
        assert_eq!(count, 0, "with s = {s}");
    }
}

#[test]
fn a_step_of_index_2_takes_no_memory() {
    let (f, k) = turning();
    for s in [1, 3, 6] {
        let mut model = SemiExplicitModel::new(semi_explicit(&f, &k), &[]);
        let start = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.01);
        let mut state = start.expect("a start");
        let mut index2 = Index2::new(model, s);
        let count = others(&mut index2, &mut state);
        assert_eq!(count, 0, "with s = {s}");
        let count = recorded(index2, 0.2, &mut state);
        assert_eq!(count, 0, "recorded, with s = {s}");
    }
}

#[test]
fn a_composed_step_takes_no_memory() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let mut state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
    let spark = Spark::new(model, 1, Solver::Auto);
    let scheme = tableau::Scheme::named("SU4").expect("a scheme");
    let mut composed = Composed::of_symmetric(spark, scheme).expect("stages");
    assert_eq!(others(&mut composed, &mut state), 0);

    let turn = |row, coefficient, factor| Piece::Natural {
        rows: vec![row],
        change: Polynomials::new(1, 2, &[0], &[coefficient], &[factor], 1).expect("a term"),
        functions: vec![],
    };
    let split = Split::new(2, vec![turn(0, 1.0, 1), turn(1, -1.0, 0)]).expect("a split");
    let split = Arc::new(split);
    let volume = Volume::<f64>::new(Arc::clone(&split), true);
    let mut state = volume.state(&[1.0, 0.0]);
    assert_eq!(others(&mut Composed::new(volume, scheme), &mut state), 0);
    let mut determinant = Determinant::new(split, scheme, true);
    let mut state = determinant.state(&[1.0, 0.0]);
    assert_eq!(others(&mut determinant, &mut state), 0);
}

#[test]
fn a_flow_of_any_piece_takes_no_memory() {
    let pieces = every_kind(&mut Draw::new(5), 6);
    let split = Arc::new(Split::new(6, pieces).expect("proper pieces"));
    let scheme = tableau::Scheme::named("S2").expect("a scheme");
    let volume = Volume::<Lanes<16>>::new(Arc::clone(&split), false);
    let mut state = volume.state(&[Lanes::splat(0.1); 6]);
    assert_eq!(others(&mut Composed::new(volume, scheme), &mut state), 0);
    let volume = Volume::<f64>::new(Arc::clone(&split), true);
    let mut state = volume.state(&[0.1; 6]);
    assert_eq!(others(&mut Composed::new(volume, scheme), &mut state), 0);
    let mut determinant = Determinant::new(split, scheme, true);
    let mut state = determinant.state(&[0.1; 6]);
    assert_eq!(others(&mut determinant, &mut state), 0);
}

/// Bounds of parts of one term each.
fn parts(bounds: &[(f64, f64)]) -> TermBounds {
    TermBounds {
        groups: vec![1; bounds.len()],
        parts: bounds.to_vec(),
        ..TermBounds::default()
    }
}

#[test]
fn a_step_of_a_wave_function_on_a_grid_takes_no_memory() {
    let hamiltonian = Arc::new(rotor(32, 1.0));
    let phases = Phases::new(hamiltonian.clone(), 1e-10).expect("T and diagonals");
    let mut stepper = Composed::following(phases, flows("RKN6s11"));
    assert_eq!(others(&mut stepper, &mut packet(32)), 0);
    let plane = Phases::new(Arc::new(Hamiltonian::new(vec![kinetic(&[4, 2, 4])])), 1e-10);
    let plane = plane.expect("T alone");
    let mut stepper = Composed::following(plane, flows("BM4"));
    assert_eq!(others(&mut stepper, &mut packet(32)), 0);
    let exponential = ShearProgram {
        program: flows("SS10s35"),
        theta: 0.5,
        tolerance: 1e-10,
    };
    let bounds = parts(&[(0.0, 128.0), (-2.0, 2.0)]);
    let mut stepper = Magnus::new(
        Sweeper::new(hamiltonian),
        Nodes::find(4, 3).expect("a method"),
        exponential,
        bounds,
    );
    assert_eq!(others(&mut stepper, &mut packet(32)), 0);
}

#[test]
fn a_shear_by_rows_takes_no_memory() {
    let n = 70;
    let rows = Rows::new((n, n), &[0, 3], &[3, 0], &[0.5; 2]).expect("entries inside");
    let spins = |up| {
        let sites = (1, 0);
        let (xy, z) = (1.0, 0.5);
        Operator::Spins(Arc::new(Spins::new(
            &[Bond { sites, xy, z }],
            &[0.1; 7],
            up,
        )))
    };
    let operators = [
        Operator::Rows(Arc::new(rows)),
        Operator::Diagonals(Arc::new(Diagonals::new(n, &[(0, vec![0.3; n])]))),
        Operator::Dense(Arc::new(Dense::new(n, &vec![0.01; n * n]))),
        spins(None),
        spins(Some(3)),
    ];
    let scheme = tableau::Scheme::named("S2").expect("a scheme");
    for operator in operators {
        let n = operator.size();
        let hamiltonian = Arc::new(Hamiltonian::new(vec![operator]));
        let sweeper = Sweeper::<Lanes<8>>::new(hamiltonian).with_blocking(16, 3);
        let lanes = || vec![Lanes::splat(0.1); n];
        let mut state = Wave::new(lanes(), lanes());
        let shears = Shears::new(sweeper, 0.2, 1.0);
        assert_eq!(others(&mut Composed::new(shears, scheme), &mut state), 0);
    }
}

#[test]
fn another_step_size_takes_no_memory() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let mut state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
    let mut spark = Spark::new(model, 3, Solver::Auto);
    let mut step = |h| spark.step(0.0, h, &mut state).expect("a step can be made");
    step(0.01);
    let count = allocations(|| [0.005, 0.01, -0.02, 0.03].into_iter().for_each(&mut step));
    assert_eq!(count, 0);
}

#[test]
fn a_step_of_its_own_choice_takes_no_memory() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let mut state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
    let tolerance = Tolerance {
        rtol: 1e-6,
        atol: vec![1e-9; 2],
        longest: 0.01,
    };
    let mut spark = Spark::new(model.clone(), 3, Solver::Auto).estimating(tolerance);
    let mut step = |h| {
        spark.step(0.0, h, &mut state).expect("a step can be made");
        assert!(spark.error() > 0.0);
        spark.undo(&mut state);
    };
    step(0.01);
    let count = allocations(|| [0.02, 0.01, 0.03].into_iter().for_each(&mut step));
    assert_eq!(count, 0);
    let start = (0.0, &state.y[..], &state.z[..]);
    let mut monitor = TimeScale::new(model, start, 0.01);
    let mut rate = || monitor.rate(0.0, &state).expect("a rate");
    rate();
    assert_eq!(allocations(|| assert!(rate().is_finite())), 0);
}

#[test]
fn a_failing_step_takes_none_either() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let mut state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
    for solver in [Solver::NodeSchur, Solver::Newton] {
        let mut spark = Spark::new(model.clone(), 2, solver);
        spark
            .step(0.0, 0.01, &mut state)
            .expect("a step can be made");
        spark
            .step(0.01, 10.0, &mut state)
            .expect_err("a step too large");
        let fails = || assert!(spark.step(0.01, 10.0, &mut state).is_err());
        assert_eq!(allocations(fails), 0, "with {solver:?}");
    }
}

#[test]
fn evaluations_take_no_memory() {
    let mut model = Model::new(general().build(), &[]);
    let mut acceleration = Acceleration::new(&model);
    let (y, z) = ([0.0, -1.0, 1.0, -1.0], [0.0; 4]);
    let count = allocations(|| {
        acceleration
            .solve(&mut model, 0.5, &y, &z)
            .expect("constraints are independent");
        model.stage(0.5, &y, &z);
        model.node_blocks(0.5, &y, &[0.0, 0.0]);
    });
    assert_eq!(count, 0);
}

#[test]
fn a_sparse_matrix_is_factored_and_solved_with_in_the_memory_of_the_first_time() {
    let order = 200;
    let near = |i: usize| i.saturating_sub(2)..(i + 3).min(order);
    let entries = (0..order).flat_map(|i| near(i).map(move |j| (i, j)));
    let pattern = Pattern::new(order, order, entries.collect()).expect("entries inside");
    let diagonal = |at: &(usize, usize)| if at.0 == at.1 { 4.0 } else { -1.0 };
    let mut values: Vec<f64> = pattern.entries().iter().map(diagonal).collect();
    let mut factor = Factor::new(&pattern);
    assert!(matches!(factor, Factor::Sparse(_)));
    let mut x = vec![1.0; order];
    let mut work = |values: &[f64]| {
        let factored = factor.factor(&pattern, values);
        factor.solve(&mut x);
        factored
    };
    work(&values).expect("regular");
    values = values.iter().map(|value| 1.5 * value).collect();
    assert_eq!(allocations(|| assert!(work(&values).is_ok())), 0);
    values.fill(0.0);
    assert_eq!(allocations(|| assert!(work(&values).is_err())), 0);
}

#[test]
fn steps_of_wave_functions_allocate_nothing() {
    let sweeper = || Sweeper::<f64>::new(ring(20, 0.0));
    let plain = || Sweeper::<f64>::new(chain(20, 0.0));
    let absorbing = chain(20, 0.0)
        .as_ref()
        .clone()
        .with_absorber([0.02; 20].into());
    let bounds = parts(&[(-2.0, 2.0)]);
    let tolerance = MagnusTolerance {
        rate: 1e-6,
        whole: 1e-6,
        norm: 1e-5,
    };
    let nodes = Nodes::find(6, 5).expect("a method");
    let steps = MagnusSteps::new(sweeper(), nodes, bounds.clone(), tolerance);
    let mut steppers: [Box<dyn Stepper<State = Wave<f64>>>; 6] = [
        Box::new(steps.expect("one part").expect("steps")),
        Box::new(Chebyshev::new(plain(), (-2.0, 2.0), 1e-9, 1e-6)),
        Box::new(Chebyshev::new(sweeper(), (-2.0, 2.0), 1e-9, 1e-6)),
        Box::new(Lanczos::new(sweeper(), 12, 1e-9, 1e-6)),
        Box::new(Arnoldi::new(Sweeper::new(absorbing.into()), 12, 1e-9, 1e-6)),
        Box::new(Magnus::by_series(
            sweeper(),
            Nodes::find(4, 3).expect("a method"),
            (1e-9, 1e-6),
            bounds,
        )),
    ];
    for (k, stepper) in steppers.iter_mut().enumerate() {
        let (q, p) = anyhow(20);
        let mut state = Wave::new(q, p);
        let mut advance = |n: usize| {
            for i in 0..n {
                let h = [0.3, 9.0][i % 2];
                stepper.step(0.0, h, &mut state).expect("a step");
            }
        };
        // steps to a tolerance become longer at first, and their series with them
        advance(8);
        assert_eq!(allocations(|| advance(10)), 0, "{k}");
    }
}
