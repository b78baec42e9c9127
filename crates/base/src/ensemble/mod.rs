//! Ensembles: many runs side by side, advanced by several threads as one run.
//!
//! Members run in blocks, each block in lock-step. A block begins when its turn comes and is dropped when it
//! ends: an ensemble keeps only records. A member that fails leaves its block, and the block begins again without
//! it. Results are bitwise independent of the number of threads, of pauses, and of how members are grouped.

mod queue;
mod records;

pub use records::RecordLayout;

use crate::cancel;
use crate::error::StepError;
use crate::method::Stats;
use crate::observe::Finding;
use crate::run::{Advance, Events, Failure, Status, check_spare};
use queue::{MemberBlock, Queue};
use rayon::{ThreadPool, ThreadPoolBuilder};
use records::MemberRecords;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Begins a run of these members; its errors have a member's place among them.
pub type BeginBlock = dyn Fn(&[usize]) -> Result<Box<dyn Advance>, StepError> + Send + Sync;

/// A turn of a run lasts about this long, in seconds, where there are few of them ...
const LONGEST_TURN: f64 = 1e-2;
/// ... and never less than this,
const SHORTEST_TURN: f64 = 1e-4;
/// in between so that every run has its turn in this time.
const ROUND: f64 = 0.2;

/// Once in so many blocks there must be memory to spare for those that begin.
const BLOCKS: usize = 16;

/// Runs that advance side by side.
pub struct Ensemble {
    begin: Box<BeginBlock>,
    queue: Mutex<Queue>,
    pool: Option<ThreadPool>,
    threads: usize,
    /// How many blocks have begun.
    begun: AtomicUsize,
    /// Whether a run is carried to its end before the next begins.
    is_aligned: bool,
    members: usize,
    t0: f64,
}

impl Ensemble {
    /// Runs of so many members from `t0`, in blocks of at most `width`, by at most so many threads.
    ///
    /// # Panics
    /// When there are no members or they come in blocks of none.
    pub fn new(
        begin: Box<BeginBlock>,
        (members, width): (usize, usize),
        threads: usize,
        layout: RecordLayout,
        t0: f64,
    ) -> Self {
        let all: Vec<usize> = (0..members).collect();
        let blocks = all.chunks(width).map(|members| MemberBlock {
            members: members.to_vec(),
            run: None,
            is_again: false,
        });
        let waiting: VecDeque<MemberBlock> = blocks.collect();
        let threads = threads.clamp(1, waiting.len());
        Self {
            begin,
            is_aligned: matches!(layout, RecordLayout::Aligned { .. }),
            queue: Mutex::new(Queue {
                waiting,
                most: 0,
                resting: Vec::new(),
                turn: 1,
                records: MemberRecords::new(layout, members, t0),
                events: Vec::new(),
                failures: Vec::new(),
                found: Vec::new(),
                is_short: false,
                over: 0,
                steps: 0,
                stats: (Stats::default(), 0),
                end: t0,
            }),
            // where no threads can be had, this one does all the work
            pool: (threads > 1)
                .then(|| ThreadPoolBuilder::new().num_threads(threads).build().ok())
                .flatten(),
            threads,
            begun: AtomicUsize::new(0),
            members,
            t0,
        }
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How long a turn should be, in seconds.
    fn turn(&self) -> f64 {
        let runs = self.queue().waiting.len().max(1);
        (ROUND * self.threads as f64 / runs as f64).clamp(SHORTEST_TURN, LONGEST_TURN)
    }

    /// Begins the run of a block, whose memory is made without a check: once in so many there must be some to spare.
    fn begun(&self, members: &[usize]) -> Result<Box<dyn Advance>, StepError> {
        if self.begun.fetch_add(1, Ordering::Relaxed) % BLOCKS == BLOCKS - 1 {
            check_spare()?;
        }
        (self.begin)(members)
    }

    /// Gives turns to runs until the deadline, at least one.
    fn work(&self, start: Instant, budget: Duration, wanted: f64) {
        loop {
            let Some((mut block, steps)) = self.queue().next(self.is_aligned) else {
                return;
            };
            let left = budget.saturating_sub(start.elapsed());
            let begun = match block.run.take() {
                Some(run) => Ok(run),
                None => self.begun(&block.members),
            };
            let mut run = match begun {
                Ok(run) => run,
                Err(StepError::NoMemory) => {
                    self.queue().stop(block);
                    return;
                }
                Err(StepError::Interrupted) if cancel::is_cancelled() => {
                    self.queue().waiting.push_front(block);
                    return;
                }
                Err(error) => {
                    self.queue().fail(block, None, error);
                    continue;
                }
            };
            let (clock, before) = (Instant::now(), run.done());
            let status = run.advance_to(steps, left);
            let (spent, made) = (clock.elapsed().as_secs_f64(), run.done() - before);
            let mut queue = self.queue();
            match status {
                Status::Paused => {
                    block.run = Some(run);
                    if self.is_aligned {
                        queue.waiting.push_front(block);
                    } else {
                        queue.waiting.push_back(block);
                    }
                }
                Status::Done => {
                    queue.end = run.time();
                    queue.close(&block.members, run, None);
                }
                Status::Failed { n, t, error } => match error {
                    StepError::NoMemory => {
                        block.run = Some(run);
                        queue.stop(block);
                    }
                    // no member failed
                    StepError::Interrupted if cancel::is_cancelled() => {
                        block.run = Some(run);
                        queue.waiting.push_front(block);
                        return;
                    }
                    error => queue.fail(block, Some((run, (n, t))), error),
                },
            }
            if spent > 2.0 * wanted {
                queue.turn = made.div_ceil(2).max(1);
            } else if spent < wanted / 2.0 && made >= queue.turn {
                queue.turn = queue.turn.saturating_mul(2);
            }
            if start.elapsed() >= budget {
                return;
            }
        }
    }
}

impl Advance for Ensemble {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let (start, wanted) = (Instant::now(), self.turn());
        self.queue().most = steps;
        match &self.pool {
            Some(pool) => cancel::on_threads(pool, || self.work(start, budget, wanted)),
            None => self.work(start, budget, wanted),
        }
        let (n, t) = (self.done(), self.time());
        let queue = &mut *self.queue();
        queue.waiting.extend(queue.resting.drain(..));
        if queue.is_short {
            let error = StepError::NoMemory;
            Status::Failed { n, t, error }
        } else if queue.waiting.is_empty() {
            Status::Done
        } else {
            Status::Paused
        }
    }

    /// The mean of the members, rounded down: the steps of each when all are over.
    fn done(&self) -> usize {
        let queue = self.queue();
        let waiting = queue.waiting.iter();
        let steps: usize = waiting.map(|x| x.done() * x.members.len()).sum();
        (queue.steps + steps) / self.members
    }

    /// The time that all runs have reached.
    fn time(&self) -> f64 {
        let queue = self.queue();
        let waiting = queue.waiting.iter();
        let times = waiting.map(|block| block.run.as_ref().map_or(self.t0, |run| run.time()));
        let nearest = |a: f64, b: f64| {
            if (b - self.t0).abs() < (a - self.t0).abs() {
                b
            } else {
                a
            }
        };
        times.reduce(nearest).unwrap_or(queue.end)
    }

    fn stats(&self) -> (Stats, usize) {
        let queue = self.queue();
        let begun = queue.waiting.iter().filter_map(|block| block.run.as_ref());
        begun
            .map(|run| run.stats())
            .fold(queue.stats, |(sum, rejected), (stats, more)| {
                (sum + stats, rejected + more)
            })
    }

    fn failures(&self) -> Vec<Failure> {
        let mut failures = self.queue().failures.clone();
        failures.sort_by_key(|failure| failure.member);
        failures
    }

    fn over(&self) -> usize {
        self.queue().over
    }

    fn found(&self) -> Vec<(usize, Finding)> {
        let mut found = self.queue().found.clone();
        found.sort_by_key(|(member, _)| *member);
        found
    }

    fn events(&mut self) -> Events {
        let queue = &mut *self.queue();
        let mut found = std::mem::take(&mut queue.events);
        found.sort_by_key(|(member, _)| *member);
        let mut all = Events::default();
        for (member, events) in found {
            queue.is_short |= all.append(member, events).is_err();
        }
        all
    }

    fn is_short(&self) -> bool {
        self.queue().is_short
    }

    fn shape(&self) -> Vec<usize> {
        self.queue().records.shape()
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let time = self.time();
        let queue = &mut *self.queue();
        let reached = if queue.waiting.is_empty() {
            f64::INFINITY
        } else {
            (time - self.t0).abs()
        };
        for mut block in std::mem::take(&mut queue.waiting) {
            if let Some(run) = &mut block.run {
                queue.add(&block.members, &mut **run, None);
            }
        }
        queue.records.take(reached)
    }
}
