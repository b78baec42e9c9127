//! A potential V(t, x) on the points of a grid, which depends on time.
//!
//! It is F(g(t), u(x)): functions g of the time alone are evaluated once a time, and values u at each point are given.

use liouville_base::real::{Lanes, Scalar, WIDTH};
use liouville_base::tape::{Registers, Tape};
use std::sync::Arc;

/// Points between two polls for cancellation, a multiple of eight.
pub(crate) const AT_ONCE: usize = 1 << 14;

/// The functions g and F, and u at the points, eight of them side by side.
#[derive(Clone, Debug)]
pub struct Potential {
    of_time: Arc<Tape>,
    tape: Arc<Tape>,
    params: Vec<f64>,
    axes: usize,
    size: usize,
    points: Arc<[Lanes]>,
}

/// Memory of evaluations.
#[derive(Clone)]
pub(crate) struct PotentialRegisters {
    of_time: Registers<f64>,
    points: Registers<Lanes>,
    g: Vec<Lanes>,
}

/// Memory has no state that anyone reads.
impl std::fmt::Debug for PotentialRegisters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PotentialRegisters").finish_non_exhaustive()
    }
}

impl Potential {
    /// Tapes of (t, parameters) for g, and of (g, u, parameters) with one value for F, at `points`, the u of one after
    /// those of another; none where sizes do not fit.
    pub fn new(
        (of_time, tape): (Arc<Tape>, Arc<Tape>),
        params: &[f64],
        points: &[f64],
    ) -> Option<Self> {
        let axes = *tape.inputs().get(1)?;
        let fits = of_time.inputs() == [1, params.len()]
            && tape.inputs() == [of_time.outputs(), axes, params.len()]
            && tape.outputs() == 1;
        if !fits || axes == 0 || points.is_empty() || !points.len().is_multiple_of(axes) {
            return None;
        }
        let size = points.len() / axes;
        let value = |point: usize, axis: usize| points[point * axes + axis];
        Some(Self {
            points: in_lanes(size, axes, value),
            params: params.to_vec(),
            of_time,
            tape,
            axes,
            size,
        })
    }

    /// Number of points.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Number of functions of the time.
    pub(crate) fn functions(&self) -> usize {
        self.of_time.outputs()
    }

    /// The same at some of the points only.
    #[must_use]
    pub(crate) fn at_points(&self, places: &[usize]) -> Self {
        let value = |point: usize, axis: usize| {
            let (block, lane) = (places[point] / WIDTH, places[point] % WIDTH);
            self.points[block * self.axes + axis].0[lane]
        };
        Self {
            points: in_lanes(places.len(), self.axes, value),
            size: places.len(),
            ..self.clone()
        }
    }

    /// Memory of evaluations.
    pub(crate) fn bind(&self) -> PotentialRegisters {
        let params: Vec<Lanes> = self.params.iter().map(|p| Lanes::splat(*p)).collect();
        PotentialRegisters {
            of_time: self.of_time.bind(&self.params),
            points: self.tape.bind(&params),
            g: vec![Lanes::splat(0.0); self.functions()],
        }
    }

    /// The functions of the time at `t`.
    pub(crate) fn at_time<'r>(&self, registers: &'r mut PotentialRegisters, t: f64) -> &'r [f64] {
        self.of_time.eval(&mut registers.of_time, [&[t]])
    }

    /// Adds `factor` times the potential at `t`, at the points from `first` on, a multiple of eight.
    pub(crate) fn add(
        &self,
        registers: &mut PotentialRegisters,
        (factor, t): (f64, f64),
        first: usize,
        values: &mut [f64],
    ) {
        let found = self.of_time.eval(&mut registers.of_time, [&[t]]);
        for (g, found) in registers.g.iter_mut().zip(found) {
            *g = Lanes::splat(*found);
        }
        let points = self.points[first / WIDTH * self.axes..].chunks_exact(self.axes);
        for (values, u) in values.chunks_mut(WIDTH).zip(points) {
            let Lanes(found) = self.tape.eval(&mut registers.points, [&registers.g, u])[0];
            for (value, found) in values.iter_mut().zip(found) {
                *value += factor * found;
            }
        }
    }
}

/// Values on axes of so many points, eight points side by side; the last block repeats its last point.
fn in_lanes(size: usize, axes: usize, value: impl Fn(usize, usize) -> f64) -> Arc<[Lanes]> {
    let at = |first: usize, axis: usize| {
        Lanes(std::array::from_fn(|lane| {
            value((first + lane).min(size - 1), axis)
        }))
    };
    let firsts = (0..size).step_by(WIDTH);
    firsts
        .flat_map(|first| (0..axes).map(move |axis| (first, axis)))
        .map(|(first, axis)| at(first, axis))
        .collect()
}
