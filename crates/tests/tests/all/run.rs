//! The loop keeps what it should, stops where it fails, and computes its times.

use liouville_base::cancel::{self, CancelToken};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::method::{Estimating, Stats, Stepper, Symmetric};
use liouville_base::observe::{Fitted, Monitor, Observe};
use liouville_base::run::{
    Adaptive, Advance, Fixed, Reversible, Run, Status, StepControl, Substep,
};
use liouville_tests::properties::properties;
use proptest::prelude::*;
use std::thread::sleep;
use std::time::Duration;

/// A token that is older is asked.
const TOKEN_ASKS: Duration = Duration::from_millis(41);

/// Counts its steps in the state, writes down the times it was given, and fails at one of them.
#[derive(Default)]
struct Counter {
    fails_at: Option<usize>,
    made: usize,
    wanted: Option<(f64, f64)>,
}

impl Checkpoint for Counter {}

impl Stepper for Counter {
    type State = usize;

    fn step(&mut self, t: f64, h: f64, state: &mut usize) -> Result<(), StepError> {
        if self.fails_at == Some(*state) {
            return Err(StepError::SingularNewton);
        }
        if let Some((t0, wanted)) = self.wanted {
            assert_eq!(t.to_bits(), time(t0, *state, h).to_bits());
            assert_eq!(h.to_bits(), wanted.to_bits());
        }
        *state += 1;
        self.made += 1;
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats {
            iterations: self.made,
            ..Stats::default()
        }
    }
}

/// Records the count and its square, but nothing later than a time.
struct Look {
    until: f64,
}

const BLIND: StepError = StepError::NotFinite {
    quantity: Quantity::Observable,
    index: 0,
    t: 0.0,
};

impl Checkpoint for Look {}

impl Observe<usize> for Look {
    fn width(&self, _: &usize) -> usize {
        2
    }

    fn observe(&mut self, t: f64, state: &usize, row: &mut Vec<f64>) -> Result<(), StepError> {
        if t > self.until {
            return Err(BLIND);
        }
        row.extend([real(*state), real(*state * *state)]);
        Ok(())
    }
}

#[allow(clippy::cast_precision_loss)]
fn real(k: usize) -> f64 {
    k as f64
}

fn time(t0: f64, n: usize, h: f64) -> f64 {
    t0 + real(n) * h
}

/// Steps of equal size, and how many of their states are kept.
#[derive(Clone, Copy)]
struct Span {
    t0: f64,
    h: f64,
    steps: usize,
    every: usize,
}

fn run(span: Span, fails_at: Option<usize>, until: f64) -> Run<usize> {
    let stepper = Box::new(Counter {
        fails_at,
        wanted: Some((span.t0, span.h)),
        made: 0,
    });
    let Span {
        t0,
        h,
        steps,
        every,
    } = span;
    let control = Box::new(Fixed::new(stepper, t0, h, steps));
    let kept = (every, steps / every + 2);
    Run::new(control, Box::new(Look { until }), 0, kept).expect("the start can be recorded")
}

const ALL_DAY: Duration = Duration::from_secs(86400);

/// The counts that were recorded, after checking their times and rows.
fn records(run: &mut impl Advance, span: Span) -> Vec<usize> {
    let (times, rows) = run.take();
    assert_eq!(rows.len(), 2 * times.len());
    let count = |row: &[f64]| {
        let n = (0..=span.steps).find(|n| real(*n).to_bits() == row[0].to_bits());
        n.expect("a count")
    };
    let counts: Vec<usize> = rows.chunks(2).map(count).collect();
    for ((t, n), row) in times.iter().zip(&counts).zip(rows.chunks(2)) {
        assert_eq!(t.to_bits(), time(span.t0, *n, span.h).to_bits());
        assert_eq!(row[1].to_bits(), real(n * n).to_bits());
    }
    counts
}

fn span(steps: usize, every: usize) -> Span {
    Span {
        t0: 0.1,
        h: 0.7,
        steps,
        every,
    }
}

proptest! {
    #![proptest_config(properties(256))]

    #[test]
    fn every_kth_step_and_the_last_are_kept(
        steps in 0..200_usize,
        every in 1..250_usize,
        t0 in -1e6..1e6,
        h in prop_oneof![1e-9..1e3, -1e3..-1e-9],
    ) {
        let span = Span { t0, h, steps, every };
        let mut run = run(span, None, f64::INFINITY);
        prop_assert_eq!(run.advance(ALL_DAY), Status::Done);
        prop_assert_eq!((run.done(), run.stats().0.iterations), (steps, steps));
        prop_assert_eq!(run.time().to_bits(), time(t0, steps, h).to_bits());
        let wanted: Vec<usize> =
            (0..=steps).filter(|n| n.is_multiple_of(every) || *n == steps).collect();
        prop_assert_eq!(records(&mut run, span), wanted);
    }

    #[test]
    fn a_failing_step_leaves_the_records_before_it_and_the_last_state(
        steps in 1..100_usize,
        every in 1..20_usize,
        at in any::<prop::sample::Index>(),
    ) {
        let (span, n) = (span(steps, every), at.index(steps));
        let mut run = run(span, Some(n), f64::INFINITY);
        let failed = Status::Failed {
            n,
            t: time(span.t0, n, span.h),
            error: StepError::SingularNewton,
        };
        prop_assert_eq!(run.advance(ALL_DAY), failed);
        prop_assert_eq!(run.done(), n);
        let wanted: Vec<usize> =
            (0..=n).filter(|k| k.is_multiple_of(every) || *k == n).collect();
        prop_assert_eq!(records(&mut run, span), wanted);
    }

    #[test]
    fn pauses_change_nothing(steps in 0..50_usize, every in 1..9_usize) {
        let span = span(steps, every);
        let mut paused = run(span, None, f64::INFINITY);
        let mut pauses = 0;
        while paused.advance(Duration::ZERO) == Status::Paused {
            pauses += 1;
            prop_assert_eq!(paused.done(), pauses);
        }
        prop_assert_eq!(pauses, steps.saturating_sub(1));
        let mut whole = run(span, None, f64::INFINITY);
        whole.advance(ALL_DAY);
        prop_assert_eq!(paused.take(), whole.take());
    }
}

#[test]
fn an_interrupted_run_ends_with_its_present_state() {
    for (made, wanted) in [(1, vec![0, 1]), (4, vec![0, 2, 4]), (5, vec![0, 2, 4, 5])] {
        let span = span(9, 2);
        let mut run = run(span, None, f64::INFINITY);
        for _ in 0..made {
            assert_eq!(run.advance(Duration::ZERO), Status::Paused);
        }
        assert_eq!(records(&mut run, span), wanted);
    }
}

#[test]
fn a_run_over_is_over() {
    let span = span(3, 2);
    let mut run = run(span, None, f64::INFINITY);
    assert_eq!(run.advance(ALL_DAY), Status::Done);
    assert_eq!(run.advance(ALL_DAY), Status::Done);
    assert_eq!(run.stats().0.iterations, 3);
    assert_eq!(records(&mut run, span), [0, 2, 3]);
}

#[test]
fn a_start_that_cannot_be_recorded_is_refused() {
    let look = Look { until: 0.0 };
    let control = Box::new(Fixed::new(Box::new(Counter::default()), 0.1, 0.7, 3));
    let refused = Run::new(control, Box::new(look), 0, (1, 4)).err();
    assert_eq!(refused, Some(BLIND));
}

#[test]
fn a_step_that_cannot_be_recorded_fails() {
    let span = span(10, 2);
    let mut run = run(span, None, time(span.t0, 5, span.h));
    let failed = Status::Failed {
        n: 5,
        t: time(span.t0, 5, span.h),
        error: BLIND,
    };
    assert_eq!(run.advance(ALL_DAY), failed);
    assert_eq!(records(&mut run, span), [0, 2, 4]);
}

#[test]
fn a_long_run_pauses() {
    let span = span(1 << 60, 1 << 60);
    let mut run = run(span, None, f64::INFINITY);
    assert_eq!(run.advance(Duration::from_millis(1)), Status::Paused);
    assert!((1..1 << 40).contains(&run.done()));
}

/// A method whose error is (h/wanted)³ with `wanted` small around t = 0.5; its state is where it is.
struct Passage {
    narrow: f64,
    error: f64,
    before: f64,
}

impl Checkpoint for Passage {}

impl Stepper for Passage {
    type State = f64;

    fn step(&mut self, t: f64, h: f64, state: &mut f64) -> Result<(), StepError> {
        assert!((t - *state).abs() < 1e-14, "the state is where the run is");
        if h.abs() > 0.5 {
            return Err(StepError::SingularNewton);
        }
        let wanted = if (t + h / 2.0 - 0.5).abs() < 0.1 {
            self.narrow
        } else {
            0.2
        };
        self.error = (h / wanted).abs().powi(3);
        self.before = *state;
        *state = t + h;
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats::default()
    }
}

impl Estimating for Passage {
    fn error(&self) -> f64 {
        self.error
    }

    fn error_order(&self) -> f64 {
        3.0
    }

    fn undo(&mut self, state: &mut f64) {
        *state = self.before;
    }
}

struct Place;

impl Checkpoint for Place {}

impl Observe<f64> for Place {
    fn width(&self, _: &f64) -> usize {
        1
    }

    fn observe(&mut self, _: f64, state: &f64, row: &mut Vec<f64>) -> Result<(), StepError> {
        row.push(*state);
        Ok(())
    }
}

fn passage(t: (f64, f64), narrow: f64, least: f64) -> Run<f64> {
    let stepper = Box::new(Passage {
        narrow,
        error: 0.0,
        before: 0.0,
    });
    let control = Box::new(Adaptive::new(stepper, t, 2.0, least));
    Run::new(control, Box::new(Place), t.0, (1, 0)).expect("the start can be recorded")
}

proptest! {
    #![proptest_config(properties(256))]

    #[test]
    fn controlled_steps_follow_the_error_and_end_where_they_should(
        narrow in 1e-4..0.2,
        t1 in prop_oneof![0.7..3.0, -3.0..-1.0],
    ) {
        let mut run = passage((0.0, t1), narrow, 1e-9);
        prop_assert_eq!(run.advance(ALL_DAY), Status::Done);
        let (times, rows) = run.take();
        prop_assert_eq!(times.last().copied().map(f64::to_bits), Some(t1.to_bits()));
        prop_assert_eq!(times.len(), run.done() + 1);
        let apart = times.iter().zip(&rows).map(|(t, place)| (t - place).abs());
        prop_assert!(apart.fold(0.0, f64::max) < 1e-14);
        let sizes: Vec<f64> = times.windows(2).map(|t| (t[1] - t[0]).abs()).collect();
        for (t, h) in times.iter().zip(&sizes) {
            let middle = t + h.copysign(t1) / 2.0;
            let wanted = if (middle - 0.5).abs() < 0.0999 { narrow } else { 0.2 };
            prop_assert!(*h <= wanted * 1.0001, "step {} at {}", h, t);
        }
        // in the narrow passage steps are as long as the error allows, but for the safety factor
        let inside = times.iter().filter(|t| (**t - 0.5).abs() < 0.1).count();
        prop_assert!(t1 < 0.0 || real(inside) < 0.2 / (0.6 * narrow) + 12.0);
        prop_assert!(run.stats().1 > 0, "the first step was too long");
    }
}

/// A method whose steps are all refused, and which cancels what the thread does in its second one.
struct Refused(usize);

impl Checkpoint for Refused {}

impl Stepper for Refused {
    type State = f64;

    fn step(&mut self, _: f64, _: f64, _: &mut f64) -> Result<(), StepError> {
        self.0 += 1;
        assert!(self.0 <= 2, "the run goes on after it was cancelled");
        if self.0 == 2 {
            sleep(TOKEN_ASKS);
        }
        Err(StepError::SingularNewton)
    }

    fn stats(&self) -> Stats {
        Stats::default()
    }
}

impl Estimating for Refused {
    fn error(&self) -> f64 {
        f64::INFINITY
    }

    fn error_order(&self) -> f64 {
        3.0
    }

    fn undo(&mut self, _: &mut f64) {}
}

#[test]
fn a_step_that_is_refused_again_and_again_is_cancelled_in_between() {
    let control = Box::new(Adaptive::new(Box::new(Refused(0)), (0.0, 1.0), 0.5, 1e-300));
    let mut run = Run::new(control, Box::new(Place), 0.0, (1, 0)).expect("a start");
    let status = cancel::within(CancelToken::new(|| true), || run.advance(ALL_DAY));
    let (n, t, error) = (0, 0.0, StepError::Interrupted);
    assert_eq!(status, Status::Failed { n, t, error });
    assert!(!cancel::is_cancelled(), "the token is that of the run");
}

#[test]
fn a_substep_of_a_cancelled_run_is_not_made() {
    let counter = Box::new(Counter::default());
    let mut substep = Substep::new(counter, &0);
    substep.h = 1.0;
    let made = cancel::within(CancelToken::new(|| true), || {
        sleep(TOKEN_ASKS);
        // once cancelled, always: the signal is told once
        [0.5, 0.25].map(|part| substep.advance_to_fraction(part, &7))
    });
    assert_eq!(
        made,
        [Err(StepError::Interrupted), Err(StepError::Interrupted)]
    );
    assert_eq!(substep.advance_to_fraction(0.5, &7), Ok(0.5));
}

#[test]
fn a_step_below_the_least_ends_the_run_at_the_last_good_state() {
    let mut run = passage((0.0, 1.0), 1e-5, 1e-3);
    let Status::Failed { n, t, error } = run.advance(ALL_DAY) else {
        panic!("the passage is too narrow");
    };
    let StepError::StepTooSmall { h, error } = error else {
        panic!("{error}");
    };
    assert!(h < 1e-3 && error > 1.0);
    let (times, rows) = run.take();
    assert_eq!(times.len(), n + 1);
    assert_eq!(times[n].to_bits(), t.to_bits());
    assert!((rows[n] - t).abs() < 1e-14);
    assert!(
        (0.3..0.41).contains(&t),
        "it stands before the passage, at {t}"
    );
}

#[test]
fn a_step_without_a_solution_is_tried_shorter_until_it_is_the_least() {
    let mut run = passage((0.0, 100.0), 0.2, 1.0);
    assert!(matches!(
        run.advance(ALL_DAY),
        Status::Failed {
            n: 0,
            error: StepError::StepTooSmall { .. },
            ..
        }
    ));
}

/// Walks along a line at the speed it has, ±1.
struct Walk;

impl Checkpoint for Walk {}

impl Stepper for Walk {
    type State = (f64, f64);

    fn step(&mut self, _: f64, h: f64, (x, v): &mut (f64, f64)) -> Result<(), StepError> {
        *x += h * *v;
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats::default()
    }
}

impl Symmetric for Walk {}

/// A monitor exp(a sin(x) / b), rough where b is small.
struct Bumps(f64, f64);

impl Checkpoint for Bumps {}

impl Monitor<(f64, f64)> for Bumps {
    fn rate(&mut self, _: f64, (x, v): &(f64, f64)) -> Result<f64, StepError> {
        Ok(v * self.0 / self.1 * (x / self.1).cos())
    }
}

proptest! {
    #![proptest_config(properties(256))]

    #[test]
    fn reversible_steps_go_back_however_rough_their_monitor(
        a in 0.1..5.0,
        b in 0.1..2.0,
        h in 0.01..0.5,
        sign in prop_oneof![Just(1.0), Just(-1.0)],
    ) {
        let mut state = (0.3, 1.0);
        let mut sizes = Vec::new();
        let walk = |h, state: &(f64, f64)| {
            let (ends, monitor) = ((0.0, sign * 1e9), Box::new(Bumps(a, b)));
            Reversible::new(Box::new(Walk), ends, (h, 1e-300), monitor, state)
        };
        let mut there = walk(h, &state);
        for _ in 0..6 {
            let before = there.time();
            there.step(&mut state).expect("steps are positive");
            sizes.push((there.time() - before).abs());
        }
        for pair in sizes.windows(2) {
            let ratio = pair[1] / pair[0];
            prop_assert!((0.44..2.26).contains(&ratio), "{} after {}", pair[1], pair[0]);
        }
        let next = there.sizes().expect("it has sizes").next;
        state.1 = -state.1;
        let mut back = walk(next, &state);
        for size in sizes.iter().rev() {
            let before = back.time();
            back.step(&mut state).expect("steps are positive");
            let again = (back.time() - before).abs();
            prop_assert!((again / size - 1.0).abs() < 1e-6, "{again} for {size}");
        }
        prop_assert!((state.0 - 0.3).abs() < 1e-6);
    }
}

/// Walks with an error of (h r)³ tolerances, r = 1 up to x = 5 and 3 beyond, of which its monitor knows nothing.
struct Rougher {
    error: f64,
    before: (f64, f64),
}

impl Checkpoint for Rougher {}

impl Stepper for Rougher {
    type State = (f64, f64);

    fn step(&mut self, t: f64, h: f64, state: &mut (f64, f64)) -> Result<(), StepError> {
        self.before = *state;
        self.error = (h * if state.0 < 5.0 { 1.0 } else { 3.0 }).powi(3);
        Walk.step(t, h, state)
    }

    fn stats(&self) -> Stats {
        Stats::default()
    }
}

impl Estimating for Rougher {
    fn error(&self) -> f64 {
        self.error
    }

    fn error_order(&self) -> f64 {
        3.0
    }

    fn undo(&mut self, state: &mut (f64, f64)) {
        *state = self.before;
    }
}

struct Even;

impl Checkpoint for Even {}

impl Monitor<(f64, f64)> for Even {
    fn rate(&mut self, _: f64, _: &(f64, f64)) -> Result<f64, StepError> {
        Ok(0.0)
    }
}

impl Fitted<(f64, f64)> for Even {
    fn quantity(&mut self, _: f64, _: &(f64, f64)) -> f64 {
        1.0
    }

    fn fit(&mut self, _: f64, _: f64) {}
}

#[test]
fn a_reversible_step_of_more_than_two_tolerances_is_made_again() {
    let mut state = (0.0, 1.0);
    let stepper = || {
        let (error, before) = (0.0, state);
        Box::new(Rougher { error, before }) as Box<dyn Estimating<State = _>>
    };
    let steppers = [stepper(), stepper()];
    let (ends, sizes) = ((0.0, 10.0), (0.5, 1e-9));
    let mut control =
        Reversible::within_tolerance(steppers, 4, ends, sizes, Box::new(Even), &state);
    let mut made = 0;
    while control.time() < 10.0 - 1e-9 {
        let (at, before) = (control.time(), state.0);
        control.step(&mut state).expect("steps are not too small");
        let h = control.time() - at;
        let error = (h * if before < 5.0 { 1.0 } else { 3.0 }).powi(3);
        assert!(error <= 2.0 + 1e-9, "{error} tolerances at {at}");
        made += 1;
    }
    assert!((10..100).contains(&made), "{made} steps");
}

/// More numbers than any memory holds.
const ENDLESS: usize = 1 << 58;

/// Records the count, in rows that are endless from some count on.
struct Growing {
    from: usize,
}

impl Checkpoint for Growing {}

impl Observe<usize> for Growing {
    fn width(&self, state: &usize) -> usize {
        if *state < self.from { 1 } else { ENDLESS }
    }

    fn observe(&mut self, _: f64, state: &usize, row: &mut Vec<f64>) -> Result<(), StepError> {
        row.push(real(*state));
        Ok(())
    }
}

fn growing(from: usize) -> Result<Run<usize>, StepError> {
    let control = Box::new(Fixed::new(Box::new(Counter::default()), 0.0, 1.0, 20));
    Run::new(control, Box::new(Growing { from }), 0, (1, 21))
}

#[test]
fn records_that_do_not_fit_end_the_run_with_those_before() {
    let mut run = growing(7).expect("the start fits");
    let (n, t, error) = (6, 6.0, StepError::NoMemory);
    assert_eq!(run.advance(ALL_DAY), Status::Failed { n, t, error });
    let (times, rows) = run.take();
    assert_eq!(times, (0..7).map(real).collect::<Vec<_>>());
    assert_eq!(rows, times);
    assert_eq!(growing(0).err(), Some(StepError::NoMemory));
}
