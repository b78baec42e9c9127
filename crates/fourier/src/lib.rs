//! Discrete Fourier transforms of periodic grids of up to three axes, the last one fastest.
//!
//! Lines of the last axis are contiguous and are transformed in place. Those of another axis are gathered, some at a time,
//! into a tile that stays in the cache, also for the products between a transform and its inverse. Transforms are not
//! normalised.

mod axis;

use axis::{AxisTransform, FourierTiles, LineTransform};
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::FftPlanner;
use std::sync::Arc;

/// A complex number.
pub type Complex = rustfft::num_complex::Complex<f64>;

/// Squares that are added up before these are, so that rounding errors stay small.
const BLOCK: usize = 256;

/// Memory of transforms.
#[derive(Clone, Debug, Default)]
pub struct FourierScratch {
    /// The transform of a real array.
    spectrum: Vec<Complex>,
    /// A line of numbers.
    line: Vec<f64>,
    tiles: FourierTiles,
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

    /// Transforms lines that `read` writes, given their place, along all axes but the outermost, as long as `go_on` says so;
    /// returns the numbers of a plane, or none.
    fn forward(
        &self,
        memory: &mut FourierScratch,
        lines: usize,
        read: impl Fn(usize, &mut [f64]),
        go_on: &mut impl FnMut() -> bool,
    ) -> Option<usize> {
        let FourierScratch {
            spectrum,
            line,
            tiles,
        } = memory;
        let half = self.length / 2 + 1;
        spectrum.resize(lines * half, Complex::default());
        line.resize(self.length, 0.0);
        for (k, row) in spectrum.chunks_exact_mut(half).enumerate() {
            if !go_on() {
                return None;
            }
            read(k, line);
            let scratch = tiles.scratch(self.forward.get_scratch_len());
            let done = self.forward.process_with_scratch(line, row, scratch);
            debug_assert!(done.is_ok(), "lengths of a real transform");
        }
        let plane = lines / self.planes * half;
        if let Some(middle) = &self.middle {
            for plane in spectrum.chunks_exact_mut(plane) {
                if !go_on() {
                    return None;
                }
                middle.run(false, plane, tiles);
            }
        }
        Some(plane)
    }

    /// The sum of the squares of the transform of lines that `read` writes, given their place, times `factor` of the places
    /// along the outermost axis and in a plane; none where `go_on` says so.
    pub fn squares(
        &self,
        memory: &mut FourierScratch,
        lines: usize,
        read: impl Fn(usize, &mut [f64]),
        factor: impl Fn(usize, usize) -> f64,
        mut go_on: impl FnMut() -> bool,
    ) -> Option<f64> {
        self.forward(memory, lines, read, &mut go_on)?;
        let half = self.length / 2 + 1;
        // others stand for k and −k
        let is_single =
            |place: usize| place == 0 || (self.length.is_multiple_of(2) && place == half - 1);
        let (mut sum, mut block, mut count) = (0.0, 0.0, 0);
        let mut add = |k: usize, place: usize, value: Complex| {
            let times = if is_single(place % half) { 1.0 } else { 2.0 };
            block += times * factor(k, place) * value.norm_sqr();
            count += 1;
            if count % BLOCK == 0 {
                sum += std::mem::take(&mut block);
            }
        };
        let FourierScratch {
            spectrum, tiles, ..
        } = memory;
        let is_whole = if let Some(outer) = &self.outer {
            outer.look(spectrum, tiles, add, &mut go_on)
        } else {
            let each = spectrum.iter().enumerate();
            each.for_each(|(place, value)| add(0, place, *value));
            true
        };
        is_whole.then_some(sum + block)
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
        let Some(plane) = self.forward(memory, lines, read, &mut go_on) else {
            return false;
        };
        let FourierScratch {
            spectrum,
            line,
            tiles,
        } = memory;
        let half = self.length / 2 + 1;
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
