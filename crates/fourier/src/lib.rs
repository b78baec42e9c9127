//! Discrete Fourier transforms of periodic grids of up to three axes, the last one fastest.
//!
//! Lines of the last axis are contiguous and are transformed in place. Those of another axis are gathered, some at a time,
//! into a tile that stays in the cache, also for the products between a transform and its inverse. Transforms are not
//! normalised.

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// A complex number.
pub type Complex = rustfft::num_complex::Complex<f64>;

/// Lines in a tile: two cache lines from each place along the axis. On 512² and 1024² points 4 and 8 lines take
/// the same time, 16 a tenth more and 32 a third.
const LINES: usize = 8;

/// Memory of transforms.
#[derive(Clone, Debug, Default)]
pub struct FourierScratch {
    /// The transform of a real array.
    spectrum: Vec<Complex>,
    /// A line of numbers.
    line: Vec<f64>,
    tiles: FourierTiles,
}

/// Some lines of an axis, and scratch memory of their transforms.
#[derive(Clone, Debug, Default)]
struct FourierTiles {
    tile: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl FourierTiles {
    fn scratch(&mut self, len: usize) -> &mut [Complex] {
        if self.scratch.len() < len {
            self.scratch.resize(len, Complex::default());
        }
        &mut self.scratch[..len]
    }
}

/// Transforms of one length.
#[derive(Clone)]
struct LineTransform {
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl LineTransform {
    fn new(planner: &mut FftPlanner<f64>, length: usize) -> Self {
        Self {
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    fn run(&self, is_inverse: bool, lines: &mut [Complex], tiles: &mut FourierTiles) {
        let fft = if is_inverse {
            &self.inverse
        } else {
            &self.forward
        };
        fft.process_with_scratch(lines, tiles.scratch(fft.get_inplace_scratch_len()));
    }
}

/// Transforms along an axis whose neighbours lie `stride` apart.
#[derive(Clone)]
struct AxisTransform {
    length: usize,
    stride: usize,
    line: LineTransform,
}

impl AxisTransform {
    fn new(planner: &mut FftPlanner<f64>, length: usize, stride: usize) -> Option<Self> {
        let line = LineTransform::new(planner, length);
        (length > 1).then_some(Self {
            length,
            stride,
            line,
        })
    }

    /// Calls `each` with the place of the first line for one tile after another, as long as `go_on` says so; returns
    /// whether all were made.
    fn for_tiles<F>(
        &self,
        data: &mut [Complex],
        tiles: &mut FourierTiles,
        go_on: &mut impl FnMut() -> bool,
        mut each: F,
    ) -> bool
    where
        F: FnMut(usize, &mut [Complex], &mut FourierTiles),
    {
        let (length, stride) = (self.length, self.stride);
        let mut tile = std::mem::take(&mut tiles.tile);
        let mut is_whole = true;
        for first in (0..stride).step_by(LINES) {
            is_whole = go_on();
            if !is_whole {
                break;
            }
            let lines = LINES.min(stride - first);
            tile.resize(lines * length, Complex::default());
            for (k, row) in data.chunks_exact(stride).enumerate() {
                for (j, value) in row[first..first + lines].iter().enumerate() {
                    tile[j * length + k] = *value;
                }
            }
            each(first, &mut tile, tiles);
            for (k, row) in data.chunks_exact_mut(stride).enumerate() {
                for (j, value) in row[first..first + lines].iter_mut().enumerate() {
                    *value = tile[j * length + k];
                }
            }
        }
        tiles.tile = tile;
        is_whole
    }

    fn run(&self, is_inverse: bool, data: &mut [Complex], tiles: &mut FourierTiles) {
        self.for_tiles(data, tiles, &mut || true, |_, tile, tiles| {
            self.line.run(is_inverse, tile, tiles);
        });
    }

    /// Transforms, multiplies by `factor(place in the axis, place of the line)`, and transforms back, as long as `go_on`
    /// says so.
    fn multiply<T: Copy>(
        &self,
        data: &mut [Complex],
        tiles: &mut FourierTiles,
        factor: impl Fn(usize, usize) -> T,
        go_on: &mut impl FnMut() -> bool,
    ) -> bool
    where
        Complex: std::ops::Mul<T, Output = Complex>,
    {
        self.for_tiles(data, tiles, go_on, |first, tile, tiles| {
            self.line.run(false, tile, tiles);
            for (j, line) in tile.chunks_exact_mut(self.length).enumerate() {
                for (k, value) in line.iter_mut().enumerate() {
                    *value = *value * factor(k, first + j);
                }
            }
            self.line.run(true, tile, tiles);
        })
    }
}

/// Number of points along each of three axes, one for an absent axis.
///
/// # Panics
/// When there are no axes, or more than three.
pub fn padded(shape: &[usize]) -> [usize; 3] {
    assert!((1..=3).contains(&shape.len()), "number of axes");
    let mut all = [1; 3];
    // a grid of two axes has the outermost one and the last
    all[2] = shape[shape.len() - 1];
    all[..shape.len() - 1].copy_from_slice(&shape[..shape.len() - 1]);
    all
}

/// Transforms of real arrays.
#[derive(Clone)]
pub struct RealGrid {
    length: usize,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
    middle: Option<AxisTransform>,
    outer: Option<AxisTransform>,
    planes: usize,
}

impl RealGrid {
    /// Transforms of grids with so many points along each axis.
    pub fn new([n0, n1, n2]: [usize; 3]) -> Self {
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        let half = n2 / 2 + 1;
        Self {
            length: n2,
            forward: real.plan_fft_forward(n2),
            inverse: real.plan_fft_inverse(n2),
            middle: AxisTransform::new(&mut complex, n1, half),
            outer: AxisTransform::new(&mut complex, n0, n1 * half),
            planes: n0,
        }
    }

    /// Transforms lines that `read` writes, given their place, multiplies by `factor` of the places along the outermost
    /// axis and in a plane, transforms back, and gives each line to `write`, as long as `go_on` says so; returns whether
    /// all was made.
    pub fn multiply(
        &self,
        memory: &mut FourierScratch,
        lines: usize,
        read: impl Fn(usize, &mut [f64]),
        factor: impl Fn(usize, usize) -> f64,
        mut write: impl FnMut(usize, &[f64]),
        mut go_on: impl FnMut() -> bool,
    ) -> bool {
        let FourierScratch {
            spectrum,
            line,
            tiles,
        } = memory;
        let half = self.length / 2 + 1;
        spectrum.resize(lines * half, Complex::default());
        line.resize(self.length, 0.0);
        let plane = lines / self.planes * half;
        for (k, row) in spectrum.chunks_exact_mut(half).enumerate() {
            if !go_on() {
                return false;
            }
            read(k, line);
            let scratch = tiles.scratch(self.forward.get_scratch_len());
            let done = self.forward.process_with_scratch(line, row, scratch);
            debug_assert!(done.is_ok(), "lengths of a real transform");
        }
        if let Some(middle) = &self.middle {
            for plane in spectrum.chunks_exact_mut(plane) {
                if !go_on() {
                    return false;
                }
                middle.run(false, plane, tiles);
            }
        }
        match &self.outer {
            Some(outer) => {
                if !outer.multiply(spectrum, tiles, factor, &mut go_on) {
                    return false;
                }
            }
            None => {
                for (place, value) in spectrum.iter_mut().enumerate() {
                    *value *= factor(0, place);
                }
            }
        }
        if let Some(middle) = &self.middle {
            for plane in spectrum.chunks_exact_mut(plane) {
                if !go_on() {
                    return false;
                }
                middle.run(true, plane, tiles);
            }
        }
        for (k, row) in spectrum.chunks_exact_mut(half).enumerate() {
            if !go_on() {
                return false;
            }
            // the imaginary parts of these are rounding errors
            row[0].im = 0.0;
            if self.length.is_multiple_of(2) {
                row[half - 1].im = 0.0;
            }
            let scratch = tiles.scratch(self.inverse.get_scratch_len());
            let done = self.inverse.process_with_scratch(row, line, scratch);
            debug_assert!(done.is_ok(), "lengths of a real transform");
            write(k, line);
        }
        true
    }
}

/// Transforms of complex arrays, in place.
#[derive(Clone)]
pub struct Grid {
    last: LineTransform,
    middle: Option<AxisTransform>,
    outer: Option<AxisTransform>,
    plane: usize,
}

impl Grid {
    /// Transforms of grids with so many points along each axis.
    pub fn new([n0, n1, n2]: [usize; 3]) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            last: LineTransform::new(&mut planner, n2),
            middle: AxisTransform::new(&mut planner, n1, n2),
            outer: AxisTransform::new(&mut planner, n0, n1 * n2),
            plane: n1 * n2,
        }
    }

    /// Numbers in a plane, which has one place along the outermost axis.
    pub fn plane(&self) -> usize {
        self.plane
    }

    /// Transforms a plane.
    pub fn forward(&self, plane: &mut [Complex], memory: &mut FourierScratch) {
        self.last.run(false, plane, &mut memory.tiles);
        if let Some(middle) = &self.middle {
            middle.run(false, plane, &mut memory.tiles);
        }
    }

    /// Transforms a plane back.
    pub fn inverse(&self, plane: &mut [Complex], memory: &mut FourierScratch) {
        if let Some(middle) = &self.middle {
            middle.run(true, plane, &mut memory.tiles);
        }
        self.last.run(true, plane, &mut memory.tiles);
    }

    /// With all planes transformed, multiplies by a product of factors along the outermost axis and in a plane, as long as
    /// `go_on` says so; returns whether all was made.
    pub fn multiply(
        &self,
        data: &mut [Complex],
        memory: &mut FourierScratch,
        (along, within): (&[Complex], &[Complex]),
        mut go_on: impl FnMut() -> bool,
    ) -> bool {
        let Some(outer) = &self.outer else {
            for (value, factor) in data.iter_mut().zip(within) {
                *value *= factor * along[0];
            }
            return true;
        };
        let factor = |k: usize, place: usize| along[k] * within[place];
        outer.multiply(data, &mut memory.tiles, factor, &mut go_on)
    }
}
