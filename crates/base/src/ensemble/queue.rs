//! Blocks of members that wait for their turn, and the results of those that are over.

use super::records::MemberRecords;
use crate::error::StepError;
use crate::method::Stats;
use crate::observe::Finding;
use crate::run::{Advance, Events, Failure};
use std::collections::VecDeque;

/// Members in lock-step, and their run once it has begun.
pub(super) struct MemberBlock {
    pub(super) members: Vec<usize>,
    pub(super) run: Option<Box<dyn Advance>>,
    /// Whether it begins again because a member failed.
    pub(super) is_again: bool,
}

impl MemberBlock {
    pub(super) fn done(&self) -> usize {
        self.run.as_ref().map_or(0, |run| run.done())
    }
}

/// Blocks waiting for their turn, and the results of those that are over.
pub(super) struct Queue {
    pub(super) waiting: VecDeque<MemberBlock>,
    /// Steps wanted for now, and the blocks that have made them.
    pub(super) most: usize,
    pub(super) resting: Vec<MemberBlock>,
    /// Steps of a turn.
    pub(super) turn: usize,
    pub(super) records: MemberRecords,
    /// The events of members that run alone.
    pub(super) events: Vec<(usize, Events)>,
    pub(super) failures: Vec<Failure>,
    /// The findings of watches over members that are over.
    pub(super) found: Vec<(usize, Finding)>,
    /// Whether there is no memory for more records.
    pub(super) is_short: bool,
    pub(super) over: usize,
    /// Steps of all members that are over, summed; and their statistics.
    pub(super) steps: usize,
    pub(super) stats: (Stats, usize),
    pub(super) end: f64,
}

impl Queue {
    /// The next block that has steps to make, and up to how many.
    pub(super) fn next(&mut self, is_aligned: bool) -> Option<(MemberBlock, usize)> {
        if self.is_short {
            return None;
        }
        while let Some(block) = self.waiting.pop_front() {
            let done = block.done();
            if done >= self.most {
                self.resting.push(block);
            } else {
                let turn = if is_aligned { usize::MAX } else { self.turn };
                return Some((block, done.saturating_add(turn).min(self.most)));
            }
        }
        None
    }

    /// Stops scheduling: out of memory for records.
    pub(super) fn stop(&mut self, block: MemberBlock) {
        self.waiting.push_front(block);
        self.is_short = true;
    }

    fn begin_again(&mut self, members: &[usize]) {
        self.waiting.push_front(MemberBlock {
            members: members.to_vec(),
            run: None,
            is_again: true,
        });
    }

    /// Keeps the records of the member that failed, and lets the others begin again.
    pub(super) fn fail(
        &mut self,
        block: MemberBlock,
        run: Option<(Box<dyn Advance>, (usize, f64))>,
        error: StepError,
    ) {
        let MemberBlock {
            members, is_again, ..
        } = block;
        let place = error.member().or((members.len() == 1).then_some(0));
        let Some(place) = place else {
            // The error does not say which member failed: rerun each alone.
            members
                .chunks(1)
                .rev()
                .for_each(|one| self.begin_again(one));
            return;
        };
        // places without a member follow the last one
        let place = place.min(members.len() - 1);
        let mut others = members;
        let member = others.remove(place);
        self.failures.push(Failure {
            member,
            step: run.as_ref().map(|(_, step)| *step),
            error: error.itself(),
        });
        if let Some((run, _)) = run {
            self.close(&[member], run, Some((place, others.len() + 1)));
        } else {
            self.over += 1;
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
            .for_each(|part| self.begin_again(part));
    }

    /// Keeps the records of a run, or of one of its members.
    pub(super) fn close(
        &mut self,
        members: &[usize],
        mut run: Box<dyn Advance>,
        one: Option<(usize, usize)>,
    ) {
        self.over += members.len();
        self.add(members, &mut *run, one);
    }

    pub(super) fn add(
        &mut self,
        members: &[usize],
        run: &mut dyn Advance,
        one: Option<(usize, usize)>,
    ) {
        let (stats, rejected) = match one {
            Some((place, _)) => run.stats_of(place),
            None => run.stats(),
        };
        self.stats = (self.stats.0 + stats, self.stats.1 + rejected);
        self.steps += run.done() * members.len();
        self.is_short |= self.records.keep(members, run.take(), one).is_err();
        for (place, finding) in run.found() {
            match one {
                Some((own, _)) if place == own => self.found.push((members[0], finding)),
                Some(_) => {}
                None => self.found.push((members[place], finding)),
            }
        }
        let events = run.events();
        if !events.found.is_empty() {
            self.events.push((members[0], events));
        }
    }
}
