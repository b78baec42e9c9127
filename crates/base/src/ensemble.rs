//! Many runs side by side, as one: threads take them in turn.
//!
//! Members run in blocks, each block in lock-step. A block is begun when its turn comes and is not kept longer
//! than it runs: what is kept of an ensemble are its records. A member that fails leaves its block, which
//! begins once more without it. The results do not depend on the number of threads, nor on who stepped what: a
//! pause changes nothing in a run, and a member has the same bits in any company. Turns, failures and records are in
//! one file because they change together, under one lock.

use crate::error::StepError;
use crate::method::Stats;
use crate::run::{Advance, Failure, Status};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::VecDeque;
use std::mem;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How the records of the runs are laid out, and with it which run has its turn.
#[derive(Clone, Debug, PartialEq)]
pub enum Layout {
    /// Each member has records at these times: at each time a row of all members, one beside another, NaN where
    /// one has not come so far. A run is carried to its end before the next is begun.
    Aligned {
        /// The times.
        times: Vec<f64>,
        /// How many numbers a member has in a row.
        width: usize,
    },
    /// The runs have records of their own, which begin with the number of a member: all rows of the first, then of the second and so on, up to the
    /// time that all have reached. Runs take short turns, to stay within a few steps of one another.
    Ragged,
}

/// Begins a run of these members; the error of one of several is told with its place among them.
pub type Begin = dyn Fn(&[usize]) -> Result<Box<dyn Advance + Sync>, StepError> + Send + Sync;

/// A turn of a run lasts about this long, in seconds, where there are few of them ...
const LONGEST_TURN: f64 = 1e-2;
/// ... and never less than this,
const SHORTEST_TURN: f64 = 1e-4;
/// in between so that every run has its turn in this time.
const ROUND: f64 = 0.2;

/// Members in lock-step, and their run once it is begun.
struct Block {
    members: Vec<usize>,
    run: Option<Box<dyn Advance + Sync>>,
    /// Whether it begins once more.
    is_again: bool,
}

/// Blocks waiting for their turn, and what those that are over have left.
#[derive(Default)]
struct Queue {
    waiting: VecDeque<Block>,
    /// Steps that are enough for now, and those who have made them.
    most: usize,
    resting: Vec<Block>,
    turn: usize,
    /// The records of all members, or those that each run has left.
    table: Vec<f64>,
    left: Vec<(usize, Records)>,
    failures: Vec<Failure>,
    over: usize,
    /// The sum of the steps of all members that are over, and what was done for them.
    steps: usize,
    stats: (Stats, usize),
    end: f64,
}

/// Times and rows.
type Records = (Vec<f64>, Vec<f64>);

/// Runs that advance together.
pub struct Ensemble {
    begin: Box<Begin>,
    queue: Queue,
    pool: Option<ThreadPool>,
    threads: usize,
    layout: Layout,
    members: usize,
    t0: f64,
}

impl Ensemble {
    /// Runs of so many members from `t0`, in blocks of at most `width`, by at most so many threads.
    ///
    /// # Panics
    /// When there are no members or they come in blocks of none.
    pub fn new(
        begin: Box<Begin>,
        (members, width): (usize, usize),
        threads: usize,
        layout: Layout,
        t0: f64,
    ) -> Self {
        let all: Vec<usize> = (0..members).collect();
        let blocks = all.chunks(width).map(|members| Block {
            members: members.to_vec(),
            run: None,
            is_again: false,
        });
        let waiting: VecDeque<Block> = blocks.collect();
        let threads = threads.clamp(1, waiting.len());
        Self {
            begin,
            queue: Queue {
                waiting,
                turn: 1,
                end: t0,
                ..Queue::default()
            },
            // without threads of its own it is slower, and nothing else
            pool: (threads > 1)
                .then(|| ThreadPoolBuilder::new().num_threads(threads).build().ok())
                .flatten(),
            threads,
            layout,
            members,
            t0,
        }
    }

    /// How long a turn should be, in seconds.
    fn turn(&self) -> f64 {
        let runs = self.queue.waiting.len().max(1);
        (ROUND * self.threads as f64 / runs as f64).clamp(SHORTEST_TURN, LONGEST_TURN)
    }

    /// Gives turns to runs until the deadline, at least one.
    fn work(&self, queue: &Mutex<Queue>, start: Instant, budget: Duration, wanted: f64) {
        let is_whole = matches!(self.layout, Layout::Aligned { .. });
        loop {
            let Some((mut block, steps)) = next(&mut locked(queue), is_whole) else {
                return;
            };
            let left = budget.saturating_sub(start.elapsed());
            let begun = match block.run.take() {
                Some(run) => Ok(run),
                None => (self.begin)(&block.members),
            };
            let mut run = match begun {
                Ok(run) => run,
                Err(error) => {
                    self.part(&mut locked(queue), block, None, error);
                    continue;
                }
            };
            let (clock, before) = (Instant::now(), run.done());
            let status = run.advance_to(steps, left);
            let (spent, made) = (clock.elapsed().as_secs_f64(), run.done() - before);
            let mut queue = locked(queue);
            match status {
                Status::Paused => {
                    block.run = Some(run);
                    if is_whole {
                        queue.waiting.push_front(block);
                    } else {
                        queue.waiting.push_back(block);
                    }
                }
                Status::Done => {
                    queue.end = run.time();
                    self.close(&mut queue, &block.members, run, None);
                }
                Status::Failed { n, t, error } => {
                    self.part(&mut queue, block, Some((run, (n, t))), error);
                }
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

    /// One of these members has failed: it leaves its records, and the others begin anew.
    fn part(
        &self,
        queue: &mut Queue,
        block: Block,
        run: Option<(Box<dyn Advance + Sync>, (usize, f64))>,
        error: StepError,
    ) {
        let Block {
            members, is_again, ..
        } = block;
        let place = error.member().or((members.len() == 1).then_some(0));
        let Some(place) = place else {
            // whose error it is, each finds out alone
            members.chunks(1).rev().for_each(|one| queue.again(one));
            return;
        };
        // places without a member follow the last one
        let place = place.min(members.len() - 1);
        let mut others = members;
        let member = others.remove(place);
        let (step, error) = (run.as_ref().map(|(_, step)| *step), error.itself());
        let failure = Failure {
            member,
            step,
            error,
        };
        queue.failures.push(failure);
        if let Some((run, _)) = run {
            self.close(queue, &[member], run, Some((place, others.len() + 1)));
        } else {
            queue.over += 1;
        }
        // where many fail, most of a block would be made many times
        let size = if is_again {
            others.len().div_ceil(2)
        } else {
            others.len()
        };
        others
            .chunks(size.max(1))
            .rev()
            .for_each(|part| queue.again(part));
    }

    /// Keeps what a run has recorded, or what one of its members has.
    fn close(
        &self,
        queue: &mut Queue,
        members: &[usize],
        mut run: Box<dyn Advance + Sync>,
        one: Option<(usize, usize)>,
    ) {
        let (stats, rejected) = run.stats();
        queue.stats = (queue.stats.0 + stats, queue.stats.1 + rejected);
        queue.over += members.len();
        queue.steps += run.done() * members.len();
        let records = run.take();
        self.keep(queue, members, records, one);
    }

    fn keep(
        &self,
        queue: &mut Queue,
        members: &[usize],
        (times, rows): Records,
        one: Option<(usize, usize)>,
    ) {
        let Layout::Aligned { times: all, width } = &self.layout else {
            let records = match one {
                None => (times, rows),
                Some(_) => rows_of(members[0], &times, &rows),
            };
            queue.left.push((members[0], records));
            return;
        };
        let total = self.members * width;
        if queue.table.is_empty() {
            queue.table = vec![f64::NAN; all.len() * total];
        }
        let (first, count) = one.unwrap_or((0, members.len()));
        let same = times.iter().zip(all);
        let same = same.take_while(|(a, b)| a.to_bits() == b.to_bits()).count();
        if *width == 0 {
            return;
        }
        let rows = rows.chunks_exact(count * width).take(same);
        for (to, row) in queue.table.chunks_exact_mut(total).zip(rows) {
            for (member, values) in members
                .iter()
                .zip(row[first * width..].chunks_exact(*width))
            {
                to[member * width..(member + 1) * width].copy_from_slice(values);
            }
        }
    }
}

impl Queue {
    fn again(&mut self, members: &[usize]) {
        self.waiting.push_front(Block {
            members: members.to_vec(),
            run: None,
            is_again: true,
        });
    }
}

/// The next block that has something to do, and how many steps it shall have then.
fn next(queue: &mut Queue, is_whole: bool) -> Option<(Block, usize)> {
    while let Some(block) = queue.waiting.pop_front() {
        let done = block.run.as_ref().map_or(0, |run| run.done());
        if done >= queue.most {
            queue.resting.push(block);
        } else {
            let turn = if is_whole { usize::MAX } else { queue.turn };
            return Some((block, done.saturating_add(turn).min(queue.most)));
        }
    }
    None
}

fn locked(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Advance for Ensemble {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let (start, wanted) = (Instant::now(), self.turn());
        self.queue.most = steps;
        let queue = Mutex::new(mem::take(&mut self.queue));
        match &self.pool {
            Some(pool) => {
                pool.broadcast(|_| self.work(&queue, start, budget, wanted));
            }
            None => self.work(&queue, start, budget, wanted),
        }
        self.queue = queue.into_inner().unwrap_or_else(PoisonError::into_inner);
        let queue = &mut self.queue;
        queue.waiting.extend(queue.resting.drain(..));
        if queue.waiting.is_empty() {
            Status::Done
        } else {
            Status::Paused
        }
    }

    /// The mean of the members, rounded down: the steps of each when all are over.
    fn done(&self) -> usize {
        let begun = self.queue.waiting.iter();
        let begun = begun.filter_map(|block| Some((block.run.as_ref()?.done(), &block.members)));
        let steps: usize = begun.map(|(done, members)| done * members.len()).sum();
        (self.queue.steps + steps) / self.members
    }

    /// The time that all runs have reached.
    fn time(&self) -> f64 {
        let waiting = self.queue.waiting.iter();
        let times = waiting.map(|block| block.run.as_ref().map_or(self.t0, |run| run.time()));
        let nearest = |a: f64, b: f64| {
            if (b - self.t0).abs() < (a - self.t0).abs() {
                b
            } else {
                a
            }
        };
        times.reduce(nearest).unwrap_or(self.queue.end)
    }

    fn stats(&self) -> (Stats, usize) {
        let begun = self
            .queue
            .waiting
            .iter()
            .filter_map(|block| block.run.as_ref());
        begun
            .map(|run| run.stats())
            .fold(self.queue.stats, |(sum, rejected), (stats, more)| {
                (sum + stats, rejected + more)
            })
    }

    fn failures(&self) -> Vec<Failure> {
        let mut failures = self.queue.failures.clone();
        failures.sort_by_key(|failure| failure.member);
        failures
    }

    fn over(&self) -> usize {
        self.queue.over
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        let reached = if self.queue.waiting.is_empty() {
            f64::INFINITY
        } else {
            (self.time() - self.t0).abs()
        };
        let mut queue = mem::take(&mut self.queue);
        for mut block in mem::take(&mut queue.waiting) {
            if let Some(run) = &mut block.run {
                let (stats, rejected) = run.stats();
                queue.stats = (queue.stats.0 + stats, queue.stats.1 + rejected);
                queue.steps += run.done() * block.members.len();
                let records = run.take();
                self.keep(&mut queue, &block.members, records, None);
            }
        }
        let records = match &self.layout {
            Layout::Aligned { times, width } => {
                let total = self.members * width;
                let mut rows = mem::take(&mut queue.table);
                let is_there = |row: &[f64]| row.iter().any(|value| !value.is_nan());
                let count = match total {
                    0 => times.len(),
                    _ => rows.chunks(total).rposition(is_there).map_or(0, |k| k + 1),
                };
                rows.truncate(count * total);
                (times[..count].to_vec(), rows)
            }
            Layout::Ragged => {
                queue.left.sort_by_key(|(member, _)| *member);
                apart(mem::take(&mut queue.left), reached, self.t0)
            }
        };
        // what was done is still asked for
        self.queue = queue;
        records
    }
}

/// The rows of one member, whose number comes first in each.
#[allow(clippy::float_cmp, clippy::cast_precision_loss)] // it is a small integer
fn rows_of(member: usize, times: &[f64], rows: &[f64]) -> Records {
    let width = (rows.len() / times.len().max(1)).max(1);
    let both = times.iter().zip(rows.chunks_exact(width));
    let own = both.filter(|(_, row)| row[0] == member as f64);
    let (times, rows): (Vec<f64>, Vec<&[f64]>) = own.unzip();
    (times, rows.concat())
}

/// Rows of one run after those of another, up to a time this far from the start.
fn apart(records: Vec<(usize, Records)>, reached: f64, t0: f64) -> Records {
    let (mut all_times, mut all_rows) = (Vec::new(), Vec::new());
    for (_, (times, rows)) in records {
        let width = rows.len() / times.len().max(1);
        let count = times.partition_point(|t| (t - t0).abs() <= reached);
        all_times.extend_from_slice(&times[..count]);
        all_rows.extend_from_slice(&rows[..count * width]);
    }
    (all_times, all_rows)
}
