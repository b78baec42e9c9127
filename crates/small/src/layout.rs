//! The values of a number at the stages or nodes of a step, in vector registers.
//!
//! Of one trajectory a register holds the number at up to eight points; of several members it holds one number of each
//! at one point, and points follow one another as rows. All is computed in the same order, to the same bits.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use liouville_base::real::{Lanes, Real, Scalar, WIDTH};
use std::fmt::Debug;

/// The most points: lanes of one trajectory, rows of several.
pub(super) const POINTS: usize = WIDTH;

/// A number of a state whose values at several points stand in registers.
pub trait Layout: Real {
    /// Values in a register, or in a few.
    type Row: Real + Debug;
    /// The values at the points, in rows.
    type Points: Copy + Debug + Send + Sync + AsRef<[Self::Row]> + AsMut<[Self::Row]>;

    /// Zeros.
    fn zeros() -> Self::Points;
    /// How many rows so many points take.
    fn rows(points: usize) -> usize;
    /// The number itself, the same for all points of a row.
    fn every(self) -> Self::Row;
    /// The value at one point.
    fn at(points: &Self::Points, i: usize) -> Self;
    /// Sets the value at one point, and makes those at the others, in so many rows, of what they were: all at once, since
    /// what is written in part waits for memory when it is read.
    fn replace(
        points: &mut Self::Points,
        rows: usize,
        at: (usize, Self),
        others: impl Fn(usize, Self::Row) -> Self::Row,
    );
    /// Adds another's value at one point.
    fn add_point(points: &mut Self::Points, other: &Self::Points, i: usize);
    /// The same with another value beyond the first `count` points, where lanes stand for points that are not there.
    fn extended(points: &Self::Points, count: usize, value: Self) -> Self::Points;
    /// Factors of the points, as a row takes them.
    fn factor(factors: &Lanes, row: usize) -> Self::Row;
    /// `out_i = finish(Σ_j weights_ij x_j)`, even and odd j apart.
    fn product(
        out: &mut [Self::Row],
        weights: &Weights,
        x: &Self::Points,
        finish: impl Fn(usize, Self::Row) -> Self::Row,
    );
    /// `out_i = Σ_j weights_ij x_j`
    #[inline(always)]
    fn sums(out: &mut [Self::Row], weights: &Weights, x: &Self::Points) {
        Self::product(
            out,
            weights,
            x,
            #[inline(always)]
            |_, sum| sum,
        );
    }
    /// The same of numbers that do not stand in registers.
    fn product_of(out: &mut [Self::Row], weights: &Weights, x: impl Fn(usize) -> Self);
    /// The largest value of a row, of each member.
    fn largest(row: Self::Row) -> Self;
}

/// A one at each point.
const UNITS: [Lanes; POINTS] = {
    let mut units = [Lanes([0.0; POINTS]); POINTS];
    let mut i = 0;
    while i < POINTS {
        units[i].0[i] = 1.0;
        i += 1;
    }
    units
};

/// A matrix between points: its columns, a lane for each row; the lanes left repeat the last row, or are zero. Columns of
/// zeros fill up the last four, so that loops have a length that is known.
#[derive(Clone, Debug)]
pub struct Weights {
    columns: Vec<Lanes>,
    count: usize,
}

impl Weights {
    pub(super) fn new(cols: usize, value: impl Fn(usize, usize) -> f64) -> Self {
        let mut weights = Self {
            columns: vec![Lanes::splat(0.0); cols.next_multiple_of(4)],
            count: cols,
        };
        weights.set(value);
        weights
    }

    /// The columns.
    #[inline(always)]
    pub(super) fn columns(&self) -> &[Lanes] {
        &self.columns[..self.count]
    }

    #[inline(always)]
    pub(super) fn set(&mut self, value: impl Fn(usize, usize) -> f64) {
        for (j, column) in self.columns[..self.count].iter_mut().enumerate() {
            for i in 0..POINTS {
                column.0[i] = value(i, j);
            }
        }
    }
}

/// A one at each of the first points.
const FIRST: [Lanes; POINTS + 1] = {
    let mut first = [Lanes([0.0; POINTS]); POINTS + 1];
    let mut count = 0;
    while count <= POINTS {
        let mut i = 0;
        while i < count {
            first[count].0[i] = 1.0;
            i += 1;
        }
        count += 1;
    }
    first
};

impl Layout for f64 {
    type Row = Lanes;
    type Points = [Lanes; 1];

    #[inline(always)]
    fn zeros() -> [Lanes; 1] {
        [Lanes::splat(0.0)]
    }
    #[inline(always)]
    fn rows(_: usize) -> usize {
        1
    }
    #[inline(always)]
    fn every(self) -> Lanes {
        Lanes::splat(self)
    }
    #[inline(always)]
    fn at(points: &[Lanes; 1], i: usize) -> f64 {
        points[0].0[i]
    }
    #[inline(always)]
    fn replace(
        points: &mut [Lanes; 1],
        _: usize,
        (i, value): (usize, f64),
        others: impl Fn(usize, Lanes) -> Lanes,
    ) {
        points[0] = UNITS[i].choose(Lanes::splat(value), others(0, points[0]));
    }
    #[inline(always)]
    fn add_point(points: &mut [Lanes; 1], other: &[Lanes; 1], i: usize) {
        points[0] = UNITS[i].choose(points[0] + other[0], points[0]);
    }
    #[inline(always)]
    fn extended(points: &[Lanes; 1], count: usize, value: f64) -> [Lanes; 1] {
        [FIRST[count].choose(points[0], Lanes::splat(value))]
    }
    #[inline(always)]
    fn factor(factors: &Lanes, _: usize) -> Lanes {
        *factors
    }
    #[inline(always)]
    fn product(
        out: &mut [Lanes],
        weights: &Weights,
        x: &[Lanes; 1],
        finish: impl Fn(usize, Lanes) -> Lanes,
    ) {
        let mut sums = [Lanes::splat(0.0); 2];
        let (x, columns) = (
            x[0].0.as_chunks::<4>().0,
            weights.columns.as_chunks::<4>().0,
        );
        for (columns, x) in columns.iter().zip(x) {
            for j in 0..4 {
                sums[j % 2] += columns[j] * x[j];
            }
        }
        out[0] = finish(0, sums[0] + sums[1]);
    }
    #[inline(always)]
    fn product_of(out: &mut [Lanes], weights: &Weights, x: impl Fn(usize) -> f64) {
        let mut sum = Lanes::splat(0.0);
        for (j, column) in weights.columns[..weights.count].iter().enumerate() {
            sum += *column * x(j);
        }
        out[0] = sum;
    }
    #[inline(always)]
    fn largest(row: Lanes) -> f64 {
        let mut most = row.0;
        for half in [4, 2, 1] {
            for i in 0..half {
                most[i] = if most[i + half] > most[i] {
                    most[i + half]
                } else {
                    most[i]
                };
            }
        }
        most[0]
    }
}

impl<const W: usize> Layout for Lanes<W> {
    type Row = Self;
    type Points = [Self; POINTS];

    #[inline(always)]
    fn zeros() -> [Self; POINTS] {
        [Self::splat(0.0); POINTS]
    }
    #[inline(always)]
    fn rows(points: usize) -> usize {
        points
    }
    #[inline(always)]
    fn every(self) -> Self {
        self
    }
    #[inline(always)]
    fn at(points: &[Self; POINTS], i: usize) -> Self {
        points[i]
    }
    #[inline(always)]
    fn replace(
        points: &mut [Self; POINTS],
        rows: usize,
        (i, value): (usize, Self),
        others: impl Fn(usize, Self) -> Self,
    ) {
        for (row, x) in points[..rows].iter_mut().enumerate() {
            *x = if row == i { value } else { others(row, *x) };
        }
    }
    #[inline(always)]
    fn add_point(points: &mut [Self; POINTS], other: &[Self; POINTS], i: usize) {
        points[i] += other[i];
    }
    #[inline(always)]
    fn extended(points: &[Self; POINTS], _: usize, _: Self) -> [Self; POINTS] {
        *points
    }
    #[inline(always)]
    fn factor(factors: &Lanes, row: usize) -> Self {
        Self::splat(factors.0[row])
    }
    #[inline(always)]
    fn product(
        out: &mut [Self],
        weights: &Weights,
        x: &[Self; POINTS],
        finish: impl Fn(usize, Self) -> Self,
    ) {
        let columns = &weights.columns[..weights.count.next_multiple_of(2)];
        for (i, out) in out.iter_mut().enumerate().take(POINTS) {
            let mut sums = [Self::splat(0.0); 2];
            let pairs = columns.as_chunks::<2>().0.iter();
            for (columns, x) in pairs.zip(x.as_chunks::<2>().0) {
                sums[0] += x[0] * columns[0].0[i];
                sums[1] += x[1] * columns[1].0[i];
            }
            *out = finish(i, sums[0] + sums[1]);
        }
    }
    #[inline(always)]
    fn product_of(out: &mut [Self], weights: &Weights, x: impl Fn(usize) -> Self) {
        for (i, out) in out.iter_mut().enumerate().take(POINTS) {
            let mut sum = Self::splat(0.0);
            for (j, column) in weights.columns[..weights.count].iter().enumerate() {
                sum += x(j) * column.0[i];
            }
            *out = sum;
        }
    }
    #[inline(always)]
    fn largest(row: Self) -> Self {
        row
    }
}

/// The larger of a size and a magnitude.
#[inline(always)]
pub(super) fn larger<R: Real>(size: R, x: R) -> R {
    size.zip(
        x,
        #[inline(always)]
        |size, x| if x.abs() > size { x.abs() } else { size },
    )
}
