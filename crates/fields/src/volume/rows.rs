//! Compiled rows of polynomials; neighbours that differ by a shift of one are stored as one run.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::{Code, RowTerm, compile};
use super::short::ShortRow;
use super::views::value;
use crate::problem::Polynomials;
use liouville_base::simd::{ForEach, SimdView, SimdViews};

/// Rows `place .. place + count`, whose programs read one place further each.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RowRun {
    pub(super) place: usize,
    pub(super) count: usize,
    /// The first row, if it is short.
    pub(super) short: Option<ShortRow>,
    start: usize,
    end: usize,
}

/// Polynomials, and the places that they change.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct PolynomialRows {
    runs: Vec<RowRun>,
    program: Vec<Code>,
}

impl PolynomialRows {
    /// Compiles the rows `rows` of `polynomials`, which change the places beside them.
    ///
    /// `place_of` is the place of a factor. Where `in_runs`, rows with neighbouring places are joined if
    /// their terms agree but for the shift.
    pub(super) fn new(
        polynomials: &Polynomials,
        rows: &[(usize, usize)],
        place_of: impl Fn(usize) -> u32,
        in_runs: bool,
    ) -> Self {
        let mut compiled = Self::default();
        let (mut last, mut terms): (Vec<RowTerm>, Vec<RowTerm>) = (Vec::new(), Vec::new());
        for &(row, place) in rows {
            terms.clear();
            terms.extend(polynomials.row(row).map(|(coefficient, factors)| {
                let places = factors.iter().map(|factor| place_of(*factor as usize));
                let mut places: Vec<u32> = places.collect();
                places.sort_unstable();
                (coefficient, places)
            }));
            terms.sort_by(|(_, a), (_, b)| a.cmp(b));
            let follows = |run: &&mut RowRun| in_runs && run.place + run.count == place;
            match compiled.runs.last_mut().filter(follows) {
                Some(run) if is_shifted(&last, &terms) => run.count += 1,
                _ => compiled.push(place, &terms),
            }
            std::mem::swap(&mut last, &mut terms);
        }
        compiled
    }

    /// Appends a row.
    pub(super) fn push(&mut self, place: usize, terms: &[RowTerm]) {
        let start = self.program.len();
        compile(terms, &mut self.program);
        self.runs.push(RowRun {
            place,
            count: 1,
            short: ShortRow::of(terms),
            start,
            end: self.program.len(),
        });
    }

    /// The runs, and the program of each run's first row.
    #[inline]
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = (&RowRun, &[Code])> {
        let program = |run: &RowRun| &self.program[run.start..run.end];
        self.runs.iter().map(move |run| (run, program(run)))
    }

    /// Sets each place of `out` to its row at `x`.
    #[inline(always)]
    pub(super) fn set<W: SimdViews>(&self, views: W, x: &[W::Stored], out: &mut [W::Stored]) {
        for (run, program) in self.iter() {
            let mut row = SetRow {
                program,
                place: run.place,
                x,
                out: &mut *out,
            };
            views.each(run.count, &mut row);
        }
    }
}

/// out = row
struct SetRow<'a, S> {
    program: &'a [Code],
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for SetRow<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let value = value(view, self.program, self.x);
        view.store(self.out, self.place, value);
        true
    }
}

/// Whether terms are those before, one place further each.
#[allow(clippy::float_cmp)] // the same numbers
fn is_shifted(before: &[RowTerm], now: &[RowTerm]) -> bool {
    let shifted = |(a, b): (&u32, &u32)| a + 1 == *b;
    before.len() == now.len()
        && before.iter().zip(now).all(|((c, before), (d, now))| {
            c == d && before.len() == now.len() && before.iter().zip(now).all(shifted)
        })
}

/// A place in a program.
#[allow(clippy::cast_possible_truncation)] // a split has fewer than 2^31 variables
pub(super) fn narrow(place: usize) -> u32 {
    place as u32
}
