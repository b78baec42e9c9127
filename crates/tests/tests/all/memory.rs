//! What a run brings from step to step: restored, it goes on with the same bits. One file, since all steppers are
//! saved and restored by the same function.

use liouville_alpha::{Alpha, Reactions};
use liouville_base::checkpoint::{Checkpoint, CheckpointMismatch};
use liouville_base::composition::Composed;
use liouville_base::method::{Stepper, Tolerance};
use liouville_base::run::{
    Adaptive, Advance, BetweenTimes, EventRule, Fixed, Reversible, Run, Status, StepControl,
};
use liouville_base::tableau::{self, Purpose, Scheme, Stable};
use liouville_fields::problem::Split;
use liouville_fields::volume::{self, Volume};
use liouville_index2::Index2;
use liouville_index2::semi_explicit;
use liouville_mechanics::events::{DenseDetector, Event};
use liouville_problem::{
    Model, Observer, Path, SecondOrderModel, SeparableModel, State, TimeScale, Traced,
};
use liouville_spark::rattle::Rattle;
use liouville_spark::{Solver, Spark};
use liouville_tests::quantum::{flows, packet, rotor};
use liouville_tests::splits::{Draw, every_kind};
use liouville_tests::walk::{START, driven_start, heavy};
use liouville_tests::waves::{anyhow, chain};
use liouville_tests::{
    Functions, PENDULUM, T, Y, Z, dot, input, inputs, pendulum, semi_explicit as traced, tape,
    turning,
};
use liouville_waves::method::{
    self as schrodinger, Chebyshev, Driven, DrivenSeries, Lanczos, Magnus, MagnusSteps,
    MagnusTolerance, Nodes, Phases, Processed, Processor, ShearProgram, Shears, Sweeper,
    TermBounds, Wave, Windows,
};
use std::sync::Arc;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);

/// Records, events and how a run ended.
#[derive(Default, PartialEq, Debug)]
struct Left {
    times: Vec<u64>,
    rows: Vec<u64>,
    /// Of each kind times and rows.
    events: Vec<[Vec<u64>; 2]>,
    end: String,
}

impl Left {
    fn add(&mut self, run: &mut dyn Advance, (times, rows): (Vec<f64>, Vec<f64>)) {
        self.times.extend(times.iter().map(|x| x.to_bits()));
        self.rows.extend(rows.iter().map(|x| x.to_bits()));
        let met = run.events();
        self.events.resize(met.found.len(), <_>::default());
        for (kept, hits) in self.events.iter_mut().zip(&met.found) {
            kept[0].extend(hits.times.iter().map(|x| x.to_bits()));
            kept[1].extend(hits.rows.iter().map(|x| x.to_bits()));
        }
        self.end = format!("{:?} {:?} {:?}", run.stats(), run.sizes(), met.ends);
    }
}

/// A run that is thrown away after each of these numbers of steps leaves what one leaves that is not.
fn goes_on<A: Advance>(name: &str, at: &[usize], make: impl Fn() -> A) {
    let (mut whole, mut parted) = (Left::default(), Left::default());
    let mut run = make();
    assert_eq!(run.advance(ALL_DAY), Status::Done, "{name}");
    let records = run.take();
    whole.add(&mut run, records);

    let mut run = make();
    let mut saved = Vec::new();
    for steps in at {
        assert_eq!(run.advance_to(*steps, ALL_DAY), Status::Paused, "{name}");
        let records = run.collect();
        parted.add(&mut run, records);
        saved.clear();
        assert_eq!(run.save(&mut saved), Ok(true), "{name}");
        run = make();
        run.restore(&saved).expect("what was saved");
    }
    assert_eq!(run.advance(ALL_DAY), Status::Done, "{name}");
    let records = run.take();
    parted.add(&mut run, records);
    assert_eq!(whole, parted, "{name}");

    let mut other = make();
    let short = &saved[..saved.len() - 1];
    assert_eq!(other.restore(short), Err(CheckpointMismatch), "{name}");
    saved.push(0.0);
    assert_eq!(other.restore(&saved), Err(CheckpointMismatch), "{name}");
}

fn observer(model: &Model, params: &[f64]) -> Observer {
    let n = model.problem.n;
    let square = tape([1, n, n, params.len()], &[input(Y, 0) * input(Z, 1)]);
    Observer::new(model.clone(), params, square.into(), true)
}

fn ball(reactions: Reactions) -> (Alpha, liouville_alpha::AlphaState) {
    let hht = tableau::Alpha {
        alpha_m: 0.0,
        alpha_f: 0.1,
        gamma: 0.6,
        beta: 0.3025,
    };
    let tolerance = Tolerance {
        rtol: 1e-6,
        atol: vec![1e-6; 3],
        longest: 0.01,
    };
    let model = SecondOrderModel::new(heavy().second_order(), &[]);
    let mut alpha = Alpha::new(model, hht, reactions, Some(tolerance));
    let (y, z) = driven_start();
    let state = alpha.start(START, &y, &z, None).expect("a start");
    (alpha, state)
}

#[test]
fn the_alpha_family_goes_on() {
    let extended = |predicted| Reactions::Extended { b: 0.0, predicted };
    for reactions in [extended(false), extended(true), Reactions::Position] {
        let model = Model::new(heavy().build(), &[]);
        let equal = || {
            let (alpha, state) = ball(reactions);
            let control = Box::new(Fixed::new(Box::new(alpha), START, 0.02, 60));
            Run::new(control, Box::new(observer(&model, &[])), state, (3, 0)).expect("a start")
        };
        goes_on("equal steps", &[0, 1, 7, 30, 59], equal);
        let controlled = || {
            let (alpha, state) = ball(reactions);
            let ends = (START, START + 1.0);
            let control = Box::new(Adaptive::new(Box::new(alpha), ends, 0.01, 1e-9));
            Run::new(control, Box::new(observer(&model, &[])), state, (1, 0)).expect("a start")
        };
        goes_on("controlled steps", &[1, 2, 9, 20], controlled);
    }
}

/// The event of this number, so many of which end the run.
fn rule(index: usize, terminal: usize) -> EventRule {
    EventRule {
        index,
        terminal,
        ..EventRule::default()
    }
}

/// A turning vector whose steps a control makes, with two kinds of events, and given times if they are wanted.
fn turned<C: StepControl<semi_explicit::SemiExplicitState> + 'static>(
    (s, has_times): (usize, bool),
    control: impl Fn(semi_explicit::SemiExplicitModel, &semi_explicit::SemiExplicitState) -> C,
) -> Run<semi_explicit::SemiExplicitState> {
    let (f, k) = turning();
    let mut model = semi_explicit::SemiExplicitModel::new(traced(&f, &k), &[]);
    let state = model.state(0.0, &[0.0, 0.0, 1.0], &[0.0], 0.05);
    let state = state.expect("a start");
    let observed = tape([1, 3, 1, 0], &[input(Y, 0)]);
    let observer = Observer::new(model.clone(), &[], observed.into(), true);
    let events = [input(Y, 1) - 0.1, input(Z, 0) - 0.05].map(|e| tape([1, 3, 1, 0, 0], &[e]));
    let events = events.into_iter().enumerate();
    let events = events.map(|(k, tape)| Event::new(tape, &[], rule(k, 0), false));
    let times = has_times.then(|| (0..70_i32).map(|k| 0.0571 * f64::from(k)).collect());
    let (path, copy) = (
        Path::new(model.clone(), 2 * s),
        Index2::new(model.clone(), s),
    );
    let recorded = (Box::new(observer.clone()) as _, times);
    let detector = DenseDetector::new(path, Box::new(copy), &state, events.collect(), recorded);
    let control = Box::new(control(model, &state));
    let (observer, kept) = (Box::new(observer), (1, 0));
    Run::with_events(control, observer, state, kept, Some(Box::new(detector))).expect("a start")
}

#[test]
fn index_2_goes_on() {
    let monitor = |model: &semi_explicit::SemiExplicitModel| {
        let (z, z_dot) = (input(Z, 0), input(3, 0));
        let rates = [&z * &z + 1.0, &z * &z_dot * 2.0];
        Traced::new(model.clone(), &[], tape([1, 3, 1, 1, 0], &rates), true)
    };
    let tolerance = || Tolerance {
        rtol: 1e-7,
        atol: vec![1e-7; 3],
        longest: 0.01,
    };
    for of in [(1, false), (3, false), (3, true)] {
        let index2 = |model| Index2::new(model, of.0);
        goes_on("equal", &[1, 2, 40, 79], || {
            turned(of, |model, _| {
                Fixed::new(Box::new(index2(model)), 0.0, 0.05, 80)
            })
        });
        let gauss = tableau::Spark::gauss(of.0);
        goes_on("controlled", &[1, 2, 9, 20], || {
            turned(of, |model, _| {
                let stepper = index2(model).estimating(&gauss, tolerance());
                Adaptive::new(Box::new(stepper), (0.0, 8.0), 0.05, 1e-9)
            })
        });
        goes_on("reversible", &[1, 17, 40], || {
            turned(of, |model, state| {
                let monitor = Box::new(monitor(&model));
                let (ends, sizes) = ((0.0, 4.0), (0.05, 1e-9));
                Reversible::new(Box::new(index2(model)), ends, sizes, monitor, state)
            })
        });
    }
}

/// A pendulum whose steps a control makes.
fn swinging<C: StepControl<State> + 'static>(control: impl Fn(Model, &State) -> C) -> Run<State> {
    let mut model = Model::new(pendulum().build(), &PENDULUM);
    let state = model.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
    let observer = Box::new(observer(&model, &PENDULUM));
    let control = Box::new(control(model, &state));
    Run::new(control, observer, state, (2, 0)).expect("a start")
}

fn equal(stepper: impl Stepper<State = State> + 'static) -> Fixed<State> {
    Fixed::new(Box::new(stepper), 0.0, 0.02, 90)
}

#[test]
fn spark_goes_on() {
    for solver in [Solver::NodeSchur, Solver::Newton] {
        for s in [1, 2, 3] {
            let spark = |model| Spark::new(model, s, solver);
            let name = format!("{solver:?}, s = {s}");
            goes_on(&name, &[1, 2, 3, 41, 89], || {
                swinging(|model, _| equal(spark(model)))
            });
            let reversible = |model: Model, state: &State| {
                let at = (0.0, &state.y[..], &state.z[..]);
                let scale = TimeScale::new(model.clone(), at, 0.02);
                let monitor = Box::new(scale);
                let (ends, sizes) = ((0.0, 2.0), (0.02, 1e-9));
                Reversible::new(Box::new(spark(model)), ends, sizes, monitor, state)
            };
            goes_on(&name, &[1, 17, 40], || swinging(reversible));
            let composed = |model| {
                let scheme = Scheme::named("SU4").expect("a scheme");
                Composed::of_symmetric(spark(model), scheme).expect("stages")
            };
            goes_on(&name, &[1, 30], || {
                swinging(|model, _| equal(composed(model)))
            });
        }
        let tolerance = || Tolerance {
            rtol: 1e-7,
            atol: vec![1e-9; 2],
            longest: 0.01,
        };
        let estimating = |model| Spark::new(model, 3, solver).estimating(tolerance());
        goes_on("controlled", &[1, 2, 8, 15], || {
            swinging(|model, _| Adaptive::new(Box::new(estimating(model)), (0.0, 3.0), 0.01, 1e-9))
        });
    }
}

#[test]
fn rattle_goes_on() {
    let make = || {
        let (y, z) = (inputs(Y, 2), inputs(Z, 2));
        let swung = Functions {
            v: None,
            p: z,
            f: vec![input(T, 0).sin(), (-9.81).into()],
            r: None,
            g: vec![(dot(&y, &y) - 1.0) * 0.5],
            params: 0,
        };
        let mut model = SeparableModel::new(swung.separable(), &[]);
        let state = model.general.state(0.0, &[1.0, 0.0], &[0.0, 0.0]);
        let observer = Box::new(observer(&model.general, &[]));
        let control = equal(Rattle::new(model).expect("a mass"));
        Run::new(Box::new(control), observer, state, (2, 0)).expect("a start")
    };
    goes_on("rattle", &[1, 2, 44], make);
}

#[test]
fn event_detection_goes_on() {
    for (order, times) in [(6, None), (6, Some(())), (2, Some(()))] {
        let make = || {
            let mut model = Model::new(pendulum().build(), &PENDULUM);
            let state = model.state(0.0, &[1.0, 0.0], &[0.0; 2]);
            let (low, pull) = (input(Y, 0) + 0.2, input(3, 0) - 20.0);
            let events = [low, pull].map(|e| tape([1, 2, 2, 1, 3], &[e]));
            let events = events.into_iter().enumerate();
            let event = |(k, tape)| Event::new(tape, &PENDULUM, rule(k, 7 * k), k == 1);
            let times = times.map(|()| (0..70_i32).map(|k| 0.031 * f64::from(k)).collect());
            let path = Path::new(model.clone(), order);
            let stepper = Box::new(Spark::new(model.clone(), order / 2, Solver::Auto));
            let observer = observer(&model, &PENDULUM);
            let recorded = (Box::new(observer.clone()) as _, times);
            let copy = stepper.clone();
            let events = events.map(event).collect();
            let detector = Box::new(DenseDetector::new(path, copy, &state, events, recorded));
            let control = Box::new(Fixed::new(stepper, 0.0, 0.02, 150));
            let (observer, kept) = (Box::new(observer), (2, 0));
            Run::with_events(control, observer, state, kept, Some(detector)).expect("a start")
        };
        goes_on("events", &[1, 2, 3, 40, 71], make);
    }
}

#[test]
fn split_fields_go_on() {
    let pieces = every_kind(&mut Draw::new(5), 6);
    let split = Arc::new(Split::new(6, pieces).expect("proper pieces"));
    for is_compensated in [false, true] {
        let make = || {
            let volume = Volume::<f64>::new(Arc::clone(&split), is_compensated);
            let state = volume.state(&[0.1; 6]);
            let seen = volume::UserVariables { n: 6, basis: None };
            let square = tape([1, 6, 0], &[input(1, 0) * input(T, 0)]);
            let observer = volume::Observer::new(volume.clone(), seen, 1, square, &[], true);
            let scheme = Scheme::named("BM4").expect("a scheme");
            let stepper = Box::new(Composed::new(volume, scheme));
            let control = Box::new(Fixed::new(stepper, 0.0, 0.003, 60));
            Run::new(control, Box::new(observer), state, (7, 0)).expect("a start")
        };
        goes_on("a split field", &[1, 6, 7, 33], make);
    }
}

/// A series in time of a driven grid, whose parts have these bounds.
fn series_in_time(sweeper: &Sweeper<f64>, bounds: TermBounds) -> DrivenSeries {
    let driven = Driven {
        by_differences: false,
        bounds,
        breaks: Vec::new(),
        rate: 1e-9,
        tolerance: 1e-6,
    };
    let times = (1..=33).map(|k| 0.03 * f64::from(k)).collect();
    let series = DrivenSeries::new(sweeper, driven, times);
    series.expect("parts of the grid").expect("no interruption")
}

/// Magnus' steps of a driven grid to a tolerance.
fn magnus_steps(sweeper: Sweeper<f64>, bounds: TermBounds) -> MagnusSteps {
    let tolerance = MagnusTolerance {
        rate: 1e-6,
        whole: 1e-6,
        norm: 1e-5,
    };
    let nodes = Nodes::find(6, 5).expect("a method");
    let steps = MagnusSteps::new(sweeper, nodes, bounds, tolerance);
    steps.expect("parts of the grid").expect("steps")
}

#[test]
fn wave_functions_go_on() {
    type Waving = Box<dyn Stepper<State = Wave<f64>>>;
    type Stepped<'a> = (&'static str, usize, Box<dyn Fn() -> Waving + 'a>);
    let exponential = || ShearProgram {
        program: flows("SS10s35"),
        theta: 0.5,
        tolerance: 1e-6,
    };
    let sweeper = || Sweeper::<f64>::new(chain(40, 0.3));
    let grid = || Arc::new(rotor(32, 1.0));
    let scheme = Scheme::named("BM4").expect("a scheme");
    let stable = Stable::all()
        .iter()
        .find(|stable| stable.purpose == Purpose::Stability);
    let processed = || {
        let stable = stable.expect("one");
        let processor = Processor::new(stable, 0.5 * stable.limit, 1e-12).expect("a processor");
        let kernel = Shears::new(sweeper(), 0.3, 100.0);
        Processed::new(Composed::new(kernel, scheme), processor, 1e9)
    };
    let phases = || Phases::new(grid(), 1e-6).expect("T and diagonals");
    let bounds = || TermBounds {
        groups: vec![1, 1],
        parts: vec![(0.0, 128.0), (-2.0, 2.0)],
        ..TermBounds::default()
    };
    let windows = || {
        let times = (1..=33).map(|k| 0.03 * f64::from(k)).collect();
        let windows = Windows::new(vec![10, 1, 20, 2]).of(times);
        windows.expect("windows of all outputs")
    };
    let steppers: [Stepped<'_>; 9] = [
        (
            "shears",
            40,
            Box::new(|| Box::new(Composed::new(Shears::new(sweeper(), 0.3, 1e-1), scheme))),
        ),
        ("processed", 40, Box::new(|| Box::new(processed()))),
        (
            "series",
            40,
            Box::new(|| Box::new(Chebyshev::new(sweeper(), (-1.8, 2.4), 1e-9, 1e-6))),
        ),
        (
            "series of several outputs",
            40,
            Box::new(|| {
                let series = Chebyshev::new(sweeper(), (-1.8, 1.0), 1e-9, 1e-6);
                Box::new(series.with_windows(windows()))
            }),
        ),
        (
            "lanczos",
            40,
            Box::new(|| Box::new(Lanczos::new(sweeper(), 12, 1e-9, 1e-6))),
        ),
        (
            "phases",
            32,
            Box::new(|| Box::new(Composed::following(phases(), flows("BM4")))),
        ),
        (
            "series in time",
            32,
            Box::new(|| Box::new(series_in_time(&Sweeper::new(grid()), bounds()))),
        ),
        (
            "magnus",
            32,
            Box::new(|| {
                let nodes = Nodes::find(4, 2).expect("a method");
                Box::new(Magnus::new(
                    Sweeper::new(grid()),
                    nodes,
                    exponential(),
                    bounds(),
                ))
            }),
        ),
        (
            "magnus to a tolerance",
            32,
            Box::new(|| Box::new(magnus_steps(Sweeper::new(grid()), bounds()))),
        ),
    ];
    for (name, size, stepper) in &steppers {
        let make = || {
            let start = if *size == 32 {
                packet(32)
            } else {
                let (q, p) = anyhow(*size);
                Wave::new(q, p)
            };
            let observables = vec![schrodinger::Observable::Start];
            let observer = Box::new(schrodinger::Observer::new(1, true, observables));
            let stops = vec![(0.3, 9), (1.0, 20), (1.1, 4)];
            let control = Box::new(BetweenTimes::new(stepper(), 0.0, stops));
            Run::new(control, observer, start, (1, 0)).expect("a start")
        };
        goes_on(name, &[1, 8, 9, 17, 30], make);
    }
}

#[test]
fn numbers_that_are_no_counts_and_flags_are_refused() {
    for bad in [-1.0, 0.5, f64::NAN, f64::INFINITY, 1e16] {
        let mut count = 0_usize;
        assert_eq!(
            count.restore(0, &mut &[bad][..]),
            Err(CheckpointMismatch),
            "{bad}"
        );
    }
    let mut flag = false;
    assert_eq!(flag.restore(0, &mut &[2.0][..]), Err(CheckpointMismatch));
}
