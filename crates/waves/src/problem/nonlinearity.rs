//! A potential W(t, ρ) that depends on the density ρ = |ψ|² at its point, or on those of several components.

use liouville_base::real::{Lanes, Scalar, WIDTH};
use liouville_base::tape::{Registers, Tape};
use liouville_fourier::Complex;
use std::sync::Arc;

/// The functions W and E, with E' = W and E(0) = 0, of the time, the density of each component and parameters.
#[derive(Clone, Debug)]
pub struct Nonlinearity {
    potential: Arc<Tape>,
    energy: Arc<Tape>,
    params: Vec<f64>,
    /// The volume of a point: the density there is |ψ|² over it.
    cell: f64,
}

/// Memory of evaluations, and of the densities at points side by side.
#[derive(Clone)]
pub(crate) struct DensityRegisters {
    tape: Registers<Lanes>,
    rho: Vec<Lanes>,
}

impl Nonlinearity {
    /// Tapes of W, a value for each component, and of E, on a grid whose points stand for a volume of `cell`; none where sizes
    /// do not fit.
    pub fn new(potential: Arc<Tape>, energy: Arc<Tape>, params: &[f64], cell: f64) -> Option<Self> {
        let count = potential.outputs();
        let fits = |tape: &Tape| tape.inputs() == [1, count, params.len()];
        let is_fine = fits(&potential) && fits(&energy) && energy.outputs() == 1;
        (is_fine && count > 0 && cell > 0.0).then(|| Self {
            params: params.to_vec(),
            potential,
            energy,
            cell,
        })
    }

    /// Number of components.
    pub fn components(&self) -> usize {
        self.potential.outputs()
    }

    /// Memory of evaluations of W.
    pub(crate) fn bind(&self) -> DensityRegisters {
        self.registers(&self.potential)
    }

    fn registers(&self, tape: &Tape) -> DensityRegisters {
        let params: Vec<Lanes> = self.params.iter().map(|p| Lanes::splat(*p)).collect();
        DensityRegisters {
            tape: tape.bind(&params),
            rho: vec![Lanes::splat(0.0); self.components()],
        }
    }

    /// Adds W at `t` to values at points from `first` on, those of one component after those of another.
    pub(crate) fn add(
        &self,
        memory: &mut DensityRegisters,
        t: f64,
        (psi, first): (&[Complex], usize),
        values: &mut [f64],
    ) {
        let DensityRegisters { tape, rho } = memory;
        let (count, t) = (self.components(), [Lanes::splat(t)]);
        let (points, plane) = (psi.len() / count, values.len() / count);
        for start in (0..plane).step_by(WIDTH) {
            let width = WIDTH.min(plane - start);
            for (k, rho) in rho.iter_mut().enumerate() {
                let psi = &psi[k * points + first + start..][..width];
                let density = |lane: usize| psi[lane.min(width - 1)].norm_sqr() / self.cell;
                *rho = Lanes(std::array::from_fn(density));
            }
            let found = self.potential.eval(tape, [&t, rho]);
            for (values, Lanes(found)) in values.chunks_exact_mut(plane).zip(found) {
                for (value, found) in values[start..][..width].iter_mut().zip(found) {
                    *value += found;
                }
            }
        }
    }

    /// Adds W at `t` for each of these densities, one of each component, to `out`.
    pub(crate) fn values(
        &self,
        memory: &mut DensityRegisters,
        t: f64,
        densities: &[f64],
        out: &mut Vec<f64>,
    ) {
        let t = [Lanes::splat(t)];
        for densities in densities.chunks_exact(self.components()) {
            for (rho, density) in memory.rho.iter_mut().zip(densities) {
                *rho = Lanes::splat(*density);
            }
            let found = self.potential.eval(&mut memory.tape, [&t, &memory.rho]);
            out.extend(found.iter().map(|Lanes(found)| found[0]));
        }
    }

    /// ∫ E(t, ρ) dx
    pub(crate) fn energy(&self, t: f64, q: &[f64], p: &[f64]) -> f64 {
        let DensityRegisters { mut tape, mut rho } = self.registers(&self.energy);
        let (points, t) = (q.len() / self.components(), [Lanes::splat(t)]);
        let of_block = |start: usize| {
            for (k, rho) in rho.iter_mut().enumerate() {
                let density = |lane: usize| {
                    let place = k * points + start + lane;
                    let is_there = start + lane < points;
                    let (q, p) = if is_there {
                        (q[place], p[place])
                    } else {
                        (0.0, 0.0)
                    };
                    (q * q + p * p) / self.cell
                };
                *rho = Lanes(std::array::from_fn(density));
            }
            let Lanes(found) = self.energy.eval(&mut tape, [&t, &rho])[0];
            found[..WIDTH.min(points - start)].iter().sum::<f64>()
        };
        self.cell * (0..points).step_by(WIDTH).map(of_block).sum::<f64>()
    }
}
