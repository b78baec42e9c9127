//! Discrete Fourier transforms of periodic grids of up to three axes, the last one fastest.
//!
//! Lines of the last axis lie in one piece and are transformed where they are. Those of another axis are
//! gathered, some at a time, into a tile that stays in the cache, so that what is done between a transform and
//! its inverse is done there too. Transforms are not normalised.

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// A complex number.
pub type Complex = rustfft::num_complex::Complex<f64>;

/// Lines in a tile: two cache lines from each place along the axis. On 512² and 1024² points 4 and 8 lines take
/// the same time, 16 a tenth more and 32 a third.
const LINES: usize = 8;

/// FourierScratch of transforms.
#[derive(Clone, Debug, Default)]
pub struct FourierScratch {
    /// The transform of a real array.
    pub(super) spectrum: Vec<Complex>,
    /// A line of numbers.
    pub(super) line: Vec<f64>,
    /// Some lines of an axis, and what the transforms need.
    work: Work,
}

#[derive(Clone, Debug, Default)]
struct Work {
    tile: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl Work {
    fn scratch(&mut self, len: usize) -> &mut [Complex] {
        if self.scratch.len() < len {
            self.scratch.resize(len, Complex::default());
        }
        &mut self.scratch[..len]
    }
}

/// Transforms of one length.
#[derive(Clone)]
struct Line {
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl Line {
    fn new(planner: &mut FftPlanner<f64>, length: usize) -> Self {
        Self {
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    fn run(&self, is_inverse: bool, lines: &mut [Complex], work: &mut Work) {
        let fft = if is_inverse {
            &self.inverse
        } else {
            &self.forward
        };
        fft.process_with_scratch(lines, work.scratch(fft.get_inplace_scratch_len()));
    }
}

/// An axis whose neighbours lie `stride` apart.
#[derive(Clone)]
struct Across {
    length: usize,
    stride: usize,
    line: Line,
}

impl Across {
    fn new(planner: &mut FftPlanner<f64>, length: usize, stride: usize) -> Option<Self> {
        let line = Line::new(planner, length);
        (length > 1).then_some(Self {
            length,
            stride,
            line,
        })
    }

    /// Does `each` to blocking of lines one after another, told the place of their first one.
    fn blocking<F>(&self, data: &mut [Complex], work: &mut Work, mut each: F)
    where
        F: FnMut(usize, &mut [Complex], &mut Work),
    {
        let (length, stride) = (self.length, self.stride);
        let mut tile = std::mem::take(&mut work.tile);
        for first in (0..stride).step_by(LINES) {
            let lines = LINES.min(stride - first);
            tile.resize(lines * length, Complex::default());
            for (k, row) in data.chunks_exact(stride).enumerate() {
                for (j, value) in row[first..first + lines].iter().enumerate() {
                    tile[j * length + k] = *value;
                }
            }
            each(first, &mut tile, work);
            for (k, row) in data.chunks_exact_mut(stride).enumerate() {
                for (j, value) in row[first..first + lines].iter_mut().enumerate() {
                    *value = tile[j * length + k];
                }
            }
        }
        work.tile = tile;
    }

    fn run(&self, is_inverse: bool, data: &mut [Complex], work: &mut Work) {
        self.blocking(data, work, |_, tile, work| {
            self.line.run(is_inverse, tile, work);
        });
    }

    /// Transforms, multiplies by `factor(place in the axis, place of the line)`, and transforms back.
    fn multiply<T: Copy>(
        &self,
        data: &mut [Complex],
        work: &mut Work,
        factor: impl Fn(usize, usize) -> T,
    ) where
        Complex: std::ops::Mul<T, Output = Complex>,
    {
        self.blocking(data, work, |first, tile, work| {
            self.line.run(false, tile, work);
            for (j, line) in tile.chunks_exact_mut(self.length).enumerate() {
                for (k, value) in line.iter_mut().enumerate() {
                    *value = *value * factor(k, first + j);
                }
            }
            self.line.run(true, tile, work);
        });
    }
}

/// Number of points along each of three axes; those that are not there have one.
pub(super) fn padded(shape: &[usize]) -> [usize; 3] {
    assert!((1..=3).contains(&shape.len()), "number of axes");
    let mut all = [1; 3];
    // a grid of two axes has the outermost one and the last
    all[2] = shape[shape.len() - 1];
    all[..shape.len() - 1].copy_from_slice(&shape[..shape.len() - 1]);
    all
}

/// Transforms of real arrays.
#[derive(Clone)]
pub(super) struct RealGrid {
    length: usize,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
    middle: Option<Across>,
    outer: Option<Across>,
    planes: usize,
}

impl RealGrid {
    pub(super) fn new([n0, n1, n2]: [usize; 3]) -> Self {
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        let half = n2 / 2 + 1;
        Self {
            length: n2,
            forward: real.plan_fft_forward(n2),
            inverse: real.plan_fft_inverse(n2),
            middle: Across::new(&mut complex, n1, half),
            outer: Across::new(&mut complex, n0, n1 * half),
            planes: n0,
        }
    }

    /// Transforms what `read` writes to a line (told its place), multiplies by `factor` of the places along
    /// the outermost axis and in a plane, transforms back, and hands each line to `write`.
    pub(super) fn multiply(
        &self,
        memory: &mut FourierScratch,
        lines: usize,
        read: impl Fn(usize, &mut [f64]),
        factor: impl Fn(usize, usize) -> f64,
        mut write: impl FnMut(usize, &[f64]),
    ) {
        let FourierScratch {
            spectrum,
            line,
            work,
        } = memory;
        let half = self.length / 2 + 1;
        spectrum.resize(lines * half, Complex::default());
        line.resize(self.length, 0.0);
        let plane = lines / self.planes * half;
        for (k, row) in spectrum.chunks_exact_mut(half).enumerate() {
            read(k, line);
            let scratch = work.scratch(self.forward.get_scratch_len());
            let done = self.forward.process_with_scratch(line, row, scratch);
            debug_assert!(done.is_ok(), "lengths of a real transform");
        }
        if let Some(middle) = &self.middle {
            for plane in spectrum.chunks_exact_mut(plane) {
                middle.run(false, plane, work);
            }
        }
        match &self.outer {
            Some(outer) => outer.multiply(spectrum, work, factor),
            None => {
                for (place, value) in spectrum.iter_mut().enumerate() {
                    *value *= factor(0, place);
                }
            }
        }
        if let Some(middle) = &self.middle {
            for plane in spectrum.chunks_exact_mut(plane) {
                middle.run(true, plane, work);
            }
        }
        for (k, row) in spectrum.chunks_exact_mut(half).enumerate() {
            // what a real array's transform has no imaginary part in has some from rounding
            row[0].im = 0.0;
            if self.length.is_multiple_of(2) {
                row[half - 1].im = 0.0;
            }
            let scratch = work.scratch(self.inverse.get_scratch_len());
            let done = self.inverse.process_with_scratch(row, line, scratch);
            debug_assert!(done.is_ok(), "lengths of a real transform");
            write(k, line);
        }
    }
}

/// Transforms of complex arrays, in place.
#[derive(Clone)]
pub struct Grid {
    last: Line,
    middle: Option<Across>,
    outer: Option<Across>,
    plane: usize,
}

impl Grid {
    pub(super) fn new([n0, n1, n2]: [usize; 3]) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            last: Line::new(&mut planner, n2),
            middle: Across::new(&mut planner, n1, n2),
            outer: Across::new(&mut planner, n0, n1 * n2),
            plane: n1 * n2,
        }
    }

    /// Numbers in a plane: those that differ in the outermost axis not at all.
    pub fn plane(&self) -> usize {
        self.plane
    }

    /// Transforms a plane.
    pub fn forward(&self, plane: &mut [Complex], memory: &mut FourierScratch) {
        self.last.run(false, plane, &mut memory.work);
        if let Some(middle) = &self.middle {
            middle.run(false, plane, &mut memory.work);
        }
    }

    /// Transforms a plane back.
    pub fn inverse(&self, plane: &mut [Complex], memory: &mut FourierScratch) {
        if let Some(middle) = &self.middle {
            middle.run(true, plane, &mut memory.work);
        }
        self.last.run(true, plane, &mut memory.work);
    }

    /// With all planes transformed, multiplies by a product of factors along the outermost axis and in a plane.
    pub fn multiply(
        &self,
        data: &mut [Complex],
        memory: &mut FourierScratch,
        along: &[Complex],
        within: &[Complex],
    ) {
        match &self.outer {
            Some(outer) => {
                outer.multiply(data, &mut memory.work, |k, place| along[k] * within[place]);
            }
            None => {
                for (value, factor) in data.iter_mut().zip(within) {
                    *value *= factor * along[0];
                }
            }
        }
    }
}
