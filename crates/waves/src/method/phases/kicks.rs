//! Flows of the potential: ψ ← e^{−isV} ψ, plane by plane.
//!
//! A potential W(t, ρ) of the density ρ = |ψ|² turns phases alone, so that ρ stays as it is and the flow is exact. So it is
//! where each component has a potential of the densities of all.

use super::Looks;
use crate::method::term_bounds::{TermBounds, range};
use crate::problem::{
    DensityRegisters, Hamiltonian, HamiltonianAt, Nonlinearity, Operator, RowBlock, Update,
};
use liouville_base::elementary;
use liouville_base::error::StepError;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use liouville_fourier::Complex;
use std::sync::Arc;

/// Tables kept: a step of any list has fewer distinct flows.
pub(super) const KEPT: usize = 64;

/// Points that tables of V may have in all: half a gigabyte.
const POINTS: usize = 1 << 25;

/// The potential of a Hamiltonian.
#[derive(Clone)]
pub(super) struct Kicks {
    hamiltonian: Arc<Hamiltonian>,
    /// The terms that are diagonal, each with its place among all.
    diagonals: Vec<(usize, Vec<f64>)>,
    current: Option<HamiltonianAt>,
    potential: Vec<f64>,
    /// Points of a component, and of a plane.
    points: (usize, usize),
    /// Memory of W, and V + W of each component on a plane.
    of_density: Option<(DensityRegisters, Vec<f64>)>,
    tables: Vec<PotentialPhases>,
    cos_sin: [Vec<f64>; 2],
    machine: InstructionSet,
}

/// cos and sin of V s for a length of time, where V does not depend on it.
#[derive(Clone)]
struct PotentialPhases {
    s: f64,
    cos_sin: [Vec<f64>; 2],
}

/// A flow about to be made, of all planes: its time and length, and the place of its table.
#[derive(Clone, Copy)]
pub(super) struct Kick {
    t: f64,
    s: f64,
    table: Option<usize>,
}

impl Kicks {
    /// Flows of the terms of a Hamiltonian other than these, on components and planes of so many points; none where one is
    /// not diagonal.
    pub(super) fn new(
        hamiltonian: Arc<Hamiltonian>,
        left_out: &[usize],
        points: (usize, usize),
    ) -> Option<Self> {
        let machine = InstructionSet::default();
        let others = hamiltonian.terms().iter().enumerate();
        let others = others.filter(|(k, _)| !left_out.contains(k));
        let diagonals: Vec<(usize, Vec<f64>)> = others
            .map(|(k, term)| Some((k, diagonal(machine, term)?)))
            .collect::<Option<_>>()?;
        let mut potential = vec![0.0; hamiltonian.size()];
        sum(&diagonals, |_| 1.0, &mut potential);
        let nonlinearity = hamiltonian.nonlinearity();
        if nonlinearity.is_some_and(|each| each.components() * points.0 != potential.len()) {
            return None;
        }
        let values = vec![0.0; potential.len() / points.0 * points.1];
        let of_density = nonlinearity.map(Nonlinearity::bind);
        Some(Self {
            current: hamiltonian.current(),
            of_density: of_density.map(|registers| (registers, values)),
            cos_sin: [0, 1].map(|_| vec![0.0; points.1]),
            points,
            hamiltonian,
            tables: Vec::new(),
            diagonals,
            potential,
            machine,
        })
    }

    /// Whether the potential depends on the density.
    pub(super) fn is_nonlinear(&self) -> bool {
        self.of_density.is_some()
    }

    /// Whether a part of the potential absorbs.
    pub(super) fn is_absorbing(&self) -> bool {
        !self.hamiltonian.absorber().is_empty()
    }

    /// The parts of H with bounds of those that are diagonal, for looks at functions of time over a run.
    pub(super) fn parts(&self, looks: Looks) -> TermBounds {
        let terms = self.hamiltonian.terms().len();
        let mut parts = vec![(0.0, 0.0); terms];
        for (k, diagonal) in &self.diagonals {
            parts[*k] = range(diagonal);
        }
        TermBounds {
            groups: vec![1; terms],
            parts,
            is_split: true,
            span: looks.span,
            knots: looks.knots,
            outputs: looks.outputs,
            densities: looks.densities,
            ..TermBounds::default()
        }
    }

    /// The Hamiltonian.
    pub(super) fn hamiltonian(&self) -> &Arc<Hamiltonian> {
        &self.hamiltonian
    }

    /// Prepares a flow of length s at `t`.
    pub(super) fn begin(&mut self, t: f64, s: f64) -> Result<Kick, StepError> {
        self.look(t)?;
        let table = self.table(s);
        Ok(Kick { t, s, table })
    }

    /// Whether the potential depends on time.
    pub(super) fn is_driven(&self) -> bool {
        self.current.is_some()
    }

    /// The potential at `t` without what depends on the density.
    pub(super) fn values(&mut self, t: f64, out: &mut Vec<f64>) -> Result<(), StepError> {
        self.look(t)?;
        out.clear();
        out.extend_from_slice(&self.potential);
        Ok(())
    }

    /// Sets the potential to that of a time.
    fn look(&mut self, t: f64) -> Result<(), StepError> {
        let Some(current) = &mut self.current else {
            return Ok(());
        };
        current.set(&self.hamiltonian, &[(1.0, t)])?;
        if current.potential().is_empty() {
            self.potential.fill(0.0);
        } else {
            self.potential.copy_from_slice(current.potential());
        }
        let weights = current.weights();
        sum(&self.diagonals, |k| weights[k], &mut self.potential);
        Ok(())
    }

    /// Makes room for the tables of flows of other lengths.
    pub(super) fn forget_tables(&mut self) {
        self.tables.clear();
    }

    /// The place of the table for a flow; none where V depends on time or the density, or the grid is too large.
    fn table(&mut self, s: f64) -> Option<usize> {
        if self.current.is_some() || self.is_nonlinear() {
            return None;
        }
        let is_this = |table: &PotentialPhases| table.s.to_bits() == s.to_bits();
        self.tables.iter().position(is_this).or_else(|| {
            if self.tables.len() >= KEPT.min(POINTS / self.potential.len()) {
                return None;
            }
            let mut cos_sin = [0, 1].map(|_| vec![0.0; self.potential.len()]);
            turn(self.machine, &self.potential, s, &mut cos_sin);
            damp(self.hamiltonian.absorber(), s, &mut cos_sin);
            self.tables.push(PotentialPhases { s, cos_sin });
            Some(self.tables.len() - 1)
        })
    }

    /// Makes a flow on the plane of all components that begins with this point.
    pub(super) fn act(&mut self, kick: Kick, first: usize, psi: &mut [Complex]) {
        let (points, plane) = self.points;
        let nonlinearity = self.hamiltonian.nonlinearity();
        if let (Some(nonlinearity), Some((memory, all))) = (nonlinearity, &mut self.of_density) {
            let potentials = self.potential.chunks_exact(points);
            for (all, potential) in all.chunks_exact_mut(plane).zip(potentials) {
                all.copy_from_slice(&potential[first..][..plane]);
            }
            nonlinearity.add(memory, kick.t, (psi, first), all);
        }
        for (k, psi) in psi.chunks_exact_mut(points).enumerate() {
            let (psi, start) = (&mut psi[first..][..plane], k * points + first);
            if let Some(table) = kick.table {
                let [cos, sin] = &self.tables[table].cos_sin;
                multiply(psi, &cos[start..][..plane], &sin[start..][..plane]);
                continue;
            }
            let values = match &self.of_density {
                Some((_, all)) => &all[k * plane..][..plane],
                None => &self.potential[start..][..plane],
            };
            turn(self.machine, values, kick.s, &mut self.cos_sin);
            let absorber = self.hamiltonian.absorber().get(start..start + plane);
            damp(absorber.unwrap_or(&[]), kick.s, &mut self.cos_sin);
            multiply(psi, &self.cos_sin[0], &self.cos_sin[1]);
        }
    }
}

/// The diagonal of a term that has nothing else.
fn diagonal(machine: InstructionSet, term: &Operator) -> Option<Vec<f64>> {
    if term.reach()? > 0 {
        return None;
    }
    let x = vec![1.0; term.size()];
    let mut out = vec![0.0; x.len()];
    let (row, place) = (0, 0);
    let block = RowBlock {
        row,
        out: &mut out,
        place,
        x: &x,
    };
    term.act(machine, Update::added(1.0), block);
    Some(out)
}

/// Adds weighted diagonals.
fn sum(diagonals: &[(usize, Vec<f64>)], weight: impl Fn(usize) -> f64, out: &mut [f64]) {
    for (k, diagonal) in diagonals {
        let weight = weight(*k);
        for (out, value) in out.iter_mut().zip(diagonal) {
            *out += weight * value;
        }
    }
}

/// Takes phases off: e^{−iφ} psi.
fn multiply(psi: &mut [Complex], cos: &[f64], sin: &[f64]) {
    for ((psi, cos), sin) in psi.iter_mut().zip(cos).zip(sin) {
        let Complex { re, im } = *psi;
        *psi = Complex::new(re * cos + im * sin, im * cos - re * sin);
    }
}

/// Multiplies by e^{−ws}, if there are any w.
fn damp(w: &[f64], s: f64, [cos, sin]: &mut [Vec<f64>; 2]) {
    for ((cos, sin), w) in cos.iter_mut().zip(sin).zip(w) {
        let factor = elementary::exp(-w * s);
        *cos *= factor;
        *sin *= factor;
    }
}

/// cos(v s) and sin(v s)
fn turn(machine: InstructionSet, v: &[f64], s: f64, [cos, sin]: &mut [Vec<f64>; 2]) {
    f64::run(machine, Turns { v, s, cos, sin });
}

struct Turns<'a> {
    v: &'a [f64],
    s: f64,
    cos: &'a mut [f64],
    sin: &'a mut [f64],
}

impl Kernel<f64> for Turns<'_> {
    type Output = ();

    #[allow(clippy::inline_always)] // compiled for one instruction set as a whole
    #[inline(always)]
    fn run<W: SimdViews<Stored = f64>>(mut self, views: W) {
        views.each(self.v.len(), &mut self);
    }
}

impl ForEach<f64> for Turns<'_> {
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn visit<W: SimdView<Stored = f64>>(&mut self, view: W) -> bool {
        let angle = view.load(self.v, 0).scaled(self.s);
        view.store(self.cos, 0, angle.cos());
        view.store(self.sin, 0, angle.sin());
        true
    }
}
