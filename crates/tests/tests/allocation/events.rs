//! Event detection takes no memory, and dense output reproduces polynomials.

use crate::counting::allocations;
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::StepError;
use liouville_base::method::Tolerance;
use liouville_base::observe::Observe;
use liouville_base::run::{Adaptive, Advance, Fixed, Run};
use liouville_base::tableau;
use liouville_index2::Index2;
use liouville_index2::semi_explicit;
use liouville_mechanics::events::{DenseDetector, Event};
use liouville_problem::{Carried, Model, Observer, Path};
use liouville_spark::{Solver, Spark};
use liouville_tests::{
    Functions, PENDULUM, T, Y, Z, input, pendulum, semi_explicit as traced, tape, turning,
};
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
fn detecting_events_takes_no_memory() {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let state = model.state(0.0, &[1.0, 0.0], &[0.0; 2]);
    let (height, lam) = (input(Y, 1), input(3, 0));
    let events = [height - 2.0, lam + 1e3].map(|e| tape([1, 2, 2, 1, 3], &[e]));
    let events = events.into_iter().enumerate();
    let events = events.map(|(k, tape)| Event::new(k, tape, &PENDULUM, 0, 0, k == 1));
    let path = Path::new(model.clone(), 6);
    let observer = Observer::new(model.clone(), &PENDULUM, tape([1, 2, 2, 3], &[]), false);
    let stepper = Box::new(Spark::new(model, 3, Solver::Auto));
    let detector = DenseDetector::new(
        path,
        stepper.clone(),
        &state,
        events.collect(),
        (Box::new(observer), None),
    );
    let control = Box::new(Fixed::new(stepper, 0.0, 0.01, 60));
    let mut run = Run::with_events(
        control,
        Box::new(Nothing),
        state,
        (1000, 2),
        Some(Box::new(detector)),
    )
    .expect("a start");
    let all_day = Duration::from_secs(86400);
    run.advance_to(10, all_day);
    assert_eq!(allocations(|| drop(run.advance_to(50, all_day))), 0);
    assert_eq!(run.done(), 50);
}

#[test]
fn controlled_steps_of_index_2_and_their_events_take_no_memory() {
    let (f, k) = turning();
    let mut model = semi_explicit::SemiExplicitModel::new(traced(&f, &k), &[]);
    let state = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.05);
    let state = state.expect("a start");
    let tape = tape([1, 3, 1, 0, 0], &[input(Z, 0) + 1e3]);
    let event = Event::new(0, tape, &[], 0, 0, false);
    let observed = liouville_tests::tape([1, 3, 1, 0], &[]);
    let observer = Observer::new(model.clone(), &[], observed, false);
    let path = Path::new(model.clone(), 6);
    let tolerance = Tolerance {
        rtol: 1e-6,
        atol: vec![1e-6; 3],
    };
    let gauss = tableau::Spark::gauss(3);
    let stepper = Index2::of(model, gauss.clone()).estimating(&gauss, tolerance);
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
        let error = (path.point().y()[0] - y).abs();
        assert_eq!(error < 1e-14, y_is_exact, "y is off by {error:e}");
        let error = (path.point().z()[0] - z).abs();
        assert!(error < 0.1, "z is off by {error:e}");
        let [.., (t, (y, z))] = ends;
        path.move_to(t);
        assert_eq!(path.point().y(), [y]);
        assert_eq!(path.point().z(), [z]);
    }
}
