//! Kinetic energy on a periodic grid: products by fast Fourier transforms.
//!
//!     T = F⁻¹ Σ_a e_a(k_a) F,    e_a(k) = ħ k² / 2μ_a for a particle of mass μ_a
//!
//! Energies are in the order of the transform (k = 0, 1 .. −1), and even: a real array then has a real product, by half
//! the work of a complex one.

use super::Update;
use liouville_base::cancel;
use liouville_base::error::StepError;
use liouville_base::simd::Stored;
use liouville_fourier::{Complex, FourierScratch, Grid, RealGrid, padded};

/// Tolerance of differences between the energies of k and −k, relative to the largest.
const EVEN: f64 = 1e-12;

/// Whether each wave number of an axis of n points is at most a part of the largest, up to roundings.
fn is_within(n: usize, part: f64) -> impl Iterator<Item = bool> {
    let most = (1.0 + EVEN) * part * n as f64;
    (0..n).map(move |j| 2.0 * j.min(n - j) as f64 <= most)
}

/// Points of which a product polls for cancellation.
const LARGE: usize = 1 << 18;

/// Energies along each axis of a grid, and its transforms.
#[derive(Clone)]
pub struct Kinetic {
    shape: [usize; 3],
    energies: [Vec<f64>; 3],
    real: RealGrid,
    grid: Grid,
    /// Energies over the number of points: along the outermost axis, and in a plane of the half spectrum.
    along: Vec<f64>,
    within: Vec<f64>,
}

impl Kinetic {
    /// Kinetic energy with these energies along each of one to three axes, the last one fastest; none where
    /// an axis has no points or energies of k and −k differ.
    pub fn new(energies: &[Vec<f64>]) -> Option<Self> {
        let is_fine = |energies: &Vec<f64>| {
            let n = energies.len();
            let largest = energies.iter().fold(0.0_f64, |max, e| max.max(e.abs()));
            let even = |k: usize| (energies[k] - energies[n - k]).abs() <= EVEN * largest;
            n > 0 && (1..n).all(even) && energies.iter().all(|e| e.is_finite())
        };
        if !(1..=3).contains(&energies.len()) || !energies.iter().all(is_fine) {
            return None;
        }
        let lengths: Vec<usize> = energies.iter().map(Vec::len).collect();
        let shape = padded(&lengths);
        let axis = |length: &[f64]| length.to_vec();
        let last = energies.len() - 1;
        let energies = [
            energies[..last].first().map_or(vec![0.0], |e| axis(e)),
            energies[..last].get(1).map_or(vec![0.0], |e| axis(e)),
            axis(&energies[last]),
        ];
        let scale = 1.0 / shape.iter().product::<usize>() as f64;
        let half = &energies[2][..=shape[2] / 2];
        let middle = energies[1].iter();
        let within = middle.flat_map(|e1| half.iter().map(move |e2| (e1 + e2) * scale));
        Some(Self {
            shape,
            along: energies[0].iter().map(|e| e * scale).collect(),
            within: within.collect(),
            real: RealGrid::new(shape),
            grid: Grid::new(shape),
            energies,
        })
    }

    /// Number of points.
    pub fn size(&self) -> usize {
        self.shape.iter().product()
    }

    /// Least and largest energy.
    pub fn bounds(&self) -> (f64, f64) {
        let fold = |start: f64, pick: fn(f64, f64) -> f64| -> f64 {
            let along = |e: &Vec<f64>| e.iter().copied().fold(start, pick);
            self.energies.iter().map(along).sum()
        };
        (
            fold(f64::INFINITY, f64::min),
            fold(f64::NEG_INFINITY, f64::max),
        )
    }

    /// Transforms of complex arrays.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Factors of e^{−iTs}, normalised: along the outermost axis, and in a plane. Those of wave numbers beyond a part of the
    /// largest along each axis are zero.
    pub fn phases(&self, s: f64, band: f64) -> (Vec<Complex>, Vec<Complex>) {
        let [first, middle, last]: [Vec<Complex>; 3] = self.energies.each_ref().map(|energies| {
            let phases = energies.iter().map(|e| Complex::from_polar(1.0, -e * s));
            let kept = is_within(energies.len(), band).zip(phases);
            kept.map(|(is_kept, phase)| if is_kept { phase } else { Complex::default() })
                .collect()
        });
        self.in_planes(&first, &middle, &last)
    }

    /// Factors that leave wave numbers up to a part of the largest along each axis, normalised: along the outermost axis, and
    /// in a plane.
    pub fn low_pass(&self, part: f64) -> (Vec<Complex>, Vec<Complex>) {
        let [first, middle, last]: [Vec<Complex>; 3] = self.shape.map(|n| {
            let kept = is_within(n, part).map(|is_kept| Complex::from(f64::from(is_kept)));
            kept.collect()
        });
        self.in_planes(&first, &middle, &last)
    }

    /// Products of factors along each axis, normalised: along the outermost axis, and in a plane.
    fn in_planes(
        &self,
        first: &[Complex],
        middle: &[Complex],
        last: &[Complex],
    ) -> (Vec<Complex>, Vec<Complex>) {
        let scale = 1.0 / self.size() as f64;
        let within = middle.iter().flat_map(|a| last.iter().map(move |b| a * b));
        (first.iter().map(|x| x * scale).collect(), within.collect())
    }

    /// ⟨x|T|x⟩, by the squares of the transform.
    ///
    /// # Errors
    /// It was interrupted.
    pub(super) fn expectation(
        &self,
        x: &[f64],
        memory: &mut FourierScratch,
    ) -> Result<f64, StepError> {
        let go_on = || x.len() < LARGE || !cancel::is_cancelled();
        let (length, lines) = (self.shape[2], self.shape[0] * self.shape[1]);
        let read = |k: usize, line: &mut [f64]| line.copy_from_slice(&x[k * length..][..length]);
        let factor = |k: usize, place: usize| self.along[k] + self.within[place];
        let found = (self.real).squares(memory, lines, read, factor, go_on);
        found.ok_or(StepError::Interrupted)
    }

    /// Updates all rows.
    ///
    /// # Errors
    /// It was interrupted; `out` may be anything then.
    pub(super) fn update<S: Stored>(
        &self,
        update: Update,
        x: &[S],
        out: &mut [S],
        memory: &mut FourierScratch,
    ) -> Result<(), StepError> {
        // a product of fewer points does not take long
        let go_on = || x.len() < LARGE || !cancel::is_cancelled();
        let (length, lines) = (self.shape[2], self.shape[0] * self.shape[1]);
        for member in 0..S::MEMBERS {
            let read = |k: usize, line: &mut [f64]| {
                for (line, x) in line.iter_mut().zip(&x[k * length..]) {
                    *line = x.member(member);
                }
            };
            let write = |k: usize, line: &[f64]| {
                let x = &x[k * length..];
                let out = out[k * length..].iter_mut();
                for ((out, x), product) in out.zip(x).zip(line) {
                    let change = update.factor * product + update.diagonal * x.member(member);
                    out.set_member(member, update.keep * out.member(member) + change);
                }
            };
            let factor = |k: usize, place: usize| self.along[k] + self.within[place];
            if !(self.real).multiply(memory, lines, read, factor, write, go_on) {
                return Err(StepError::Interrupted);
            }
        }
        Ok(())
    }
}
