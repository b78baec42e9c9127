//! Compositions: their order in time-dependent fields, flows made as one, and steps that fail.

use liouville_base::checkpoint::Checkpoint;
use liouville_base::composition::Parts;
use liouville_base::composition::{Base, Composed, NeedsAdjoint};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper, Symmetric};
use liouville_base::observe::Observe;
use liouville_base::run::{Advance, Fixed, Run, Status};
use liouville_base::tableau::Scheme;
use liouville_problem::Model;
use liouville_spark::{Solver, Spark};
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);

/// q' = p + ω p,  p' = cos 3t − sin q − ω q + c(t) p,  c = 0.3 cos 2t: a drift, a kick, a damping by an Euler
/// step that is not exact, and a turn.
struct Swing {
    /// Which parts are said to be exact; all but the damping are.
    exact: [bool; 4],
    is_large: bool,
    /// Flows left until one fails.
    left: usize,
    kept: [f64; 2],
}

const OMEGA: f64 = 0.4;
const EXACT: [bool; 4] = [true, true, false, true];
const BROKEN: StepError = StepError::Singular {
    piece: 7,
    member: 0,
    t: 0.0,
};

fn swing() -> Swing {
    Swing {
        exact: EXACT,
        is_large: false,
        left: usize::MAX,
        kept: [0.0; 2],
    }
}

fn damping(t: f64) -> f64 {
    0.3 * (2.0 * t).cos()
}

impl Checkpoint for Swing {}

impl Parts for Swing {
    type State = [f64; 2];

    fn count(&self) -> usize {
        4
    }

    fn is_exact(&self, part: usize) -> bool {
        self.exact[part]
    }

    fn flow(
        &mut self,
        part: usize,
        is_adjoint: bool,
        t: f64,
        h: f64,
        [q, p]: &mut [f64; 2],
    ) -> Result<(), StepError> {
        self.left = self.left.wrapping_sub(1);
        match part {
            // the last and the first flow are the kick
            0 => *p += ((3.0 * (t + h)).sin() - (3.0 * t).sin()) / 3.0 - h * q.sin(),
            1 => *q += h * *p,
            2 if is_adjoint => *p /= 1.0 - h * damping(t + h),
            2 => *p *= 1.0 + h * damping(t),
            _ => {
                let (sin, cos) = (OMEGA * h).sin_cos();
                (*q, *p) = (cos * *q + sin * *p, cos * *p - sin * *q);
            }
        }
        if self.left == 0 { Err(BROKEN) } else { Ok(()) }
    }

    fn check(&self, t: f64, state: &[f64; 2]) -> Result<(), StepError> {
        match state.iter().position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(index) => Err(StepError::Overflow {
                index,
                member: 0,
                t,
            }),
        }
    }

    fn keep(&mut self, state: &[f64; 2]) -> bool {
        self.kept = *state;
        !self.is_large
    }

    fn put_back(&mut self, state: &mut [f64; 2]) {
        *state = self.kept;
    }
}

const START: [f64; 2] = [0.4, 0.9];

/// The field of the parts together, by the classical Runge–Kutta method.
fn reference(t1: f64) -> [f64; 2] {
    let field = |t: f64, [q, p]: [f64; 2]| {
        [
            (1.0 + OMEGA) * p,
            (3.0 * t).cos() - q.sin() - OMEGA * q + damping(t) * p,
        ]
    };
    let along = |x: [f64; 2], h: f64, k: [f64; 2]| [x[0] + h * k[0], x[1] + h * k[1]];
    let (steps, mut x) = (8000, START);
    let h = t1 / f64::from(steps);
    for n in 0..steps {
        let t = f64::from(n) * h;
        let k1 = field(t, x);
        let k2 = field(t + h / 2.0, along(x, h / 2.0, k1));
        let k3 = field(t + h / 2.0, along(x, h / 2.0, k2));
        let k4 = field(t + h, along(x, h, k3));
        let sum = |i: usize| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
        x = along(x, h, [sum(0), sum(1)]);
    }
    x
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn scheme(name: &str) -> &'static Scheme {
    Scheme::named(name).expect("a scheme of this name")
}

/// The state after `steps` steps of `h` from t = 0.
fn walk<S: Stepper>(stepper: &mut S, mut state: S::State, h: f64, steps: u32) -> S::State {
    for n in 0..steps {
        stepper
            .step(f64::from(n) * h, h, &mut state)
            .expect("a step can be made");
    }
    stepper.synchronize(&mut state).expect("it can be settled");
    state
}

/// The order seen between the two smallest steps whose errors are above roundoff.
fn order(error: impl Fn(u32) -> f64) -> f64 {
    let errors: Vec<f64> = (1..8).map(|k| error(1 << k)).collect();
    let seen = errors.iter().take_while(|error| **error > 1e-12).count();
    assert!(seen >= 2, "{errors:?}");
    (errors[seen - 2] / errors[seen - 1]).log2()
}

#[test]
fn every_scheme_has_its_order_in_a_time_dependent_field() {
    let wanted = reference(1.5);
    for scheme in Scheme::all().iter().filter(|scheme| scheme.order < 10) {
        let order = order(|steps| {
            let h = 1.5 / f64::from(steps);
            let end = walk(&mut Composed::new(swing(), scheme), START, h, steps);
            distance(end, wanted)
        });
        #[allow(clippy::cast_precision_loss)]
        let least = scheme.order as f64 - 0.35;
        assert!(order > least, "{}: {order}", scheme.name);
    }
}

#[test]
fn flows_that_meet_are_one() {
    for scheme in Scheme::all() {
        let mut fused = Composed::new(swing(), scheme);
        let mut plain = Composed::new(
            Swing {
                exact: [false; 4],
                ..swing()
            },
            scheme,
        );
        let (a, b) = (
            walk(&mut fused, START, 0.05, 40),
            walk(&mut plain, START, 0.05, 40),
        );
        assert!(distance(a, b) < 1e-13, "{}: {a:?} {b:?}", scheme.name);
        let maps = scheme.flows().len();
        assert_eq!(plain.stats().evaluations, 40 * 4 * maps);
        let meetings = if scheme.name == "Lie" {
            0
        } else {
            40 * maps - 1
        };
        assert_eq!(fused.stats().evaluations, 40 * 4 * maps - meetings);
    }
}

#[test]
fn a_method_of_one_exact_flow_is_that_flow() {
    struct Drift;
    impl Checkpoint for Drift {}

    impl Parts for Drift {
        type State = f64;
        fn count(&self) -> usize {
            1
        }
        fn is_exact(&self, _: usize) -> bool {
            true
        }
        fn flow(
            &mut self,
            _: usize,
            _: bool,
            _: f64,
            h: f64,
            x: &mut f64,
        ) -> Result<(), StepError> {
            *x += h;
            Ok(())
        }
        fn check(&self, _: f64, _: &f64) -> Result<(), StepError> {
            Ok(())
        }
        fn keep(&mut self, _: &f64) -> bool {
            false
        }
        fn put_back(&mut self, _: &mut f64) {}
    }
    for name in ["Lie", "S2", "BM4", "SS10s35"] {
        let mut stepper = Composed::new(Drift, scheme(name));
        let end = walk(&mut stepper, 0.0, 0.125, 80);
        assert!((end - 10.0).abs() < 1e-13, "{name}: {end}");
        assert_eq!(stepper.stats().evaluations, 1);
    }
}

#[test]
fn a_symmetric_composition_goes_back_the_way_it_came() {
    for scheme in Scheme::all() {
        let mut stepper = Composed::new(swing(), scheme);
        let mut state = START;
        for (t, h) in [
            (0.0, 0.1),
            (0.1, 0.1),
            (0.2, 0.07),
            (0.27, -0.07),
            (0.2, -0.1),
            (0.1, -0.1),
        ] {
            stepper.step(t, h, &mut state).expect("a step");
        }
        stepper.synchronize(&mut state).expect("it can be settled");
        let is_back = distance(state, START) < 1e-14;
        assert_eq!(is_back, scheme.name != "Lie", "{}: {state:?}", scheme.name);
    }
}

/// Records the state.
struct Place;

impl Checkpoint for Place {}

impl Observe<[f64; 2]> for Place {
    fn width(&self, _: &[f64; 2]) -> usize {
        2
    }

    fn observe(&mut self, _: f64, state: &[f64; 2], row: &mut Vec<f64>) -> Result<(), StepError> {
        row.extend_from_slice(state);
        Ok(())
    }
}

fn run(parts: Swing, every: usize) -> Run<[f64; 2]> {
    let stepper = Box::new(Composed::new(parts, scheme("BM4")));
    let control = Box::new(Fixed::new(stepper, 0.0, 0.05, 60));
    Run::new(control, Box::new(Place), START, (every, 60)).expect("the start can be recorded")
}

#[test]
fn what_is_recorded_does_not_depend_on_how_often() {
    let mut often = run(swing(), 1);
    assert_eq!(often.advance(ALL_DAY), Status::Done);
    let (_, all) = often.take();
    for every in [7, 60, 1000] {
        let mut run = run(swing(), every);
        assert_eq!(run.advance(ALL_DAY), Status::Done);
        let (times, rows) = run.take();
        for (t, row) in times.iter().zip(rows.chunks(2)) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let n = (t / 0.05).round() as usize;
            let gap = distance([row[0], row[1]], [all[2 * n], all[2 * n + 1]]);
            assert!(gap < 1e-13, "{gap:e} at {t}, every {every}");
        }
    }
}

#[test]
fn a_failed_step_leaves_the_state_before_it() {
    let flows = 12 * 4 - 12;
    // in the first flow of a step, which is also the last of the one before; and within
    for (left, made) in [(1, 0), (20, 0), (5 * flows + 1, 5), (23 * flows + 17, 23)] {
        let mut broken = run(Swing { left, ..swing() }, 1000);
        let Status::Failed { n, error, .. } = broken.advance(ALL_DAY) else {
            panic!("flow {left} fails");
        };
        assert_eq!((n, error), (made, BROKEN));
        // the state is still good, and what was held back is made now
        let mut whole = run(swing(), 1000);
        while whole.done() < made {
            assert_eq!(whole.advance(Duration::ZERO), Status::Paused);
        }
        assert_eq!(broken.take(), whole.take(), "flow {left}");
    }
}

#[test]
fn a_large_state_is_lost_with_the_step_that_fails() {
    let parts = Swing {
        is_large: true,
        left: 500,
        ..swing()
    };
    let mut run = run(parts, 10);
    let Status::Failed { n, error, .. } = run.advance(ALL_DAY) else {
        panic!("flow 500 fails");
    };
    assert_eq!((n, error), (13, BROKEN));
    let (times, rows) = run.take();
    assert_eq!((times.len(), rows.len()), (2, 4), "records end at step 10");
    assert!(rows.iter().all(|x| x.is_finite()));
}

#[test]
fn states_that_are_not_finite_are_never_recorded() {
    for is_large in [false, true] {
        for every in [1, 4, 1000] {
            let parts = Swing {
                is_large,
                ..swing()
            };
            let stepper = Box::new(Composed::new(parts, scheme("S2")));
            let control = Box::new(Fixed::new(stepper, 0.0, 0.5, 100));
            // the drift alone leaves the numbers
            let start = [1.5e308, 1e308];
            let mut run = Run::new(control, Box::new(Place), start, (every, 0)).expect("a start");
            let status = run.advance(ALL_DAY);
            assert!(
                matches!(
                    status,
                    Status::Failed {
                        n: 0..16,
                        error: StepError::Overflow { .. },
                        ..
                    }
                ),
                "{status:?}"
            );
            assert!(run.take().1.iter().all(|x| x.is_finite()));
        }
    }
}

/// The implicit midpoint rule for x' = a(t) x, with a = cos 3t; x = exp(sin(3t)/3).
struct Midpoint {
    steps: usize,
}

impl Checkpoint for Midpoint {}

impl Stepper for Midpoint {
    type State = f64;

    fn step(&mut self, t: f64, h: f64, x: &mut f64) -> Result<(), StepError> {
        self.steps += 1;
        let a = h / 2.0 * (3.0 * (t + h / 2.0)).cos();
        *x *= (1.0 + a) / (1.0 - a);
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats {
            iterations: self.steps,
            ..Stats::default()
        }
    }
}

impl Symmetric for Midpoint {}

/// x(2) where x(1) = 1.
fn from_one(stepper: &mut Composed<Base<Midpoint>>, h: f64, steps: u32) -> f64 {
    let mut x = 1.0;
    for n in 0..steps {
        let t = 1.0 + f64::from(n) * h;
        stepper.step(t, h, &mut x).expect("a step can be made");
    }
    x
}

#[test]
fn a_symmetric_method_gets_the_order_of_the_scheme() {
    let wanted = ((6.0_f64.sin() - 3.0_f64.sin()) / 3.0).exp();
    for scheme in Scheme::all().iter().filter(|scheme| scheme.order < 10) {
        let composed = || Composed::of_symmetric(Midpoint { steps: 0 }, scheme);
        let Some(stages) = scheme.stages() else {
            assert_eq!(composed().err(), Some(NeedsAdjoint(scheme.name)));
            continue;
        };
        let order = order(|steps| {
            let mut stepper = composed().expect("stages");
            let end = from_one(&mut stepper, 1.0 / f64::from(steps), steps);
            assert_eq!(stepper.stats().iterations, stages.len() * steps as usize);
            (end - wanted).abs()
        });
        #[allow(clippy::cast_precision_loss)]
        let least = scheme.order.max(2) as f64 - 0.75; // the order is even
        assert!(order > least, "{}: {order}", scheme.name);
    }
}

#[test]
fn spark_composed_keeps_the_constraint_and_gains_order() {
    let problem = liouville_tests::pendulum().build();
    let model = Model::new(problem, &liouville_tests::PENDULUM);
    let end = |steps: u32, scheme: &Scheme| {
        let spark = Spark::new(model.clone(), 1, Solver::Auto);
        let mut stepper = Composed::of_symmetric(spark, scheme).expect("stages");
        let start = model.clone().state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
        let state = walk(&mut stepper, start, 0.5 / f64::from(steps), steps);
        assert!((state.y[0].hypot(state.y[1]) - 1.0).abs() < 1e-14);
        [state.y[0], state.y[1]]
    };
    let wanted = end(64, scheme("SS8s21"));
    for (name, least) in [("S2", 1.65), ("SU4", 3.65), ("KL6", 5.65)] {
        let order = order(|steps| distance(end(steps, scheme(name)), wanted));
        assert!(order > least, "{name}: {order}");
    }
}
