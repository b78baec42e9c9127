//! Event detection takes no memory, and dense output reproduces polynomials.

use crate::counting::allocations;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Composed;
use liouville_base::error::StepError;
use liouville_base::method::Tolerance;
use liouville_base::observe::Observe;
use liouville_base::run::{
    Adaptive, Advance, EventRule, Fixed, Run, SubstepDetector, WatchedFunction,
};
use liouville_base::tableau;
use liouville_fields::problem::{Piece, Polynomials, Split};
use liouville_fields::volume::{Observer as FieldObserver, UserVariables, Volume};
use liouville_index2::Index2;
use liouville_index2::semi_explicit;
use liouville_mechanics::events::{DenseDetector, Event};
use liouville_problem::{Model, Observer, Path};
use liouville_spark::{Solver, Spark};
use liouville_tests::{
    Functions, PENDULUM, T, Y, Z, input, pendulum, semi_explicit as traced, tape, turning,
};
use std::sync::Arc;
use std::time::Duration;

/// Records nothing of anything.
struct Nothing;

impl Checkpoint for Nothing {}

impl<S> Observe<S> for Nothing {
    fn width(&self, _: &S) -> usize {
        0
    }

    fn observe(&mut self, _: f64, _: &S, _: &mut Vec<f64>) -> Result<(), StepError> {
        Ok(())
    }
}

#[test]
fn detecting_events_and_states_at_given_times_take_no_memory() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let state = model.state(0.0, &[1.0, 0.0], &[0.0; 2]);
    let (height, lam) = (input(Y, 1), input(3, 0));
    let events = [height - 2.0, lam + 1e3].map(|e| tape([1, 2, 2, 1, 3], &[e]));
    let events = events.into_iter().enumerate();
    let events = events.map(|(k, tape)| {
        Event::new(
            tape,
            &PENDULUM,
            EventRule {
                index: k,
                ..EventRule::default()
            },
            k == 1,
        )
    });
    let path = Path::new(model.clone(), 6);
    let observer = Observer::new(
        model.clone(),
        &PENDULUM,
        tape([1, 2, 2, 3], &[]).into(),
        false,
    );
    let stepper = Box::new(Spark::new(model, 3, Solver::Auto));
    let detector = DenseDetector::new(
        path,
        stepper.clone(),
        &state,
        events.collect(),
        (
            Box::new(observer),
            Some((1..100).map(|k| 0.0059 * f64::from(k)).collect()),
        ),
    );
    let control = Box::new(Fixed::new(stepper, 0.0, 0.01, 60));
    let mut run = Run::with_events(
        control,
        Box::new(Nothing),
        state,
        (1000, 200),
        Some(Box::new(detector)),
    )
    .expect("a start");
    let all_day = Duration::from_secs(86400);
    run.advance_to(10, all_day);
    assert_eq!(allocations(|| drop(run.advance_to(50, all_day))), 0);
    assert_eq!(run.done(), 50);
    assert_eq!(run.take().0.len(), 84); // those up to 0.5
}

/// x' = y, y' = −x, with a function that almost has a zero in some steps, and one that has.
#[test]
fn detecting_events_of_a_field_takes_no_memory() {
    let shear = |row: usize, c: f64, of: i64| Piece::Natural {
        rows: vec![row],
        change: Polynomials::new(1, 2, &[0], &[c], &[of], 1).expect("a polynomial"),
        functions: vec![],
    };
    let split = Split::new(2, vec![shear(0, 1.0, 1), shear(1, -1.0, 0)]).expect("a split");
    let volume = Volume::<f64>::new(Arc::new(split), false);
    let state = volume.state(&[0.0, 1.0]);
    let scheme = tableau::Scheme::named("BM4").expect("a scheme");
    let stepper = Box::new(Composed::new(volume.clone(), scheme));
    let variables = UserVariables { n: 2, basis: None };
    let reader = FieldObserver::of_states(volume, variables, 1);
    let functions = [1.01, 0.5].map(|c| {
        let tape = tape([1, 2, 0], &[input(1, 0) - c]);
        WatchedFunction::new(tape, &[], EventRule::default())
    });
    let detector = SubstepDetector::new(
        stepper.clone(),
        &state,
        (Box::new(reader.clone()), functions.to_vec()),
        (Box::new(reader), None),
    );
    let control = Box::new(Fixed::new(stepper, 0.0, 0.1, 400));
    let detector = Some(Box::new(detector) as _);
    let run = Run::with_events(control, Box::new(Nothing), state, (1000, 2), detector);
    let mut run = run.expect("a start");
    let all_day = Duration::from_secs(86400);
    run.advance_to(100, all_day);
    let found = |run: &mut Run<_>| {
        run.events()
            .found
            .iter()
            .map(|hits| hits.times.len())
            .collect()
    };
    let before: Vec<usize> = found(&mut run);
    assert_eq!(before, [0, 4]);
    // what was found was taken, so that each of two hits takes memory for its time and for its state
    assert!(allocations(|| drop(run.advance_to(160, all_day))) <= 4);
    let after: Vec<usize> = found(&mut run);
    assert_eq!(after, [0, 2]);
}

#[test]
fn controlled_steps_of_index_2_and_their_events_take_no_memory() {
    let (f, k) = turning();
    let mut model = semi_explicit::SemiExplicitModel::new(traced(&f, &k), &[]);
    let state = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.05);
    let state = state.expect("a start");
    let tape = tape([1, 3, 1, 0, 0], &[input(Z, 0) + 1e3]);
    let event = Event::new(tape, &[], EventRule::default(), false);
    let observed = liouville_tests::tape([1, 3, 1, 0], &[]);
    let observer = Observer::new(model.clone(), &[], observed.into(), false);
    let path = Path::new(model.clone(), 6);
    let tolerance = Tolerance {
        rtol: 1e-6,
        atol: vec![1e-6; 3],
        longest: 0.01,
    };
    let gauss = tableau::Spark::gauss(3);
    let stepper = Index2::of(model, &gauss).estimating(&gauss, tolerance);
    let copy = Box::new(stepper.clone());
    let recorded = (Box::new(observer) as _, None);
    let detector = DenseDetector::new(path, copy, &state, vec![event], recorded);
    let control = Box::new(Adaptive::new(Box::new(stepper), (0.0, 20.0), 0.05, 1e-9));
    let detector = Some(Box::new(detector) as _);
    let run = Run::with_events(control, Box::new(Nothing), state, (1000, 2), detector);
    let mut run = run.expect("a start");
    let all_day = Duration::from_secs(86400);
    run.advance_to(10, all_day);
    assert_eq!(allocations(|| drop(run.advance_to(50, all_day))), 0);
    assert_eq!(run.done(), 50);
}

/// v = z + t and p = z, with the force under which y = t⁶ + 2 t.
fn sextic() -> Functions {
    let (t, z) = (input(T, 0), input(Z, 0));
    let t4 = &t * &t * &t * &t;
    Functions {
        v: Some(vec![&z + &t]),
        p: vec![z],
        f: vec![t4 * 30.0 - 1.0],
        r: None,
        g: vec![],
        params: 0,
    }
}

#[test]
fn three_knots_reproduce_a_polynomial_of_degree_eight_and_two_do_not() {
    let exact = |t: f64| (t.powi(6) + 2.0 * t, 6.0 * t.powi(5) + 2.0 - t);
    for (order, y_is_exact) in [(4, false), (6, true)] {
        let mut model = Model::new(sextic().build(), &[]);
        let mut path = Path::new(model.clone(), order);
        let ends = [0.0, 0.4, 0.9].map(|t| (t, exact(t)));
        for (t, (y, z)) in ends {
            let state = model.state(t, &[y], &[z]);
            path.push(t, &state).expect("accelerations");
        }
        path.move_to(0.6);
        let (y, z) = exact(0.6);
        let error = (path.point().y[0] - y).abs();
        assert_eq!(error < 1e-14, y_is_exact, "y is off by {error:e}");
        let error = (path.point().z[0] - z).abs();
        assert!(error < 0.1, "z is off by {error:e}");
        let [.., (t, (y, z))] = ends;
        path.move_to(t);
        assert_eq!(path.point().y, [y]);
        assert_eq!(path.point().z, [z]);
    }
}
