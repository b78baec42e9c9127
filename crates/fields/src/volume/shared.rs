//! Long runs of rows, shared by threads.
//!
//! A run changes neighbouring places and reads others only. Each thread takes some of the places and computes the same
//! sums as one thread: results are bitwise independent of the number of threads.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::{Code, Variables, evaluate};
use super::flow::{Change, PieceFlow};
use super::rows::PolynomialRows;
use super::views::{add, multiply};
use liouville_base::parallel::Workers;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};

/// Variables of a run that a thread takes at a time.
const SHARE: usize = 1 << 14;
/// Shorter runs are not worth a second thread.
const LEAST: usize = 4 * SHARE;

/// Whether there are runs that are worth a second thread.
pub(super) fn has_long_runs(piece_flows: &[PieceFlow]) -> bool {
    let levels = piece_flows.iter().filter_map(|piece| piece.levels(false));
    levels.into_iter().any(|levels| {
        let mut runs = levels.iter().flat_map(PolynomialRows::iter);
        runs.any(|(run, _)| run.count >= LEAST)
    })
}

/// Changes all rows, the long runs of them by several threads.
pub(super) fn change_rows(
    (workers, machine): (&Workers, InstructionSet),
    change: Change,
    rows: &PolynomialRows,
    h: f64,
    (x, low): (&mut [f64], &mut [f64]),
) {
    for (run, program) in rows.iter() {
        let (first, last) = (run.place, run.place + run.count);
        let (before, rest) = x.split_at_mut(first);
        let (mine, after) = rest.split_at_mut(run.count);
        let low = match low.get_mut(first..last) {
            Some(low) => low,
            None => &mut [],
        };
        let (before, after) = (&*before, &*after);
        let work = |start, x: &mut [f64], low: &mut [f64]| {
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
            f64::run(machine, part);
        };
        if run.count < LEAST {
            work(0, mine, low);
        } else {
            workers.each(SHARE, mine, low, work);
        }
    }
}

/// The variables around those that a run changes.
#[derive(Clone, Copy)]
struct Around<'a> {
    before: &'a [f64],
    after: &'a [f64],
    /// The places that are changed.
    first: usize,
    last: usize,
    /// The offset in the run where the thread begins.
    start: usize,
}

/// These variables in a view.
struct SharedVariables<'a, W> {
    view: W,
    around: Around<'a>,
}

impl<W: SimdView<Stored = f64>> Variables for SharedVariables<'_, W> {
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
struct RunPart<'a> {
    program: &'a [Code],
    change: Change,
    h: f64,
    around: Around<'a>,
    x: &'a mut [f64],
    low: &'a mut [f64],
}

impl RunPart<'_> {
    #[inline(always)]
    fn value<W: SimdView<Stored = f64>>(&self, view: W) -> W::Number {
        let around = self.around;
        let zero = view.constant(0.0);
        evaluate(self.program, zero, &SharedVariables { view, around }).scaled(self.h)
    }
}

impl ForEach<f64> for RunPart<'_> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = f64>>(&mut self, view: W) -> bool {
        let value = self.value(view);
        add(view, (self.x, self.low), 0, value);
        true
    }
}

struct ScalePart<'a>(RunPart<'a>);

impl ForEach<f64> for ScalePart<'_> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = f64>>(&mut self, view: W) -> bool {
        let value = self.0.value(view);
        multiply(view, (self.0.x, self.0.low), 0, value);
        true
    }
}

impl Kernel<f64> for RunPart<'_> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(mut self, views: W) {
        let count = self.x.len();
        match self.change {
            Change::Add => views.each(count, &mut self),
            Change::Scale => views.each_narrow(count, &mut ScalePart(self)),
        };
    }
}
