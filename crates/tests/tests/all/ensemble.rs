//! An ensemble is its members, bit for bit, for any grouping and any failures.

use liouville_base::cancel::{self, CancelToken};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::ensemble::{Ensemble, RecordLayout};
use liouville_base::error::StepError;
use liouville_base::method::{Stats, Stepper};
use liouville_base::observe::Observe;
use liouville_base::run::{Advance, Fixed, Run, Span, Status};
use std::thread;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);

/// Turns an angle by a nonlinear map, and fails at one of its steps.
struct Turning {
    rate: f64,
    made: usize,
    fails_at: usize,
    error: StepError,
}

impl Checkpoint for Turning {}

impl Stepper for Turning {
    type State = f64;

    fn step(&mut self, t: f64, h: f64, x: &mut f64) -> Result<(), StepError> {
        if self.made == self.fails_at {
            return Err(self.error.clone());
        }
        self.made += 1;
        *x += h * (self.rate * *x + t).sin();
        Ok(())
    }

    fn stats(&self) -> Stats {
        Stats {
            evaluations: self.made,
            ..Stats::default()
        }
    }
}

/// Records an angle and its sine: so many rows a state.
struct Angle {
    rows: fn(f64) -> usize,
}

impl Checkpoint for Angle {}

impl Observe<f64> for Angle {
    fn width(&self, _: &f64) -> usize {
        2
    }

    fn observe(&mut self, _: f64, x: &f64, row: &mut Vec<f64>) -> Result<(), StepError> {
        for _ in 0..(self.rows)(*x) {
            row.extend([*x, x.sin()]);
        }
        Ok(())
    }
}

const H: f64 = 0.3;
const STEPS: usize = 101;
const EVERY: usize = 4;
const RUNS: usize = 9;
/// Each run steps two members.
const MEMBERS: usize = 2;
const SINGULAR: StepError = StepError::Singular {
    piece: 3,
    member: 0,
    t: 0.0,
};

/// The run at a place; those of `failures` fail at a step.
fn run(
    place: usize,
    steps: usize,
    failures: &[(usize, usize)],
    rows: fn(f64) -> usize,
) -> Run<f64> {
    let failure = failures.iter().find(|(failing, _)| *failing == place);
    #[allow(clippy::cast_precision_loss)]
    let x = 0.1 + place as f64;
    let stepper = Box::new(Turning {
        rate: 1.0 + 0.1 * x,
        made: 0,
        fails_at: failure.map_or(usize::MAX, |(_, step)| *step),
        error: if place == 6 {
            StepError::SingularNewton
        } else {
            SINGULAR
        },
    });
    let control = Box::new(Fixed::new(stepper, 0.5, H, steps));
    Run::new(control, Box::new(Angle { rows }), x, (EVERY, 0)).expect("the start can be recorded")
}

/// Runs of blocks of two members: each has the angle of its own place, and fails with its first member.
struct Pair {
    runs: Vec<Run<f64>>,
}

impl Advance for Pair {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let made = self.runs.iter().map(Advance::done).min().unwrap_or(0);
        for step in made + 1..=steps.min(STEPS) {
            for (place, run) in self.runs.iter_mut().enumerate() {
                if let Status::Failed { n, t, error } = run.advance_to(step, ALL_DAY) {
                    let error = error.of_member(place);
                    return Status::Failed { n, t, error };
                }
            }
            if budget.is_zero() {
                break;
            }
        }
        if self.done() == STEPS {
            Status::Done
        } else {
            Status::Paused
        }
    }

    fn done(&self) -> usize {
        self.runs.iter().map(Advance::done).min().unwrap_or(0)
    }

    fn time(&self) -> f64 {
        self.runs[0].time()
    }

    fn stats(&self) -> (Stats, usize) {
        let all = self.runs.iter().map(|run| run.stats().0);
        (all.fold(Stats::default(), |sum, stats| sum + stats), 0)
    }

    fn stats_of(&self, place: usize) -> (Stats, usize) {
        self.runs[place].stats()
    }

    fn shape(&self) -> Vec<usize> {
        vec![2 * self.runs.len()]
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let records: Vec<_> = self.runs.iter_mut().map(Advance::take).collect();
        let count = records
            .iter()
            .map(|(times, _)| times.len())
            .min()
            .unwrap_or(0);
        let rows = (0..count).flat_map(|k| {
            let row = |(_, rows): &(Vec<f64>, Vec<f64>)| rows[2 * k..2 * k + 2].to_vec();
            records.iter().flat_map(row).collect::<Vec<f64>>()
        });
        (records[0].0[..count].to_vec(), rows.collect())
    }
}

fn ensemble(threads: usize, failures: &'static [(usize, usize)]) -> Ensemble {
    let begin = move |members: &[usize]| -> Result<Box<dyn Advance>, StepError> {
        let one = |member: &usize| run(*member, STEPS, failures, |_| 1);
        Ok(Box::new(Pair {
            runs: members.iter().map(one).collect(),
        }))
    };
    let span = Span {
        t0: 0.5,
        t1: 0.5 + STEPS as f64 * H,
        steps: STEPS,
        every: EVERY,
    };
    let layout = RecordLayout::Aligned {
        times: span.times().expect("few"),
        width: 2,
    };
    Ensemble::new(Box::new(begin), (RUNS, MEMBERS), threads, layout, 0.5)
}

/// What the runs record alone, laid out side by side for this many times.
fn alone(kept: usize) -> (Vec<f64>, Vec<f64>) {
    let records: Vec<_> = (0..RUNS)
        .map(|place| {
            let mut run = run(place, STEPS, &[], |_| 1);
            assert_eq!(run.advance(ALL_DAY), Status::Done);
            run.take()
        })
        .collect();
    let rows = (0..kept).flat_map(|k| {
        let row = |(_, rows): &(Vec<f64>, Vec<f64>)| rows[2 * k..2 * k + 2].to_vec();
        records.iter().flat_map(row).collect::<Vec<f64>>()
    });
    (records[0].0[..kept].to_vec(), rows.collect())
}

const KEPT: usize = STEPS.div_ceil(EVERY) + 1;

/// Advances by slices of this length to the end.
fn finish(ensemble: &mut Ensemble, slice: Duration) -> Status {
    loop {
        match ensemble.advance(slice) {
            Status::Paused => {}
            status => return status,
        }
    }
}

#[test]
fn an_ensemble_is_its_members_for_any_number_of_threads() {
    let wanted = alone(KEPT);
    for threads in [1, 2, 3, 64] {
        for slice in [ALL_DAY, Duration::ZERO] {
            let mut ensemble = ensemble(threads, &[]);
            assert_eq!(ensemble.time().to_bits(), 0.5_f64.to_bits());
            assert_eq!(finish(&mut ensemble, slice), Status::Done);
            assert_eq!((ensemble.done(), ensemble.over()), (STEPS, RUNS));
            assert_eq!(ensemble.stats().0.evaluations, RUNS * STEPS);
            assert_eq!(ensemble.advance(slice), Status::Done);
            assert_eq!(ensemble.take(), wanted);
        }
    }
}

#[test]
fn a_member_that_fails_leaves_the_others_as_they_are() {
    // two of one block, one of another, and one at its very first step
    const FAILURES: &[(usize, usize)] = &[(0, 70), (1, 38), (4, 38), (8, 0)];
    let (times, mut rows) = alone(KEPT);
    for (member, step) in FAILURES {
        for k in step / EVERY + 1..KEPT {
            rows[(k * RUNS + member) * 2..][..2].fill(f64::NAN);
        }
    }
    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    for threads in [1, 2, 3] {
        for slice in [ALL_DAY, Duration::ZERO] {
            let mut ensemble = ensemble(threads, FAILURES);
            assert_eq!(finish(&mut ensemble, slice), Status::Done);
            let found = ensemble.failures();
            for (failure, (member, step)) in found.iter().zip(FAILURES) {
                #[allow(clippy::cast_precision_loss)]
                let t = 0.5 + *step as f64 * H;
                assert_eq!((failure.member, failure.step), (*member, Some((*step, t))));
            }
            assert_eq!((found.len(), ensemble.over()), (FAILURES.len(), RUNS));
            // those of others in the block of one that failed are made again, and counted once
            let whole = (RUNS - FAILURES.len()) * STEPS;
            let made = whole + FAILURES.iter().map(|(_, step)| step).sum::<usize>();
            assert_eq!(ensemble.stats().0.evaluations, made);
            let (found_times, found_rows) = ensemble.take();
            assert_eq!(found_times, times);
            assert_eq!(bits(&found_rows), bits(&rows));
        }
    }
}

#[test]
fn an_interrupted_ensemble_has_the_members_it_came_to() {
    let mut ensemble = ensemble(1, &[]);
    while ensemble.over() < 4 {
        assert_eq!(ensemble.advance(Duration::ZERO), Status::Paused);
    }
    assert!((1..STEPS).contains(&ensemble.done()));
    let (times, rows) = ensemble.take();
    let (wanted_times, wanted) = alone(KEPT);
    assert_eq!(times, wanted_times);
    for (k, (row, wanted)) in rows
        .chunks(2 * RUNS)
        .zip(wanted.chunks(2 * RUNS))
        .enumerate()
    {
        assert_eq!(row[..8], wanted[..8], "record {k}");
        assert!(row[12..].iter().all(|x| x.is_nan()));
    }
}

#[test]
fn rows_of_their_own_come_one_run_after_another() {
    let rows: fn(f64) -> usize = |x| match x.sin() {
        y if y > 0.5 => 2,
        y if y > -0.5 => 0,
        _ => 1,
    };
    let begin = move |members: &[usize]| -> Result<Box<dyn Advance>, StepError> {
        Ok(Box::new(run(members[0], STEPS, &[], rows)))
    };
    let mut wanted = (Vec::new(), Vec::new());
    for place in 0..RUNS {
        let mut run = run(place, STEPS, &[], rows);
        assert_eq!(run.advance(ALL_DAY), Status::Done);
        let (times, rows) = run.take();
        wanted.0.extend(times);
        wanted.1.extend(rows);
    }
    let layout = RecordLayout::Ragged { width: 2 };
    let mut ensemble = Ensemble::new(Box::new(begin), (RUNS, 1), 2, layout, 0.5);
    assert_eq!(ensemble.shape(), [2]);
    assert_eq!(finish(&mut ensemble, ALL_DAY), Status::Done);
    assert!(wanted.0.len() > 50 && wanted.0.len() != RUNS * KEPT);
    assert_eq!(ensemble.take(), wanted);
}

/// A run whose only step goes on until it is cancelled.
struct Endless;

impl Advance for Endless {
    fn advance_to(&mut self, _: usize, _: Duration) -> Status {
        while !cancel::is_cancelled() {
            thread::yield_now();
        }
        let (n, t, error) = (0, 0.5, StepError::Interrupted);
        Status::Failed { n, t, error }
    }

    fn done(&self) -> usize {
        0
    }

    fn time(&self) -> f64 {
        0.5
    }

    fn stats(&self) -> (Stats, usize) {
        Default::default()
    }

    fn shape(&self) -> Vec<usize> {
        vec![2]
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        Default::default()
    }
}

/// One thread alone may be asked, as signals reach the main one.
#[test]
fn steps_of_members_are_cancelled_on_all_threads_and_no_member_fails() {
    for threads in [1, 3] {
        let begin = |_: &[usize]| -> Result<Box<dyn Advance>, StepError> { Ok(Box::new(Endless)) };
        let (times, width) = (vec![0.5, 0.8], 2);
        let layout = RecordLayout::Aligned { times, width };
        let mut ensemble = Ensemble::new(Box::new(begin), (RUNS, 1), threads, layout, 0.5);
        let here = thread::current().id();
        let token = CancelToken::new(move || thread::current().id() == here);
        let status = cancel::within(token, || ensemble.advance(ALL_DAY));
        assert_eq!(status, Status::Paused);
        assert!(ensemble.failures().is_empty());
        assert_eq!(ensemble.over(), 0);
    }
}

#[test]
fn an_ensemble_whose_table_does_not_fit_fails_once_and_names_no_member() {
    for threads in [1, 3] {
        let begin = |members: &[usize]| -> Result<Box<dyn Advance>, StepError> {
            Ok(Box::new(run(members[0], STEPS, &[], |_| 1)))
        };
        let (times, width) = (vec![0.5, 0.8], 1 << 58);
        let layout = RecordLayout::Aligned { times, width };
        let mut ensemble = Ensemble::new(Box::new(begin), (RUNS, 1), threads, layout, 0.5);
        let status = finish(&mut ensemble, ALL_DAY);
        let error = StepError::NoMemory;
        assert!(matches!(status, Status::Failed { error: found, .. } if found == error));
        assert!(ensemble.is_short());
        assert!(ensemble.failures().is_empty());
        assert_eq!(ensemble.take(), (vec![], vec![]));
    }
}
