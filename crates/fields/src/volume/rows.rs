//! Rows of polynomials, compiled; neighbours that differ by a shift of one are stored as one.

use super::code::{Code, Term, compile};
use crate::problem::Polynomials;

/// Rows `place .. place + count`, whose programs read one place further each.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Run {
    pub(super) place: usize,
    pub(super) count: usize,
    start: usize,
    end: usize,
}

/// Polynomials, and the places of what they change.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Rows {
    runs: Vec<Run>,
    program: Vec<Code>,
}

impl Rows {
    /// Compiles the rows `rows` of `polynomials`, which change the places beside them.
    ///
    /// `place_of` says where a variable is. Where `in_runs`, rows with neighbouring places are joined if
    /// their terms agree but for the shift.
    pub(super) fn new(
        polynomials: &Polynomials,
        rows: &[(usize, usize)],
        place_of: impl Fn(usize) -> usize,
        in_runs: bool,
    ) -> Self {
        let mut compiled = Self::default();
        let (mut last, mut terms): (Vec<Term>, Vec<Term>) = (Vec::new(), Vec::new());
        for &(row, place) in rows {
            terms.clear();
            terms.extend(polynomials.row(row).map(|(coefficient, factors)| {
                let places = factors
                    .iter()
                    .map(|factor| narrow(place_of(*factor as usize)));
                let mut places: Vec<u32> = places.collect();
                places.sort_unstable();
                (coefficient, places)
            }));
            terms.sort_by(|(_, a), (_, b)| a.cmp(b));
            let follows = |run: &&mut Run| in_runs && run.place + run.count == place;
            match compiled.runs.last_mut().filter(follows) {
                Some(run) if is_shifted(&last, &terms) => run.count += 1,
                _ => compiled.push(place, &terms),
            }
            std::mem::swap(&mut last, &mut terms);
        }
        compiled
    }

    /// Appends a row.
    pub(super) fn push(&mut self, place: usize, terms: &[Term]) {
        let start = self.program.len();
        compile(terms, &mut self.program);
        self.runs.push(Run {
            place,
            count: 1,
            start,
            end: self.program.len(),
        });
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// The runs, and the program of each run's first row.
    #[inline]
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = (&Run, &[Code])> {
        let program = |run: &Run| &self.program[run.start..run.end];
        self.runs.iter().map(move |run| (run, program(run)))
    }
}

/// Whether terms are those before, one place further each.
#[allow(clippy::float_cmp)] // the same numbers
fn is_shifted(before: &[Term], now: &[Term]) -> bool {
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
