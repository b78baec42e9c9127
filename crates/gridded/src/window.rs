//! The potential as a spline of one coordinate, near the cell where that is.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::basis::{Basis, MOST, Place};
use crate::spline::Spline;

/// Coefficients of F and of its derivative by the other coordinate, of the functions from `first` on: those of three
/// cells. `M` is two more than the functions of a cell.
pub(crate) struct Window<const M: usize> {
    pub(crate) first: usize,
    values: [f64; M],
    slopes: [f64; M],
}

/// The place of frozen coordinates: the coefficients there, and the values of their functions.
pub(crate) struct Frozen<'a, const K: usize> {
    spline: &'a Spline,
    offset: [usize; K],
    count: [usize; K],
    weights: [[f64; MOST]; K],
    strides: [usize; K],
}

impl<'a, const K: usize> Frozen<'a, K> {
    #[inline(always)]
    pub(crate) fn new(spline: &'a Spline, bases: &[Basis], places: [Place; K]) -> Self {
        let mut strides = [spline.axes[0].functions() * spline.axes[1].functions(); K];
        for k in (1..K).rev() {
            strides[k - 1] = strides[k] * bases[k].functions();
        }
        let mut frozen = Self {
            spline,
            offset: [0; K],
            count: [0; K],
            weights: [[0.0; MOST]; K],
            strides,
        };
        for k in 0..K {
            frozen.offset[k] = places[k].cell * strides[k];
            frozen.count[k] = bases[k].degree() + 1;
            frozen.weights[k] = bases[k].values(places[k]);
        }
        frozen
    }

    /// Calls `add` with each product of functions: its weight, and where its coefficients begin.
    #[inline(always)]
    fn each(&self, mut add: impl FnMut(Option<f64>, usize)) {
        match K {
            0 => add(None, 0),
            1 => {
                for i in 0..self.count[0] {
                    add(
                        Some(self.weights[0][i]),
                        self.offset[0] + i * self.strides[0],
                    );
                }
            }
            _ => {
                for i in 0..self.count[0] {
                    for j in 0..self.count[1] {
                        let weight = self.weights[0][i] * self.weights[1][j];
                        let place = self.offset[0] + i * self.strides[0];
                        add(Some(weight), place + self.offset[1] + j * self.strides[1]);
                    }
                }
            }
        }
    }
}

impl<const M: usize> Window<M> {
    /// The window around cell `near` of the implicit coordinate, given the functions of the explicit one and their slopes.
    /// `is_inner`: whether the implicit coordinate is the last of the array.
    #[inline(always)]
    pub(crate) fn new<const N: usize, const K: usize>(
        frozen: &Frozen<'_, K>,
        (cell, values, slopes): (usize, &[f64; N], &[f64; N]),
        near: usize,
        is_inner: bool,
    ) -> Self {
        let spline = frozen.spline;
        let implicit = &spline.axes[usize::from(is_inner)];
        let first = near.saturating_sub(1).min(implicit.cells() - 3);
        let mut window = Self {
            first,
            values: [0.0; M],
            slopes: [0.0; M],
        };
        let stride = spline.axes[1].functions();
        if is_inner {
            let mut patch = [[0.0; M]; N];
            let corner = cell * stride + first;
            frozen.each(
                #[inline(always)]
                |weight, place| spline.gather(&mut patch, weight, place + corner, stride),
            );
            for i in 0..N {
                for m in 0..M {
                    window.values[m] += values[i] * patch[i][m];
                    window.slopes[m] += slopes[i] * patch[i][m];
                }
            }
        } else {
            let mut patch = [[0.0; N]; M];
            let corner = first * stride + cell;
            frozen.each(
                #[inline(always)]
                |weight, place| spline.gather(&mut patch, weight, place + corner, stride),
            );
            for m in 0..M {
                for i in 0..N {
                    window.values[m] += values[i] * patch[m][i];
                    window.slopes[m] += slopes[i] * patch[m][i];
                }
            }
        }
        window
    }

    /// Whether it has the functions of a cell.
    #[inline(always)]
    pub(crate) fn holds(&self, cell: usize) -> bool {
        cell.wrapping_sub(self.first) < 3
    }

    /// F_e and F_eu, the derivatives by the explicit coordinate e and by both, given the functions of the cell of u.
    #[inline(always)]
    pub(crate) fn implicit<const N: usize>(
        &self,
        cell: usize,
        (values, slopes): (&[f64; N], &[f64; N]),
    ) -> (f64, f64) {
        let own = &self.slopes[cell - self.first..][..N];
        (dot(own, values), dot(own, slopes))
    }

    /// F_u
    #[inline(always)]
    pub(crate) fn explicit<const N: usize>(&self, cell: usize, slopes: &[f64; N]) -> f64 {
        dot(&self.values[cell - self.first..][..N], slopes)
    }
}

#[inline(always)]
fn dot<const N: usize>(a: &[f64], b: &[f64; N]) -> f64 {
    let mut sum = a[0] * b[0];
    for i in 1..N {
        sum += a[i] * b[i];
    }
    sum
}
