//! An ensemble is its runs: bit for bit, whoever steps them, and however it ends.

use liouville_core::ensemble::{Ensemble, Layout};
use liouville_core::memory::Memory;
use liouville_core::method::{Stats, Stepper};
use liouville_core::problem::Observe;
use liouville_core::run::{Advance, Equal, Run, Status};
use liouville_core::trouble::Trouble;
use std::time::Duration;

const ALL_DAY: Duration = Duration::from_secs(86400);

/// Turns an angle by a nonlinear map, and fails at one of its steps.
struct Turning {
    rate: f64,
    made: usize,
    fails_at: usize,
    trouble: Trouble,
}

impl Memory for Turning {}

impl Stepper for Turning {
    type State = f64;

    fn step(&mut self, t: f64, h: f64, x: &mut f64) -> Result<(), Trouble> {
        if self.made == self.fails_at {
            return Err(self.trouble.clone());
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

impl Memory for Angle {}

impl Observe<f64> for Angle {
    fn width(&self, _: &f64) -> usize {
        2
    }

    fn observe(&mut self, _: f64, x: &f64, row: &mut Vec<f64>) -> Result<(), Trouble> {
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
const SINGULAR: Trouble = Trouble::Singular {
    piece: 3,
    member: 1,
    t: 0.0,
};

/// The run at a place; those of `failures` fail at a step.
fn run(
    place: usize,
    steps: usize,
    failures: &[(usize, usize)],
    rows: fn(f64) -> usize,
) -> Run<Turning, Angle, Equal> {
    let failure = failures.iter().find(|(failing, _)| *failing == place);
    #[allow(clippy::cast_precision_loss)]
    let x = 0.1 + place as f64;
    let stepper = Turning {
        rate: 1.0 + 0.1 * x,
        made: 0,
        fails_at: failure.map_or(usize::MAX, |(_, step)| *step),
        trouble: if place == 6 {
            Trouble::SingularNewton
        } else {
            SINGULAR
        },
    };
    let pace = Equal::new(0.5, H, steps);
    Run::new(stepper, Angle { rows }, x, pace, EVERY, 0).expect("the start can be recorded")
}

fn ensemble(threads: usize, steps: usize, failures: &[(usize, usize)]) -> Ensemble {
    let runs = (0..RUNS).map(|place| -> (Box<dyn Advance + Sync>, usize) {
        (Box::new(run(place, steps, failures, |_| 1)), MEMBERS)
    });
    Ensemble::new(runs.collect(), threads, Layout::Together)
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
fn an_ensemble_is_its_runs_for_any_number_of_threads() {
    let wanted = alone(KEPT);
    for threads in [1, 2, 3, 64] {
        for slice in [ALL_DAY, Duration::ZERO] {
            let mut ensemble = ensemble(threads, STEPS, &[]);
            assert_eq!(ensemble.time().to_bits(), 0.5_f64.to_bits());
            assert_eq!(finish(&mut ensemble, slice), Status::Done);
            assert_eq!(ensemble.done(), STEPS);
            assert_eq!(ensemble.stats().0.evaluations, RUNS * STEPS);
            assert_eq!(ensemble.advance(slice), Status::Done);
            assert_eq!(ensemble.take(), wanted);
        }
    }
}

#[test]
fn the_earliest_failure_is_told_whoever_finds_it() {
    // run 4 fails first, run 6 with it, and run 0 before anybody may have got so far
    let failures = [(0, 70), (4, 38), (6, 38), (8, 39)];
    for threads in [1, 2, 3] {
        for slice in [ALL_DAY, Duration::ZERO] {
            let mut ensemble = ensemble(threads, STEPS, &failures);
            let Status::Failed { n, t, trouble } = finish(&mut ensemble, slice) else {
                panic!("runs fail");
            };
            assert_eq!((n, t.to_bits()), (38, (0.5 + 38.0 * H).to_bits()));
            let member = 4 * MEMBERS + 1;
            let Trouble::Singular {
                piece: 3,
                member: found,
                ..
            } = trouble
            else {
                panic!("{trouble}");
            };
            assert_eq!(found, member);
            assert_eq!(ensemble.time().to_bits(), t.to_bits());
            // records 0, 4, .. 36 are there for all
            assert_eq!(ensemble.take(), alone(10));
        }
    }
}

#[test]
fn a_trouble_that_knows_no_members_is_told_with_one() {
    let mut ensemble = ensemble(2, STEPS, &[(6, 0)]);
    let Status::Failed { n: 0, trouble, .. } = finish(&mut ensemble, ALL_DAY) else {
        panic!("run 6 fails");
    };
    assert_eq!(
        trouble.to_string(),
        "member 12: the Newton matrix of the stages is singular"
    );
}

#[test]
fn an_interrupted_ensemble_has_what_its_runs_have_in_common() {
    for threads in [1, 2] {
        let mut ensemble = ensemble(threads, STEPS, &[]);
        assert_eq!(ensemble.advance_to(50, ALL_DAY), Status::Paused);
        assert_eq!(ensemble.done(), 50);
        assert_eq!(ensemble.advance(Duration::ZERO), Status::Paused);
        assert!((50..STEPS).contains(&ensemble.done()));
        assert_eq!(ensemble.time().to_bits(), (0.5 + 50.0 * H).to_bits());
        // records 0, 4, .. 48; the runs' last states are at different times
        assert_eq!(ensemble.take(), alone(13));
    }
}

#[test]
fn a_long_ensemble_pauses() {
    let mut ensemble = ensemble(2, 1 << 60, &[]);
    assert_eq!(ensemble.advance(Duration::from_millis(5)), Status::Paused);
    let most = ensemble.done();
    assert!((1..1 << 50).contains(&most));
    assert!(ensemble.time() > 0.5);
}

#[test]
fn rows_of_their_own_come_one_run_after_another() {
    let rows: fn(f64) -> usize = |x| match x.sin() {
        y if y > 0.5 => 2,
        y if y > -0.5 => 0,
        _ => 1,
    };
    let whole = |place| {
        let mut run = run(place, STEPS, &[], rows);
        assert_eq!(run.advance(ALL_DAY), Status::Done);
        run.take()
    };
    for until in [STEPS, 60] {
        let runs = (0..RUNS).map(|place| -> (Box<dyn Advance + Sync>, usize) {
            (Box::new(run(place, STEPS, &[(3, until)], rows)), MEMBERS)
        });
        let mut ensemble = Ensemble::new(runs.collect(), 2, Layout::Apart);
        finish(&mut ensemble, ALL_DAY);
        let (times, rows) = ensemble.take();
        let mut wanted = (Vec::new(), Vec::new());
        #[allow(clippy::cast_precision_loss)]
        let reached = 0.5 + until as f64 * H;
        for (all_times, all_rows) in (0..RUNS).map(whole) {
            let count = all_times.iter().filter(|t| **t <= reached).count();
            wanted.0.extend_from_slice(&all_times[..count]);
            wanted.1.extend_from_slice(&all_rows[..2 * count]);
        }
        assert!(wanted.0.len() > 50 && wanted.0.len() != RUNS * KEPT);
        assert_eq!((times, rows), wanted);
    }
}
