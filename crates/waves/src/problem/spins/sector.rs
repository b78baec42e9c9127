//! States with a fixed number of spins down, in ascending order.
//!
//! The bits fall into high and low ones. States with the same high bits stand beside each other: their low
//! bits are all those with so many ones, in ascending order. The rank of a state is that of its high
//! bits' first state plus that of its low bits among these, two small tables. Source: lin1990.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::super::update::update;
use super::{Block, Flip, Update};
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use std::ops::Range;

/// At most so many bits are low.
const LOW: u32 = 10;

/// States with the same high bits.
#[derive(Clone, Debug)]
struct Stretch {
    first: usize,
    high: usize,
    /// How many low bits are ones.
    class: usize,
    links: Range<usize>,
    turns: Range<usize>,
}

/// Two high bits are turned: the same low bits elsewhere.
#[derive(Clone, Copy, Debug)]
struct Link {
    first: usize,
    half: f64,
}

/// A high and a low bit are turned: other low bits elsewhere.
#[derive(Clone, Debug)]
struct Turn {
    first: usize,
    half: f64,
    table: usize,
}

/// Low bits with so many ones, and where two of them are turned.
#[derive(Clone, Debug, Default)]
struct Class {
    lows: Vec<usize>,
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

/// A sector.
#[derive(Clone, Debug)]
pub(super) struct Sector {
    low: u32,
    stretches: Vec<Stretch>,
    links: Vec<Link>,
    turns: Vec<Turn>,
    classes: Vec<Class>,
    /// For each class, low bit and value of it, ranks before and after it is turned.
    tables: Vec<Vec<(u32, u32)>>,
}

fn ones(bits: usize) -> usize {
    bits.count_ones() as usize
}

impl Sector {
    pub(super) fn new(length: u32, down: u32, flips: &[Flip]) -> Self {
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
            low,
            stretches: Vec::new(),
            links: Vec::new(),
            turns: Vec::new(),
            tables: tables(low, &classes, &rank),
            classes,
        };
        sector.add_stretches(length, down, &others);
        sector
    }

    fn add_stretches(&mut self, length: u32, down: usize, flips: &[Flip]) {
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
            let (links, turns) = (self.links.len(), self.turns.len());
            for flip in flips {
                let (bits, half) = (high << low, flip.half);
                if flip.i >= low {
                    if flip.acts_on(bits) {
                        let first = firsts[high ^ flip.mask() >> low];
                        self.links.push(Link { first, half });
                    }
                    continue;
                }
                let is_set = bits >> flip.j & 1;
                let other = high ^ 1 << (flip.j - low);
                if class(other).is_some() {
                    self.turns.push(Turn {
                        first: firsts[other],
                        half,
                        table: (k * low as usize + flip.i as usize) * 2 + (1 - is_set),
                    });
                }
            }
            self.stretches.push(Stretch {
                first: firsts[high],
                high,
                class: k,
                links: links..self.links.len(),
                turns: turns..self.turns.len(),
            });
        }
    }

    /// All states.
    pub(super) fn states(&self) -> impl Iterator<Item = usize> {
        self.stretches.iter().flat_map(move |stretch| {
            let lows = self.classes[stretch.class].lows.iter();
            lows.map(move |low| stretch.high << self.low | low)
        })
    }

    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        diagonal: &[f64],
        update: Update,
        block: Block<'_, S>,
    ) {
        let sector = self;
        let act = Act {
            sector,
            diagonal,
            update,
            block,
        };
        S::run(machine, act);
    }
}

/// For each class, low bit and value of it, ranks before and after it is turned.
fn tables(low: u32, classes: &[Class], rank: &[usize]) -> Vec<Vec<(u32, u32)>> {
    let mut tables = Vec::new();
    for class in classes {
        for bit in 0..low {
            for value in 0..2 {
                let lows = class.lows.iter().enumerate();
                let turned = lows.filter(|(_, bits)| *bits >> bit & 1 == value);
                tables.push(
                    turned
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

struct Act<'a, S> {
    sector: &'a Sector,
    diagonal: &'a [f64],
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Act<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        let (sector, end) = (self.sector, row + out.len());
        let after = sector
            .stretches
            .partition_point(|stretch| stretch.first <= row);
        for stretch in &sector.stretches[after - 1..] {
            let class = &sector.classes[stretch.class];
            let start = stretch.first.max(row);
            let next = end.min(stretch.first + class.lows.len());
            if start >= next {
                break;
            }
            let mut part = Part {
                sector,
                stretch,
                diagonal: self.diagonal,
                update: self.update,
                from: start - stretch.first,
                place,
                x,
                out: &mut out[start - row..next - row],
            };
            windows.each(next - start, &mut part);
            part.add_within(windows, class);
            part.add_across(windows);
        }
    }
}

/// Some of the states of a stretch.
struct Part<'a, S> {
    sector: &'a Sector,
    stretch: &'a Stretch,
    diagonal: &'a [f64],
    update: Update,
    /// The rank of the first.
    from: usize,
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for Part<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let (x, at) = (self.x, self.stretch.first + self.from);
        let mut sum = window.load(x, at - self.place) * window.shared(self.diagonal, at);
        for link in &self.sector.links[self.stretch.links.clone()] {
            let x = window.load(x, link.first + self.from - self.place);
            sum = sum + x.scaled(link.half);
        }
        let from = (x, at - self.place);
        update(window, self.update, from, (self.out, 0), sum);
        true
    }
}

impl<S> Part<'_, S> {
    /// Adds what comes of two low bits.
    #[inline(always)]
    fn add_within<W: SimdViews<Stored = S>>(&mut self, windows: W, class: &Class) {
        let x = &self.x[self.stretch.first - self.place..][..class.lows.len()];
        for (k, out) in self.out.iter_mut().enumerate() {
            let t = self.from + k;
            let entries = &class.entries[class.starts[t]..class.starts[t + 1]];
            let mut within = Within {
                entries,
                factor: self.update.factor,
                x,
                out: std::slice::from_mut(out),
            };
            windows.each(1, &mut within);
        }
    }

    /// Adds what comes of a high and a low bit.
    #[inline(always)]
    fn add_across<W: SimdViews<Stored = S>>(&mut self, windows: W) {
        let end = self.from + self.out.len();
        for turn in &self.sector.turns[self.stretch.turns.clone()] {
            let x = &self.x[turn.first - self.place..];
            let table = &self.sector.tables[turn.table];
            let first = table.partition_point(|(t, _)| (*t as usize) < self.from);
            for &(t, to) in table[first..]
                .iter()
                .take_while(|(t, _)| (*t as usize) < end)
            {
                let entries = &[(to, turn.half)];
                let mut within = Within {
                    entries,
                    factor: self.update.factor,
                    x,
                    out: &mut self.out[t as usize - self.from..],
                };
                windows.each(1, &mut within);
            }
        }
    }
}

/// A sum over some states, for one.
struct Within<'a, S> {
    entries: &'a [(u32, f64)],
    factor: f64,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for Within<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let mut sum = window.constant(0.0);
        for (to, half) in self.entries {
            sum = sum + window.load(self.x, *to as usize).scaled(*half);
        }
        let sum = window.load(self.out, 0) + sum.scaled(self.factor);
        window.store(self.out, 0, sum);
        true
    }
}
