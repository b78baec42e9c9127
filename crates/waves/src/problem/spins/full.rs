//! All states of some spins, 64 neighbours at a time.
//!
//! Bits above the lowest six are the same in all of them: a turn of two such spins reads 64 neighbours
//! elsewhere, of one spin above and one below 64 neighbours of which half count, and of two spins below
//! neighbours at two distances, of which a quarter count each.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::super::update::update;
use super::{Block, Flip, Update};
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};

const LOW: u32 = 6;
const GROUP: usize = 1 << LOW;

/// What is multiplied with what stands at some distance, for each of 64 neighbours.
#[derive(Clone, Debug)]
struct Pattern {
    distance: usize,
    /// To what stands above, and below.
    values: [[f64; GROUP]; 2],
}

/// All states of some spins.
#[derive(Clone, Debug)]
pub(super) struct Full {
    groups: usize,
    flips: Vec<Flip>,
    above: Vec<Flip>,
    /// Bit j, which says whether what counts is above or below.
    across: Vec<(u32, Pattern)>,
    below: Vec<Pattern>,
}

impl Pattern {
    fn new(flip: Flip) -> Self {
        let mut values = [[0.0; GROUP]; 2];
        for low in 0..GROUP {
            let is_set = |bit: u32| low >> bit & 1 == 1;
            let is_across = flip.j >= LOW;
            if is_set(flip.i) && (is_across || !is_set(flip.j)) {
                values[0][low] = flip.half;
            }
            if !is_set(flip.i) && (is_across || is_set(flip.j)) {
                values[1][low] = flip.half;
            }
        }
        let distance = (1 << flip.j) - (1 << flip.i);
        Self { distance, values }
    }
}

impl Full {
    pub(super) fn new(length: u32, flips: &[Flip]) -> Self {
        let mut flips = flips.to_vec();
        flips.sort_by_key(|flip| (flip.i < LOW, flip.j < LOW));
        let of = |is_wanted: fn(&Flip) -> bool| flips.iter().copied().filter(is_wanted);
        let across = of(|flip| flip.i < LOW && flip.j >= LOW);
        Self {
            groups: (1 << length) / GROUP,
            above: of(|flip| flip.i >= LOW).collect(),
            across: across.map(|flip| (flip.j, Pattern::new(flip))).collect(),
            below: of(|flip| flip.j < LOW).map(Pattern::new).collect(),
            flips,
        }
    }

    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        diagonal: &[f64],
        update: Update,
        block: Block<'_, S>,
    ) {
        let full = self;
        let act = Act {
            full,
            diagonal,
            update,
            block,
        };
        S::run(machine, act);
    }

    /// Whether what stands around these states may not exist.
    #[inline(always)]
    fn is_at_the_edge(&self, group: usize) -> bool {
        group == 0 || group + 1 >= self.groups
    }
}

struct Act<'a, S> {
    full: &'a Full,
    diagonal: &'a [f64],
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Act<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        let end = row + out.len();
        let mut start = row;
        while start < end {
            let group = start / GROUP;
            let next = end.min((group + 1) * GROUP);
            let mut states = States {
                full: self.full,
                diagonal: self.diagonal,
                update: self.update,
                state: start,
                place,
                x,
                out: &mut out[start - row..next - row],
            };
            if self.full.is_at_the_edge(group) {
                for _ in start..next {
                    windows.each(1, &mut Single(&mut states));
                    states.state += 1;
                    states.out = &mut states.out[1..];
                }
            } else {
                windows.each(next - start, &mut states);
            }
            start = next;
        }
    }
}

/// States of a group.
struct States<'a, S> {
    full: &'a Full,
    diagonal: &'a [f64],
    update: Update,
    state: usize,
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> States<'_, S> {
    #[inline(always)]
    fn part<W: SimdView<Stored = S>>(&self, window: W, state: usize) -> W::Number {
        window.load(self.x, state - self.place)
    }
}

impl<S> ForEach<S> for States<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let state = self.state;
        let low = state % GROUP;
        let mut sum = self.part(window, state) * window.shared(self.diagonal, state);
        for flip in &self.full.above {
            if flip.acts_on(state) {
                sum = sum + self.part(window, state ^ flip.mask()).scaled(flip.half);
            }
        }
        for (bit, pattern) in &self.full.across {
            let is_below = state >> bit & 1;
            let at = if is_below == 1 {
                state - pattern.distance
            } else {
                state + pattern.distance
            };
            sum = sum + self.part(window, at) * window.shared(&pattern.values[is_below], low);
        }
        for pattern in &self.full.below {
            let [above, below] = &pattern.values;
            sum = sum + self.part(window, state + pattern.distance) * window.shared(above, low);
            sum = sum + self.part(window, state - pattern.distance) * window.shared(below, low);
        }
        let (from, to) = ((self.x, state - self.place), (&mut *self.out, 0));
        update(window, self.update, from, to, sum);
        true
    }
}

/// One state.
struct Single<'a, 'b, S>(&'a mut States<'b, S>);

impl<S> ForEach<S> for Single<'_, '_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let state = self.0.state;
        let mut sum = self.0.part(window, state) * window.shared(self.0.diagonal, state);
        for flip in &self.0.full.flips {
            if flip.acts_on(state) {
                sum = sum + self.0.part(window, state ^ flip.mask()).scaled(flip.half);
            }
        }
        let (from, to) = ((self.0.x, state - self.0.place), (&mut *self.0.out, 0));
        update(window, self.0.update, from, to, sum);
        true
    }
}
