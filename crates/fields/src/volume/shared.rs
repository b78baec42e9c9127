//! Long runs of rows, shared by threads.
//!
//! A run changes neighbouring places and reads others only. Each thread takes some of the places and computes the same
//! sums as one thread: results are bitwise independent of the number of threads.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::State;
use super::code::{Code, Variables, evaluate};
use super::kernel::{Change, add, change_run, multiply};
use super::rows::{PolynomialRows, RowRun};
use liouville_base::parallel::Workers;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};

/// Bytes of a run that a thread takes at a time.
const SHARE: usize = 1 << 17;
/// Runs of fewer shares are not worth a second thread.
const LEAST_SHARES: usize = 4;

/// Changes all rows, the long runs of them by several threads.
pub(super) fn change_rows<S: Stored>(
    (workers, machine): (&Workers, InstructionSet),
    change: Change,
    rows: &PolynomialRows,
    h: f64,
    state: &mut State<S>,
) {
    let share = SHARE / size_of::<S>();
    for (run, program) in rows.iter() {
        if run.count < LEAST_SHARES * share {
            let short = ShortRun {
                run,
                program,
                change,
                h,
                state: &mut *state,
            };
            S::run(machine, short);
            continue;
        }
        let (first, last) = (run.place, run.place + run.count);
        let (before, rest) = state.x.split_at_mut(first);
        let (mine, after) = rest.split_at_mut(run.count);
        let low = match state.low.get_mut(first..last) {
            Some(low) => low,
            None => &mut [],
        };
        let (before, after) = (&*before, &*after);
        workers.each(share, mine, low, |start, x, low| {
            let around = Around {
                before,
                after,
                first,
                last,
                start,
            };
            let part = RunPart {
                program,
                change,
                h,
                around,
                x,
                low,
            };
            S::run(machine, part);
        });
    }
}

/// A run for one thread.
struct ShortRun<'a, S> {
    run: &'a RowRun,
    program: &'a [Code],
    change: Change,
    h: f64,
    state: &'a mut State<S>,
}

impl<S> Kernel<S> for ShortRun<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let run = (self.run, self.program);
        change_run(views, self.change, run, self.h, self.state);
    }
}

/// The variables around those that a run changes.
#[derive(Clone, Copy)]
struct Around<'a, S> {
    before: &'a [S],
    after: &'a [S],
    /// The places that are changed.
    first: usize,
    last: usize,
    /// The offset in the run where the thread begins.
    start: usize,
}

/// These variables in a view.
struct SharedVariables<'a, W: SimdView> {
    view: W,
    around: Around<'a, W::Stored>,
}

impl<W: SimdView> Variables for SharedVariables<'_, W> {
    type Number = W::Number;

    #[inline(always)]
    fn load(&self, place: u32) -> W::Number {
        let (place, around) = (place as usize, &self.around);
        if place < around.first {
            self.view.load(around.before, place + around.start)
        } else {
            let place = place - around.last + around.start;
            self.view.load(around.after, place)
        }
    }
}

/// A thread's part of a run.
struct RunPart<'a, S> {
    program: &'a [Code],
    change: Change,
    h: f64,
    around: Around<'a, S>,
    x: &'a mut [S],
    low: &'a mut [S],
}

impl<S: Copy> ForEach<S> for RunPart<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let around = self.around;
        let zero = view.constant(0.0);
        let value = evaluate(self.program, zero, &SharedVariables { view, around }).scaled(self.h);
        match self.change {
            Change::Add => add(view, (self.x, self.low), 0, value),
            Change::Scale => multiply(view, (self.x, self.low), 0, value),
        }
        true
    }
}

impl<S: Copy> Kernel<S> for RunPart<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(mut self, views: W) {
        views.each(self.x.len(), &mut self);
    }
}
