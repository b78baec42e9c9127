//! All states of some spins, in groups of 64 neighbours.
//!
//! Bits above the lowest six are the same in a group. A flip of two such spins reads another group; a flip of one spin
//! above and one below reads 64 neighbours of which half count; a flip of two spins below reads neighbours at two
//! distances, of which a quarter count each.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::super::row_product::{Input, MatrixRows};
use liouville_base::simd::{Number, SimdView};
use std::ops::Range;

const LOW: u32 = 6;
const GROUP: usize = 1 << LOW;

/// Two spins that act on each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bond {
    /// i and j, which differ.
    pub sites: (u32, u32),
    /// J, half of which flips two opposite spins.
    pub xy: f64,
    /// Δ
    pub z: f64,
}

/// The flip of two opposite spins: bits i < j, and J/2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Flip {
    pub(super) i: u32,
    pub(super) j: u32,
    pub(super) half: f64,
}

impl Flip {
    pub(super) fn new(bond: &Bond) -> Self {
        let (i, j) = bond.sites;
        Self {
            i: i.min(j),
            j: i.max(j),
            half: 0.5 * bond.xy,
        }
    }

    #[inline(always)]
    pub(super) fn mask(self) -> usize {
        1 << self.i | 1 << self.j
    }

    /// Whether the spins are opposite.
    #[inline(always)]
    pub(super) fn acts_on(self, state: usize) -> bool {
        (state >> self.i ^ state >> self.j) & 1 == 1
    }
}

/// The factors of states at some distance, for each of 64 neighbours.
#[derive(Clone, Debug)]
struct FlipPattern {
    distance: usize,
    /// Values of the state above, and of the state below.
    values: [[f64; GROUP]; 2],
}

/// All states of some spins.
#[derive(Clone, Debug)]
pub(super) struct Full {
    /// H_ii of each state.
    pub(super) diagonal: Vec<f64>,
    groups: usize,
    flips: Vec<Flip>,
    above: Vec<Flip>,
    /// Bit j, which tells whether the state above or below counts.
    across: Vec<(u32, FlipPattern)>,
    below: Vec<FlipPattern>,
}

impl FlipPattern {
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
    pub(super) fn new(length: u32, flips: &[Flip], diagonal: Vec<f64>) -> Self {
        let mut flips = flips.to_vec();
        flips.sort_by_key(|flip| (flip.i < LOW, flip.j < LOW));
        let of = |is_wanted: fn(&Flip) -> bool| flips.iter().copied().filter(is_wanted);
        let across = of(|flip| flip.i < LOW && flip.j >= LOW);
        Self {
            diagonal,
            groups: (1 << length) / GROUP,
            above: of(|flip| flip.i >= LOW).collect(),
            across: across
                .map(|flip| (flip.j, FlipPattern::new(flip)))
                .collect(),
            below: of(|flip| flip.j < LOW).map(FlipPattern::new).collect(),
            flips,
        }
    }

    /// Σ over flips one by one.
    #[inline(always)]
    fn add_flips<V: SimdView>(
        &self,
        sum: V::Number,
        view: V,
        state: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let mut sum = sum;
        for flip in &self.flips {
            if flip.acts_on(state) {
                sum = sum + x.load(view, state ^ flip.mask()).scaled(flip.half);
            }
        }
        sum
    }

    /// Σ over flips by groups of neighbours.
    #[inline(always)]
    fn add_groups<V: SimdView>(
        &self,
        sum: V::Number,
        view: V,
        state: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let (mut sum, low) = (sum, state % GROUP);
        for flip in &self.above {
            if flip.acts_on(state) {
                sum = sum + x.load(view, state ^ flip.mask()).scaled(flip.half);
            }
        }
        for (bit, pattern) in &self.across {
            let is_below = state >> bit & 1;
            let other = if is_below == 1 {
                state - pattern.distance
            } else {
                state + pattern.distance
            };
            sum = sum + x.load(view, other) * view.shared(&pattern.values[is_below], low);
        }
        for FlipPattern { distance, values } in &self.below {
            let [above, below] = values;
            sum = sum + x.load(view, state + distance) * view.shared(above, low);
            sum = sum + x.load(view, state - distance) * view.shared(below, low);
        }
        sum
    }
}

/// Whether the neighbours of a group may not exist, so that its states are computed one by one.
#[derive(Clone, Copy, Debug)]
pub(super) struct IsEdge(bool);

impl MatrixRows for Full {
    type Stretch<'a> = IsEdge;

    #[inline(always)]
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        mut visit: impl FnMut(Range<usize>, Self::Stretch<'a>),
    ) {
        let mut start = rows.start;
        while start < rows.end {
            let group = start / GROUP;
            let is_edge = group == 0 || group + 1 >= self.groups;
            let size = if is_edge {
                1
            } else {
                (group + 1) * GROUP - start
            };
            let end = rows.end.min(start + size);
            visit(start..end, IsEdge(is_edge));
            start = end;
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        IsEdge(is_edge): IsEdge,
        view: V,
        state: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let sum = x.load(view, state) * view.shared(&self.diagonal, state);
        if is_edge {
            self.add_flips(sum, view, state, x)
        } else {
            self.add_groups(sum, view, state, x)
        }
    }
}
