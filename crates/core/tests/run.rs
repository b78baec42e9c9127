//! The loop keeps what it should, stops where it fails, and computes its times.

use liouville_core::method::{Stats, Stepper};
use liouville_core::problem::Observe;
use liouville_core::run::{Advance, Run, Span, Status};
use liouville_core::trouble::{Quantity, Trouble};
use proptest::prelude::*;
use std::time::Duration;

/// Counts its steps in the state, writes down the times it was given, and fails at one of them.
#[derive(Default)]
struct Counter {
    fails_at: Option<usize>,
    made: usize,
    wanted: Option<(f64, f64)>,
}

impl Stepper for Counter {
    type State = usize;

    fn step(&mut self, t: f64, h: f64, state: &mut usize) -> Result<(), Trouble> {
        if self.fails_at == Some(*state) {
            return Err(Trouble::SingularNewton);
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

const BLIND: Trouble = Trouble::NotFinite {
    quantity: Quantity::Observable,
    index: 0,
    t: 0.0,
};

impl Observe for Look {
    type State = usize;

    fn width(&self) -> usize {
        2
    }

    fn observe(&mut self, t: f64, state: &usize, row: &mut Vec<f64>) -> Result<(), Trouble> {
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

fn run(span: Span, fails_at: Option<usize>, until: f64) -> Run<Counter, Look> {
    let stepper = Counter {
        fails_at,
        wanted: Some((span.t0, span.h)),
        made: 0,
    };
    Run::new(stepper, Look { until }, 0, span).expect("the start can be recorded")
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
    #![proptest_config(ProptestConfig {
        cases: if cfg!(miri) { 8 } else { 256 },
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

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
        prop_assert_eq!((run.done(), run.stats().iterations), (steps, steps));
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
            trouble: Trouble::SingularNewton,
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
        prop_assert_eq!(pauses, steps);
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
    assert_eq!(run.stats().iterations, 3);
    assert_eq!(records(&mut run, span), [0, 2, 3]);
}

#[test]
fn a_start_that_cannot_be_recorded_is_refused() {
    let look = Look { until: 0.0 };
    let refused = Run::new(Counter::default(), look, 0, span(3, 1)).err();
    assert_eq!(refused, Some(BLIND));
}

#[test]
fn a_step_that_cannot_be_recorded_fails() {
    let span = span(10, 2);
    let mut run = run(span, None, time(span.t0, 5, span.h));
    let failed = Status::Failed {
        n: 5,
        t: time(span.t0, 5, span.h),
        trouble: BLIND,
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
