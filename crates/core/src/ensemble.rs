//! Many runs side by side, as one: threads take them in turn.
//!
//! Runs wait in a queue. A thread takes the first, makes some steps with it, and puts it back at the end:
//! all runs stay within a few steps of one another, so that what they have in common is most of what
//! they did whenever they are stopped. The results do not depend on the number of threads, nor on who
//! stepped what: a pause changes nothing in a run, and a failure is that of the earliest step, whoever found
//! one first.

use crate::method::Stats;
use crate::run::{Advance, Status};
use crate::trouble::Trouble;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::VecDeque;
use std::mem;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How the records of the runs are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The runs have records at the same times: at each time a row of all runs, one beside another, up to
    /// the last time that all have reached.
    Together,
    /// The runs have records of their own: all rows of the first, then of the second and so on, up to the
    /// time that all have reached.
    Apart,
}

/// A turn of a run lasts about this long, in seconds, where there are few of them ...
const LONGEST_TURN: f64 = 1e-2;
/// ... and never less than this,
const SHORTEST_TURN: f64 = 1e-4;
/// in between so that every run has its turn in this time.
const ROUND: f64 = 0.2;

/// A run, and whom it steps.
struct Entry {
    run: Box<dyn Advance + Sync>,
    place: usize,
    first: usize,
}

/// The earliest failure so far.
#[derive(Clone)]
struct Failure {
    n: usize,
    t: f64,
    place: usize,
    trouble: Trouble,
}

/// Runs waiting for their turn, those over, and how many steps a turn has.
#[derive(Default)]
struct Queue {
    waiting: VecDeque<Entry>,
    over: Vec<Entry>,
    failure: Option<Failure>,
    turn: usize,
    /// Steps that are enough for now, and those who have made them.
    most: usize,
    resting: Vec<Entry>,
}

/// Runs that advance together.
pub struct Ensemble {
    queue: Queue,
    pool: Option<ThreadPool>,
    threads: usize,
    layout: Layout,
    t0: f64,
}

impl Ensemble {
    /// These runs, each with the number of its members, by at most so many threads.
    ///
    /// # Panics
    /// When there are no runs.
    pub fn new(
        runs: Vec<(Box<dyn Advance + Sync>, usize)>,
        threads: usize,
        layout: Layout,
    ) -> Self {
        let threads = threads.clamp(1, runs.len());
        let t0 = runs[0].0.time();
        let mut first = 0;
        let entries = runs.into_iter().enumerate().map(|(place, (run, members))| {
            first += members;
            Entry {
                run,
                place,
                first: first - members,
            }
        });
        Self {
            queue: Queue {
                waiting: entries.collect(),
                turn: 1,
                ..Queue::default()
            },
            // without threads of its own it is slower, and nothing else
            pool: (threads > 1)
                .then(|| ThreadPoolBuilder::new().num_threads(threads).build().ok())
                .flatten(),
            threads,
            layout,
            t0,
        }
    }

    fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.queue.waiting.iter().chain(&self.queue.over)
    }

    /// The run with the fewest steps.
    fn last(&self) -> Option<&Entry> {
        self.entries().min_by_key(|entry| entry.run.done())
    }

    /// How long a turn should be, in seconds.
    fn turn(&self) -> f64 {
        let runs = self.queue.waiting.len().max(1);
        (ROUND * self.threads as f64 / runs as f64).clamp(SHORTEST_TURN, LONGEST_TURN)
    }
}

impl Queue {
    /// The next run that has something to do, and how many steps it shall have then.
    fn next(&mut self) -> Option<(Entry, usize)> {
        while let Some(entry) = self.waiting.pop_front() {
            let done = entry.run.done();
            // after a failure the others go on to that step: it may be theirs too
            let end = self
                .failure
                .as_ref()
                .map_or(usize::MAX, |found| found.n + 1);
            if done >= end {
                self.over.push(entry);
            } else if done >= self.most {
                self.resting.push(entry);
            } else {
                let steps = done.saturating_add(self.turn).min(end).min(self.most);
                return Some((entry, steps));
            }
        }
        None
    }

    /// Takes a run back after its turn.
    fn back(&mut self, entry: Entry, status: Status) {
        match status {
            Status::Paused => self.waiting.push_back(entry),
            Status::Done => self.over.push(entry),
            Status::Failed { n, t, trouble } => {
                let earliest = self.failure.as_ref().map(|found| (found.n, found.place));
                if earliest.is_none_or(|earliest| (n, entry.place) < earliest) {
                    self.failure = Some(Failure {
                        n,
                        t,
                        place: entry.place,
                        trouble: trouble.of_member(entry.first),
                    });
                }
                self.over.push(entry);
            }
        }
    }

    /// Where the runs stand after their turns.
    fn status(&mut self) -> Status {
        let is_paused = !self.waiting.is_empty();
        self.waiting.extend(self.resting.drain(..));
        match &self.failure {
            _ if is_paused => Status::Paused,
            Some(failure) => Status::Failed {
                n: failure.n,
                t: failure.t,
                trouble: failure.trouble.clone(),
            },
            None if self.waiting.is_empty() => Status::Done,
            None => Status::Paused,
        }
    }
}

fn locked(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives turns to runs until the deadline, at least one.
fn work(queue: &Mutex<Queue>, start: Instant, budget: Duration, wanted: f64) {
    loop {
        let Some((mut entry, steps)) = locked(queue).next() else {
            return;
        };
        let clock = Instant::now();
        let left = budget.saturating_sub(start.elapsed());
        let turn = steps - entry.run.done();
        let status = entry.run.advance_to(steps, left);
        let is_whole = entry.run.done() == steps;
        let spent = clock.elapsed().as_secs_f64();
        let mut queue = locked(queue);
        queue.back(entry, status);
        if spent > 2.0 * wanted {
            queue.turn = turn.div_ceil(2);
        } else if spent < wanted / 2.0 && is_whole {
            queue.turn = turn.saturating_mul(2).max(queue.turn);
        }
        if start.elapsed() >= budget {
            return;
        }
    }
}

impl Advance for Ensemble {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let (start, wanted) = (Instant::now(), self.turn());
        self.queue.most = steps;
        let queue = Mutex::new(mem::take(&mut self.queue));
        match &self.pool {
            Some(pool) => {
                pool.broadcast(|_| work(&queue, start, budget, wanted));
            }
            None => work(&queue, start, budget, wanted),
        }
        self.queue = queue.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.queue.status()
    }

    /// The mean of the runs, rounded down: the steps of each when all are over.
    fn done(&self) -> usize {
        let runs = self.queue.waiting.len() + self.queue.over.len();
        self.entries().map(|entry| entry.run.done()).sum::<usize>() / runs
    }

    /// The time that all runs have reached.
    fn time(&self) -> f64 {
        self.last().map_or(self.t0, |entry| entry.run.time())
    }

    fn stats(&self) -> (Stats, usize) {
        self.entries()
            .map(|entry| entry.run.stats())
            .fold((Stats::default(), 0), |(sum, rejected), (stats, more)| {
                (sum + stats, rejected + more)
            })
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let reached = self.time();
        let mut entries: Vec<&mut Entry> = self
            .queue
            .waiting
            .iter_mut()
            .chain(&mut self.queue.over)
            .collect();
        entries.sort_by_key(|entry| entry.place);
        let records = entries.iter_mut().map(|entry| entry.run.take()).collect();
        match self.layout {
            Layout::Together => together(records),
            Layout::Apart => apart(records, (reached - self.t0).abs(), self.t0),
        }
    }
}

/// Rows of all runs beside one another, as long as their times are the same.
fn together(records: Vec<(Vec<f64>, Vec<f64>)>) -> (Vec<f64>, Vec<f64>) {
    let mut times = records[0].0.clone();
    for (other, _) in &records[1..] {
        let same = times
            .iter()
            .zip(other)
            .take_while(|(a, b)| a.total_cmp(b).is_eq())
            .count();
        times.truncate(same);
    }
    let width = |(times, rows): &(Vec<f64>, Vec<f64>)| rows.len() / times.len().max(1);
    let total: usize = records.iter().map(width).sum();
    let mut all = vec![0.0; times.len() * total];
    let mut first = 0;
    // one run after another, so that what has been laid out can go
    for record in records {
        let width = width(&record);
        if width > 0 {
            for (to, row) in all.chunks_mut(total).zip(record.1.chunks(width)) {
                to[first..first + width].copy_from_slice(row);
            }
        }
        first += width;
    }
    (times, all)
}

/// Rows of one run after those of another, up to a time this far from the start.
fn apart(records: Vec<(Vec<f64>, Vec<f64>)>, reached: f64, t0: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut all_times, mut all_rows) = (Vec::new(), Vec::new());
    for (times, rows) in records {
        let width = rows.len() / times.len().max(1);
        let count = times.partition_point(|t| (t - t0).abs() <= reached);
        all_times.extend_from_slice(&times[..count]);
        all_rows.extend_from_slice(&rows[..count * width]);
    }
    (all_times, all_rows)
}
