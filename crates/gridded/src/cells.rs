//! The polynomials of a spline in the cells where trajectories are.
//!
//! A trajectory stays in a cell for many flows. There F = Σ A_jk s_v^j s_w^k, with powers of the frozen coordinates too,
//! and a flow needs neither the functions of the axes nor the coefficients of the grid. The polynomial depends on the cell
//! alone, so a trajectory has the same bits whether it has been there or comes to it.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::Place;
use crate::equation::Fault;
use crate::spline::Spline;
use liouville_base::real::Real;
use std::ops::Range;

/// Where the cells of a coordinate are, for each member.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places<R> {
    low: R,
    high: R,
    pub(crate) origin: R,
    pub(crate) inverse: R,
}

/// The polynomials of cells, for each member.
#[derive(Clone, Debug)]
pub(crate) struct Cells<R> {
    /// The frozen coordinates first, then v and w.
    pub(crate) places: [Places<R>; 4],
    /// Numbers of the cells, by axis.
    numbers: Vec<[usize; 4]>,
    /// Coefficients by powers of the frozen coordinates, v and w.
    polynomial: Vec<R>,
    /// U and V by powers of the last frozen coordinate, or one number.
    mean: [Vec<R>; 2],
    /// Memory for the polynomial of one member, twice.
    one: [Vec<f64>; 2],
}

impl<R: Real> Places<R> {
    fn none() -> Self {
        let zero = R::splat(0.0);
        Self {
            low: R::splat(f64::INFINITY),
            high: zero,
            origin: zero,
            inverse: zero,
        }
    }

    /// Zero for the members that are in their cells.
    #[inline(always)]
    fn outside(&self, x: R) -> R {
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        x.if_less(self.low, one, x.if_less(self.high, zero, one))
    }

    fn holds(&self, member: usize, x: f64) -> bool {
        self.low.member(member) <= x && x < self.high.member(member)
    }

    fn set(&mut self, member: usize, place: &Place) {
        self.low.set_member(member, place.between[0]);
        self.high.set_member(member, place.between[1]);
        self.origin.set_member(member, place.origin);
        self.inverse.set_member(member, place.inverse);
    }

    /// The coordinates within the cells.
    #[inline(always)]
    pub(crate) fn s(&self, x: R) -> R {
        (x - self.origin) * self.inverse
    }
}

impl<R: Real> Cells<R> {
    pub(crate) fn new(spline: &Spline) -> Self {
        let [first, second] = spline.powers();
        let size = first * second * (spline.axes[0].degree() + 1).pow(2);
        let mean = |values: &Vec<f64>| {
            let powers = [second, first][usize::from(spline.frozen() == 1)];
            let count = if values.len() > 1 { powers } else { 1 };
            vec![R::splat(values[0]); count]
        };
        Self {
            places: [Places::none(); 4],
            numbers: vec![[usize::MAX; 4]; R::MEMBERS],
            polynomial: vec![R::splat(0.0); size],
            mean: [mean(&spline.mean[0]), mean(&spline.mean[1])],
            one: [vec![0.0; size], vec![0.0; size]],
        }
    }

    /// Whether all members are in their cells, by some coordinates.
    #[inline(always)]
    pub(crate) fn hold(&self, x: &[R; 4], axes: Range<usize>) -> bool {
        let mut outside = R::splat(0.0);
        for k in axes {
            outside += self.places[k].outside(x[k]);
        }
        outside.all(
            #[inline(always)]
            |outside| outside == 0.0,
        )
    }

    /// Finds the cells of the members that have left theirs; coordinates beyond a wall by roundoff are put on it.
    ///
    /// # Errors
    /// A coordinate is outside its axis, and the number of the member.
    #[inline(always)]
    pub(crate) fn enter<const N: usize>(
        &mut self,
        spline: &Spline,
        x: &mut [R; 4],
    ) -> Result<(), (Fault, usize)> {
        for member in 0..R::MEMBERS {
            let mut is_new = false;
            for k in 0..spline.frozen() + 2 {
                let value = x[k].member(member);
                if self.places[k].holds(member, value) {
                    continue;
                }
                let Some(place) = spline.axis(k).locate(value) else {
                    self.numbers[member] = [usize::MAX; 4];
                    self.places = [Places::none(); 4];
                    return Err((Fault::Outside(k), member));
                };
                x[k].set_member(member, place.x);
                is_new |= self.set(member, k, &place);
            }
            if is_new {
                self.fill::<N>(spline, member);
            }
        }
        Ok(())
    }

    /// Finds the cells of the members whose coordinate k, an iterate, has left theirs.
    #[inline(always)]
    pub(crate) fn follow<const N: usize>(&mut self, spline: &Spline, k: usize, x: R) {
        for member in 0..R::MEMBERS {
            let value = x.member(member);
            if !self.places[k].holds(member, value) {
                let place = spline.axis(k).find(value);
                if self.set(member, k, &place) {
                    self.fill::<N>(spline, member);
                }
            }
        }
    }

    /// Sets the place of a member; whether its polynomial is another one.
    fn set(&mut self, member: usize, k: usize, place: &Place) -> bool {
        self.places[k].set(member, place);
        let is_new = self.numbers[member][k] != place.cell;
        self.numbers[member][k] = place.cell;
        is_new
    }

    /// Computes the polynomial of a member.
    #[inline(always)]
    fn fill<const N: usize>(&mut self, spline: &Spline, member: usize) {
        let ([n0, n1], frozen) = (spline.powers(), spline.frozen());
        let cells = &self.numbers[member];
        let [from, to] = &mut self.one;
        let width = spline.axes[1].functions();
        let [v, w] = [0, 1].map(|k| (cells[frozen + k], &spline.axes[k]));
        let [of_v, of_w] = [v, w].map(|(cell, axis)| &axis.polynomials(cell)[..N * N]);
        let mut starts = [0; 2];
        let mut stride = spline.axes[0].functions() * width;
        let mut strides = [0; 2];
        for k in (0..frozen).rev() {
            (starts[k], strides[k]) = (cells[k] * stride, stride);
            stride *= spline.frozen[k].functions();
        }
        let corner = starts[0] + starts[1] + v.0 * width + w.0;
        for i in 0..n0 {
            for j in 0..n1 {
                let corner = corner + i * strides[0] + j * strides[1];
                let block = block::<N>(&spline.coefficients[corner..], width, of_v, of_w);
                from[(i * n1 + j) * N * N..][..N * N].copy_from_slice(block.as_flattened());
            }
        }
        if frozen > 1 {
            let table = spline.frozen[1].polynomials(cells[1]);
            for i in 0..n0 {
                let range = i * n1 * N * N..(i + 1) * n1 * N * N;
                turn::<N>(&from[range.clone()], &mut to[range], (n1, 1), table);
            }
            std::mem::swap(from, to);
        }
        if frozen > 0 {
            let table = spline.frozen[0].polynomials(cells[0]);
            turn::<N>(from, to, (n0, n1), table);
            std::mem::swap(from, to);
        }
        for (c, value) in self.polynomial.iter_mut().zip(&*from) {
            c.set_member(member, *value);
        }
        if let Some(last) = frozen.checked_sub(1) {
            let table = spline.frozen[last].polynomials(cells[last]);
            for (mean, values) in self.mean.iter_mut().zip(&spline.mean) {
                let count = mean.len();
                if count > 1 {
                    let own = &values[cells[last]..][..count];
                    for j in 0..count {
                        let terms = own.iter().enumerate();
                        let sum = terms.fold(0.0, |sum, (i, c)| sum + c * table[i * count + j]);
                        mean[j].set_member(member, sum);
                    }
                }
            }
        }
    }

    /// U and V at the frozen coordinates.
    #[inline(always)]
    pub(crate) fn mean(&self, last: R) -> [R; 2] {
        [
            horner(self.mean[0].iter(), last),
            horner(self.mean[1].iter(), last),
        ]
    }

    /// F and its derivative by s, by powers of u, where s is v or, if `is_inner`, w; given the frozen coordinates.
    #[inline(always)]
    pub(crate) fn along<const N: usize>(
        &self,
        [n0, n1]: [usize; 2],
        frozen: [R; 2],
        (s, is_inner): (R, bool),
    ) -> ([R; N], [R; N]) {
        let zero = R::splat(0.0);
        let (mut values, mut slopes) = ([zero; N], [zero; N]);
        let contracted;
        let plane: &[R] = if n0 * n1 == 1 {
            &self.polynomial[..N * N]
        } else {
            contracted = self.contract::<N>([n0, n1], frozen);
            contracted.as_flattened()
        };
        for k in 0..N {
            let place = |j: usize| if is_inner { k * N + j } else { j * N + k };
            let mut value = plane[place(N - 1)];
            let mut slope = value;
            value = value * s + plane[place(N - 2)];
            for j in (0..N - 2).rev() {
                slope = slope * s + value;
                value = value * s + plane[place(j)];
            }
            (values[k], slopes[k]) = (value, slope);
        }
        (values, slopes)
    }

    /// Coefficients by powers of v and w.
    #[inline(always)]
    fn contract<const N: usize>(&self, [n0, n1]: [usize; 2], frozen: [R; 2]) -> [[R; N]; N] {
        let mut sum = [[R::splat(0.0); N]; N];
        let blocks = self.polynomial.as_chunks::<N>().0;
        for i in (0..n0).rev() {
            for row in 0..N {
                let of = |j: usize| blocks[(i * n1 + j) * N + row];
                let mut inner = of(n1 - 1);
                for j in (0..n1 - 1).rev() {
                    let next = of(j);
                    for k in 0..N {
                        inner[k] = inner[k] * frozen[1] + next[k];
                    }
                }
                for k in 0..N {
                    sum[row][k] = sum[row][k] * frozen[0] + inner[k];
                }
            }
        }
        sum
    }
}

/// The polynomial of coefficients by functions of v and w.
#[inline(always)]
fn block<const N: usize>(c: &[f64], width: usize, of_v: &[f64], of_w: &[f64]) -> [[f64; N]; N] {
    let mut block = [[0.0; N]; N];
    for r in 0..N {
        let own = &c[r * width..][..N];
        let mut row = [0.0; N];
        for c in 0..N {
            for k in 0..N {
                row[k] += own[c] * of_w[c * N + k];
            }
        }
        for j in 0..N {
            for k in 0..N {
                block[j][k] += of_v[r * N + j] * row[k];
            }
        }
    }
    block
}

/// Powers in place of functions for the first of two numbers of blocks, of which there are so many.
#[inline(always)]
fn turn<const N: usize>(
    from: &[f64],
    to: &mut [f64],
    (count, each): (usize, usize),
    table: &[f64],
) {
    let (from, to) = (from.as_chunks::<N>().0, to.as_chunks_mut::<N>().0);
    for j in 0..count {
        for place in 0..each * N {
            let mut sum = [0.0; N];
            for i in 0..count {
                let (own, c) = (from[i * each * N + place], table[i * count + j]);
                for k in 0..N {
                    sum[k] += c * own[k];
                }
            }
            to[j * each * N + place] = sum;
        }
    }
}

/// Σ c_k s^k
#[inline(always)]
fn horner<'a, R: Real>(c: impl DoubleEndedIterator<Item = &'a R>, s: R) -> R {
    let mut sum = R::splat(0.0);
    for (k, c) in c.rev().enumerate() {
        sum = if k == 0 { *c } else { sum * s + *c };
    }
    sum
}
