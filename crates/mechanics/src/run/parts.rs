//! Parts of the steps of a run that is over: its states at given times, those of one step after another.

use super::Starter;
use liouville_base::error::StepError;
use liouville_base::method::Stats;
use liouville_base::run::{Advance, Span, Status};
use std::time::{Duration, Instant};

/// When a step begins, when the last part of it ends, and how many of the given times are in it.
pub type Part = (f64, f64, usize);

/// Runs from one start after another, each a step to its last given time.
pub(super) struct Parts {
    starter: Starter,
    /// All given times, and the first of those to come.
    times: Vec<f64>,
    first: usize,
    /// How many parts are over, and the run of the next, if it has begun.
    done: usize,
    run: Option<Box<dyn Advance>>,
    records: (Vec<f64>, Vec<f64>),
    stats: Stats,
}

impl Parts {
    /// The parts of a starter's job.
    pub(super) fn new(mut starter: Starter) -> Self {
        let detection = starter.job.detection.as_mut();
        Self {
            times: detection
                .and_then(|own| own.times.take())
                .unwrap_or_default(),
            first: 0,
            done: 0,
            run: None,
            records: Default::default(),
            stats: Stats::default(),
            starter,
        }
    }

    fn begin(&mut self) -> Result<Box<dyn Advance>, StepError> {
        let job = &mut self.starter.job;
        let (t0, t1, count) = job.parts[self.done];
        let (steps, every) = (1, 1);
        job.span = Span {
            t0,
            t1,
            steps,
            every,
        };
        if let Some(detection) = &mut job.detection {
            detection.times = Some(self.times[self.first..self.first + count].to_vec());
        }
        self.starter.begin(&[self.done])
    }
}

impl Advance for Parts {
    fn advance_to(&mut self, steps: usize, budget: Duration) -> Status {
        let start = Instant::now();
        while let Some(&(t, _, count)) = self.starter.job.parts.get(self.done) {
            if self.done >= steps {
                return Status::Paused;
            }
            let n = self.done;
            let begun = match self.run.take() {
                Some(run) => Ok(run),
                None => self.begin(),
            };
            let mut run = match begun {
                Ok(run) => run,
                Err(error) => return Status::Failed { n, t, error },
            };
            match run.advance(budget.saturating_sub(start.elapsed())) {
                Status::Done => {}
                Status::Failed { error, .. } => return Status::Failed { n, t, error },
                Status::Paused => {
                    self.run = Some(run);
                    return Status::Paused;
                }
            }
            let (times, rows) = run.take();
            self.records.0.extend(times);
            self.records.1.extend(rows);
            self.stats = self.stats + run.stats().0;
            self.first += count;
            self.done += 1;
            if start.elapsed() >= budget && self.done < self.starter.job.parts.len() {
                return Status::Paused;
            }
        }
        Status::Done
    }

    fn done(&self) -> usize {
        self.done
    }

    fn time(&self) -> f64 {
        let last = self.done.checked_sub(1);
        let end = last.map(|last| self.starter.job.parts[last].1);
        end.unwrap_or(self.starter.job.span.t0)
    }

    fn stats(&self) -> (Stats, usize) {
        (self.stats, 0)
    }

    fn shape(&self) -> Vec<usize> {
        vec![self.starter.width()]
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        std::mem::take(&mut self.records)
    }
}
