//! A potential V(t, x) on the points of a grid, which depends on time.

use liouville_base::real::{Lanes, Scalar, WIDTH};
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// Points between two polls for cancellation, a multiple of eight.
pub(crate) const AT_ONCE: usize = 1 << 14;

/// The function V and the points, eight of them side by side.
#[derive(Clone, Debug)]
pub struct Potential {
    tape: Arc<Tape>,
    params: Vec<f64>,
    axes: usize,
    size: usize,
    points: Arc<[Lanes]>,
}

impl Potential {
    /// A tape of (t, x, parameters) with one value, at `points`, the coordinates of one after those of another;
    /// none where sizes do not fit.
    pub fn new(tape: Arc<Tape>, params: &[f64], points: &[f64]) -> Option<Self> {
        let axes = *tape.inputs().get(1)?;
        let fits = tape.inputs() == [1, axes, params.len()] && tape.outputs() == 1;
        if !fits || axes == 0 || points.is_empty() || !points.len().is_multiple_of(axes) {
            return None;
        }
        let size = points.len() / axes;
        let firsts = (0..size).step_by(WIDTH);
        // the last block repeats its last point
        let at =
            |first: usize, axis: usize, lane: usize| (first + lane).min(size - 1) * axes + axis;
        let block = |first: usize| {
            (0..axes)
                .map(move |axis| Lanes(std::array::from_fn(|lane| points[at(first, axis, lane)])))
        };
        Some(Self {
            points: firsts.flat_map(block).collect(),
            params: params.to_vec(),
            tape,
            axes,
            size,
        })
    }

    /// Number of points.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The same at some of the points only: about so many blocks of eight.
    #[must_use]
    pub(crate) fn thinned(&self, blocks: usize) -> Self {
        let all = self.points.chunks_exact(self.axes);
        let each = all.len().div_ceil(blocks).max(1);
        let points: Arc<[Lanes]> = all.step_by(each).flatten().copied().collect();
        Self {
            size: points.len() / self.axes * WIDTH,
            points,
            ..self.clone()
        }
    }

    /// Memory of evaluations.
    pub(crate) fn bind(&self) -> Registers<Lanes> {
        let params: Vec<Lanes> = self.params.iter().map(|p| Lanes::splat(*p)).collect();
        self.tape.bind(&params)
    }

    /// Adds `factor` times the potential at `t`, at the points from `first` on, a multiple of eight.
    pub(crate) fn add(
        &self,
        registers: &mut Registers<Lanes>,
        (factor, t): (f64, f64),
        first: usize,
        values: &mut [f64],
    ) {
        let t = [Lanes::splat(t)];
        let points = self.points[first / WIDTH * self.axes..].chunks_exact(self.axes);
        for (values, x) in values.chunks_mut(WIDTH).zip(points) {
            let Lanes(found) = self.tape.eval(registers, [&t, x])[0];
            for (value, found) in values.iter_mut().zip(found) {
                *value += factor * found;
            }
        }
    }
}
