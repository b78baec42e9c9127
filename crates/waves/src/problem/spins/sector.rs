//! States with a fixed number of spins down, in ascending order.
//!
//! The bits fall into high and low ones. States with the same high bits stand beside each other: their low
//! bits are all those with so many ones, in ascending order. The rank of a state is that of its high
//! bits' first state plus that of its low bits among these, two small tables. Source: lin1990.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::super::row_product::{Input, MatrixRows};
use super::full::Flip;
use liouville_base::simd::{ForEach, Number, SimdView, SimdViews};
use std::ops::Range;

/// At most so many bits are low.
const LOW: u32 = 10;

/// States with the same high bits.
#[derive(Clone, Debug)]
pub(super) struct HighGroup {
    first: usize,
    high: usize,
    /// How many low bits are ones.
    class: usize,
    high_flips: Range<usize>,
    low_flips: Range<usize>,
}

/// A flip of two high bits: the same low bits in another group.
#[derive(Clone, Copy, Debug)]
struct HighFlip {
    first: usize,
    half: f64,
}

/// A flip of a high and a low bit: other low bits in another group.
#[derive(Clone, Debug)]
struct HighLowFlip {
    first: usize,
    half: f64,
    table: usize,
}

/// Low bits with so many ones, and the flips of two of them.
#[derive(Clone, Debug, Default)]
struct Class {
    lows: Vec<usize>,
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

/// A sector.
#[derive(Clone, Debug)]
pub(super) struct Sector {
    /// H_ii of each state.
    pub(super) diagonal: Vec<f64>,
    low: u32,
    groups: Vec<HighGroup>,
    high_flips: Vec<HighFlip>,
    low_flips: Vec<HighLowFlip>,
    classes: Vec<Class>,
    /// For each class, low bit and value of it, ranks before and after it is flipped.
    tables: Vec<Vec<(u32, u32)>>,
}

fn ones(bits: usize) -> usize {
    bits.count_ones() as usize
}

impl Sector {
    /// The states with so many spins down, with the energy of each without flips.
    pub(super) fn new(
        length: u32,
        down: u32,
        flips: &[Flip],
        energy: impl Fn(usize) -> f64,
    ) -> Self {
        let low = LOW.min(length.div_ceil(2));
        let down = down as usize;
        let mut classes = vec![Class::default(); low as usize + 1];
        let mut rank = vec![0; 1 << low];
        for bits in 0..1 << low {
            let lows = &mut classes[ones(bits)].lows;
            rank[bits] = lows.len();
            lows.push(bits);
        }
        let (below, others): (Vec<Flip>, Vec<Flip>) = flips.iter().partition(|flip| flip.j < low);
        for class in &mut classes {
            class.fill(&below, &rank);
        }
        let mut sector = Self {
            diagonal: Vec::new(),
            low,
            groups: Vec::new(),
            high_flips: Vec::new(),
            low_flips: Vec::new(),
            tables: tables(low, &classes, &rank),
            classes,
        };
        sector.add_high_groups(length, down, &others);
        sector.diagonal = sector.states().map(energy).collect();
        sector
    }

    fn add_high_groups(&mut self, length: u32, down: usize, flips: &[Flip]) {
        let low = self.low;
        let class = |high: usize| down.checked_sub(ones(high)).filter(|k| *k <= low as usize);
        let highs = (0..1 << (length - low)).filter_map(|high| Some((high, class(high)?)));
        let mut firsts = vec![0; 1 << (length - low)];
        let mut at = 0;
        for (high, class) in highs.clone() {
            firsts[high] = at;
            at += self.classes[class].lows.len();
        }
        for (high, k) in highs {
            let (high_flips, low_flips) = (self.high_flips.len(), self.low_flips.len());
            for flip in flips {
                let (bits, half) = (high << low, flip.half);
                if flip.i >= low {
                    if flip.acts_on(bits) {
                        let first = firsts[high ^ flip.mask() >> low];
                        self.high_flips.push(HighFlip { first, half });
                    }
                    continue;
                }
                let is_set = bits >> flip.j & 1;
                let other = high ^ 1 << (flip.j - low);
                if class(other).is_some() {
                    self.low_flips.push(HighLowFlip {
                        first: firsts[other],
                        half,
                        table: (k * low as usize + flip.i as usize) * 2 + (1 - is_set),
                    });
                }
            }
            self.groups.push(HighGroup {
                first: firsts[high],
                high,
                class: k,
                high_flips: high_flips..self.high_flips.len(),
                low_flips: low_flips..self.low_flips.len(),
            });
        }
    }

    /// All states.
    fn states(&self) -> impl Iterator<Item = usize> {
        self.groups.iter().flat_map(move |group| {
            let lows = self.classes[group.class].lows.iter();
            lows.map(move |low| group.high << self.low | low)
        })
    }
}

/// For each class, low bit and value of it, ranks before and after it is flipped.
fn tables(low: u32, classes: &[Class], rank: &[usize]) -> Vec<Vec<(u32, u32)>> {
    let mut tables = Vec::new();
    for class in classes {
        for bit in 0..low {
            for value in 0..2 {
                let lows = class.lows.iter().enumerate();
                let flipped = lows.filter(|(_, bits)| *bits >> bit & 1 == value);
                tables.push(
                    flipped
                        .map(|(t, bits)| narrow(t, rank[bits ^ 1 << bit]))
                        .collect(),
                );
            }
        }
    }
    tables
}

#[allow(clippy::cast_possible_truncation)] // ranks of few bits
fn narrow(from: usize, to: usize) -> (u32, u32) {
    (from as u32, to as u32)
}

impl Class {
    fn fill(&mut self, flips: &[Flip], rank: &[usize]) {
        self.starts.push(0);
        for bits in &self.lows {
            let acting = flips.iter().filter(|flip| flip.acts_on(*bits));
            let entries = acting.map(|flip| (narrow(0, rank[bits ^ flip.mask()]).1, flip.half));
            self.entries.extend(entries);
            self.starts.push(self.entries.len());
        }
    }
}

impl MatrixRows for Sector {
    type Stretch<'a> = &'a HighGroup;

    #[inline(always)]
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        mut visit: impl FnMut(Range<usize>, &'a HighGroup),
    ) {
        let after = self
            .groups
            .partition_point(|group| group.first <= rows.start);
        for group in &self.groups[after - 1..] {
            let start = group.first.max(rows.start);
            let end = rows
                .end
                .min(group.first + self.classes[group.class].lows.len());
            if start >= end {
                break;
            }
            visit(start..end, group);
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        group: &HighGroup,
        view: V,
        row: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let mut sum = x.load(view, row) * view.shared(&self.diagonal, row);
        for flip in &self.high_flips[group.high_flips.clone()] {
            let other = flip.first + (row - group.first);
            sum = sum + x.load(view, other).scaled(flip.half);
        }
        sum
    }

    /// Flips of two low bits, then of a high and a low one.
    #[inline(always)]
    fn add_scattered<W: SimdViews>(
        &self,
        group: &HighGroup,
        views: W,
        factor: f64,
        row: usize,
        x: Input<'_, W::Stored>,
        out: &mut [W::Stored],
    ) {
        let (class, from) = (&self.classes[group.class], row - group.first);
        let end = from + out.len();
        for (t, out) in (from..end).zip(out.iter_mut()) {
            let mut add = AddStates {
                entries: &class.entries[class.starts[t]..class.starts[t + 1]],
                first: group.first,
                factor,
                x,
                out: std::slice::from_mut(out),
            };
            views.each(1, &mut add);
        }
        for flip in &self.low_flips[group.low_flips.clone()] {
            let table = &self.tables[flip.table];
            let first = table.partition_point(|(t, _)| (*t as usize) < from);
            let inside = |(t, _): &&(u32, u32)| (*t as usize) < end;
            for &(t, to) in table[first..].iter().take_while(inside) {
                let mut add = AddStates {
                    entries: &[(to, flip.half)],
                    first: flip.first,
                    factor,
                    x,
                    out: &mut out[t as usize - from..],
                };
                views.each(1, &mut add);
            }
        }
    }
}

/// Adds to one state the products of some others, by their distance from a first one.
struct AddStates<'a, S> {
    entries: &'a [(u32, f64)],
    first: usize,
    factor: f64,
    x: Input<'a, S>,
    out: &'a mut [S],
}

impl<S> ForEach<S> for AddStates<'_, S> {
    #[inline(always)]
    fn visit<V: SimdView<Stored = S>>(&mut self, view: V) -> bool {
        let mut sum = view.constant(0.0);
        for (to, half) in self.entries {
            let x = self.x.load(view, self.first + *to as usize);
            sum = sum + x.scaled(*half);
        }
        let sum = view.load(self.out, 0) + sum.scaled(self.factor);
        view.store(self.out, 0, sum);
        true
    }
}
