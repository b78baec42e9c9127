//! A potential W(t, ρ) that depends on the density ρ = |ψ|² at its point.

use liouville_base::real::{Lanes, Scalar, WIDTH};
use liouville_base::tape::{Registers, Tape};
use liouville_fourier::Complex;
use std::sync::Arc;

/// The functions W and E, with E' = W and E(0) = 0, of the time, the density and parameters.
#[derive(Clone, Debug)]
pub struct Nonlinearity {
    potential: Arc<Tape>,
    energy: Arc<Tape>,
    params: Vec<f64>,
    /// The volume of a point: the density there is |ψ|² over it.
    cell: f64,
}

impl Nonlinearity {
    /// Tapes of W and of E, on a grid whose points stand for a volume of `cell`; none where sizes do not fit.
    pub fn new(potential: Arc<Tape>, energy: Arc<Tape>, params: &[f64], cell: f64) -> Option<Self> {
        let fits = |tape: &Tape| tape.inputs() == [1, 1, params.len()] && tape.outputs() == 1;
        (fits(&potential) && fits(&energy) && cell > 0.0).then(|| Self {
            params: params.to_vec(),
            potential,
            energy,
            cell,
        })
    }

    /// Memory of evaluations of W.
    pub(crate) fn bind(&self) -> Registers<Lanes> {
        self.registers(&self.potential)
    }

    fn registers(&self, tape: &Tape) -> Registers<Lanes> {
        let params: Vec<Lanes> = self.params.iter().map(|p| Lanes::splat(*p)).collect();
        tape.bind(&params)
    }

    /// Adds W at `t` for each of these numbers.
    pub(crate) fn add(
        &self,
        registers: &mut Registers<Lanes>,
        t: f64,
        psi: &[Complex],
        values: &mut [f64],
    ) {
        let t = [Lanes::splat(t)];
        for (values, psi) in values.chunks_mut(WIDTH).zip(psi.chunks(WIDTH)) {
            let density = |lane: usize| psi[lane.min(psi.len() - 1)].norm_sqr() / self.cell;
            let rho = [Lanes(std::array::from_fn(density))];
            let Lanes(found) = self.potential.eval(registers, [&t, &rho])[0];
            for (value, found) in values.iter_mut().zip(found) {
                *value += found;
            }
        }
    }

    /// Adds W at `t` for each of these densities to `out`.
    pub(crate) fn values(
        &self,
        registers: &mut Registers<Lanes>,
        t: f64,
        densities: &[f64],
        out: &mut Vec<f64>,
    ) {
        let t = [Lanes::splat(t)];
        out.extend(densities.iter().map(|rho| {
            let Lanes(found) = self.potential.eval(registers, [&t, &[Lanes::splat(*rho)]])[0];
            found[0]
        }));
    }

    /// ∫ E(t, ρ) dx
    pub(crate) fn energy(&self, t: f64, q: &[f64], p: &[f64]) -> f64 {
        let (mut registers, t) = (self.registers(&self.energy), [Lanes::splat(t)]);
        let blocks = q.chunks(WIDTH).zip(p.chunks(WIDTH));
        let of_block = |(q, p): (&[f64], &[f64])| {
            let density = |lane: usize| {
                let (q, p) = q.get(lane).zip(p.get(lane)).unwrap_or((&0.0, &0.0));
                (q * q + p * p) / self.cell
            };
            let rho = [Lanes(std::array::from_fn(density))];
            let Lanes(found) = self.energy.eval(&mut registers, [&t, &rho])[0];
            found[..q.len()].iter().sum::<f64>()
        };
        self.cell * blocks.map(of_block).sum::<f64>()
    }
}
