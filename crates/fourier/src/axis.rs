//! Transforms along one axis of a grid.

use super::Complex;
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Lines in a tile: two cache lines from each place along the axis. On 512² and 1024² points 4 and 8 lines take
/// the same time, 16 a tenth more and 32 a third.
const LINES: usize = 8;

/// Some lines of an axis, and scratch memory of their transforms.
#[derive(Clone, Debug, Default)]
pub(crate) struct FourierTiles {
    tile: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl FourierTiles {
    pub(crate) fn scratch(&mut self, len: usize) -> &mut [Complex] {
        if self.scratch.len() < len {
            self.scratch.resize(len, Complex::default());
        }
        &mut self.scratch[..len]
    }
}

/// Transforms of one length.
#[derive(Clone)]
pub(crate) struct LineTransform {
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl LineTransform {
    pub(crate) fn new(planner: &mut FftPlanner<f64>, length: usize) -> Self {
        Self {
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    pub(crate) fn run(&self, is_inverse: bool, lines: &mut [Complex], tiles: &mut FourierTiles) {
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
pub(crate) struct AxisTransform {
    length: usize,
    stride: usize,
    line: LineTransform,
}

impl AxisTransform {
    pub(crate) fn new(planner: &mut FftPlanner<f64>, length: usize, stride: usize) -> Option<Self> {
        let line = LineTransform::new(planner, length);
        (length > 1).then_some(Self {
            length,
            stride,
            line,
        })
    }

    /// Calls `each` with the place of the first line for one tile after another, as long as `go_on` says so, and keeps what
    /// it makes of them, if wanted; returns whether all were made.
    pub(crate) fn for_tiles<const IS_KEPT: bool, F>(
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
            if !IS_KEPT {
                continue;
            }
            for (k, row) in data.chunks_exact_mut(stride).enumerate() {
                for (j, value) in row[first..first + lines].iter_mut().enumerate() {
                    *value = tile[j * length + k];
                }
            }
        }
        tiles.tile = tile;
        is_whole
    }

    pub(crate) fn run(&self, is_inverse: bool, data: &mut [Complex], tiles: &mut FourierTiles) {
        self.for_tiles::<true, _>(data, tiles, &mut || true, |_, tile, tiles| {
            self.line.run(is_inverse, tile, tiles);
        });
    }

    /// Transforms, multiplies by `factor(place in the axis, place of the line)`, and transforms back, as long as `go_on`
    /// says so.
    pub(crate) fn multiply<T: Copy>(
        &self,
        data: &mut [Complex],
        tiles: &mut FourierTiles,
        factor: impl Fn(usize, usize) -> T,
        go_on: &mut impl FnMut() -> bool,
    ) -> bool
    where
        Complex: std::ops::Mul<T, Output = Complex>,
    {
        self.for_tiles::<true, _>(data, tiles, go_on, |first, tile, tiles| {
            self.line.run(false, tile, tiles);
            for (j, line) in tile.chunks_exact_mut(self.length).enumerate() {
                for (k, value) in line.iter_mut().enumerate() {
                    *value = *value * factor(k, first + j);
                }
            }
            self.line.run(true, tile, tiles);
        })
    }

    /// Transforms, and calls `each` with places in the axis and of lines; returns whether `go_on` said so all the time. What is
    /// transformed is not kept.
    pub(crate) fn look(
        &self,
        data: &mut [Complex],
        tiles: &mut FourierTiles,
        mut each: impl FnMut(usize, usize, Complex),
        go_on: &mut impl FnMut() -> bool,
    ) -> bool {
        self.for_tiles::<false, _>(data, tiles, go_on, |first, tile, tiles| {
            self.line.run(false, tile, tiles);
            for (j, line) in tile.chunks_exact(self.length).enumerate() {
                for (k, value) in line.iter().enumerate() {
                    each(k, first + j, *value);
                }
            }
        })
    }
}
