//! Records of a wave function at an output point.

use super::{Wave, squares};
use crate::problem::{Hamiltonian, HamiltonianAt, ProductScratch, RowBlock, Update, WeightedTerms};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::real::Scalar;
use liouville_base::run::{refill, reserve, resize};
use liouville_base::simd::InstructionSet;
use std::any::Any;
use std::borrow::Cow;
use std::sync::Arc;

/// Rows of a product that are made at once.
const ROWS: usize = 1 << 12;

/// A quantity of a wave function.
#[derive(Clone)]
pub enum Observable {
    /// ⟨ψ|A|ψ⟩ of a diagonal A.
    Diagonal(Vec<f64>),
    /// ⟨ψ|A|ψ⟩ of a real symmetric A, at the time of the record if it depends on time; twice as large as
    /// ψ where it acts on real and imaginary parts one after the other. The energy of a density comes on top.
    Symmetric(Arc<Hamiltonian>),
    /// ⟨φ|ψ⟩ of a state φ = q + i p, two numbers.
    Overlap(Vec<f64>, Vec<f64>),
    /// ⟨ψ(0)|ψ⟩, the overlap with the first state observed.
    Start,
}

impl Observable {
    fn width(&self) -> usize {
        match self {
            Self::Overlap(..) | Self::Start => 2,
            Self::Diagonal(_) | Self::Symmetric(_) => 1,
        }
    }

    /// H at a time.
    fn current(&self, t: f64) -> Result<Option<HamiltonianAt>, StepError> {
        let Self::Symmetric(hamiltonian) = self else {
            return Ok(None);
        };
        let mut current = hamiltonian.current();
        if let Some(current) = &mut current {
            current.set(hamiltonian, &[(1.0, t)])?;
        }
        Ok(current)
    }
}

/// Records ψ (where states are wanted), its real and imaginary parts in turn, then its norm, then
/// observables, one member after another.
#[derive(Clone)]
pub struct Observer {
    members: usize,
    states: bool,
    observables: Vec<Observable>,
    /// The first state of each member, if it is needed, and its phase to be removed.
    starts: Vec<([Vec<f64>; 2], f64)>,
    machine: InstructionSet,
    product: Vec<f64>,
    scratch: ProductScratch,
}

impl Observer {
    /// An observer of the first `members` wave functions of a state.
    pub fn new(members: usize, states: bool, observables: Vec<Observable>) -> Self {
        Self {
            members,
            states,
            observables,
            starts: Vec::new(),
            machine: InstructionSet::default(),
            product: Vec::new(),
            scratch: ProductScratch::default(),
        }
    }

    /// The numbers that a wave function of n places has in a row.
    pub fn columns(&self, n: usize) -> usize {
        let states = if self.states { 2 * n } else { 0 };
        let observed: usize = self.observables.iter().map(Observable::width).sum();
        states + 1 + observed
    }

    fn append(
        &mut self,
        member: usize,
        t: f64,
        ([q, p], phase): ([&[f64]; 2], f64),
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        if self.states {
            let turn = turning(phase);
            reserve(row, 2 * q.len())?;
            row.extend(q.iter().zip(p).flat_map(|(q, p)| turn([*q, *p])));
        }
        row.push(squares(q, p).sqrt());
        for k in 0..self.observables.len() {
            match &self.observables[k] {
                Observable::Diagonal(values) => row.push(form(values, q, p)),
                Observable::Symmetric(_) => row.push(self.expectation(k, t, [q, p])?),
                Observable::Overlap(a, b) => {
                    row.extend(turning(phase)(overlap([a, b], [q, p])));
                }
                Observable::Start => {
                    let ([a, b], before) = &self.starts[member];
                    row.extend(turning(phase - before)(overlap([a, b], [q, p])));
                }
            }
        }
        Ok(())
    }

    fn expectation(&mut self, k: usize, t: f64, [q, p]: [&[f64]; 2]) -> Result<f64, StepError> {
        let current = self.observables[k].current(t)?;
        let Observable::Symmetric(hamiltonian) = &self.observables[k] else {
            return Ok(0.0);
        };
        let sum = hamiltonian.at(current.as_ref());
        let is_by_rows = hamiltonian.reach().is_some();
        let mut of = |x: &[f64]| {
            if is_by_rows {
                return Ok(by_rows(sum, self.machine, x, &mut self.product));
            }
            if self.product.len() != x.len() {
                resize(&mut self.product, x.len(), 0.0)?;
            }
            let (product, scratch) = (&mut self.product, &mut self.scratch);
            let kinetic = sum.without_kinetic(self.machine, x, product, scratch)?;
            Ok(kinetic + dot(x, product))
        };
        if hamiltonian.size() > q.len() {
            return of(&[q, p].concat());
        }
        let linear = of(q)? + of(p)?;
        let nonlinearity = hamiltonian.nonlinearity();
        Ok(nonlinearity.map_or(linear, |each| linear + each.energy(t, q, p)))
    }
}

/// ⟨x|A|x⟩ of a matrix by rows, of which some are made at a time.
fn by_rows(
    sum: WeightedTerms<'_>,
    machine: InstructionSet,
    x: &[f64],
    product: &mut Vec<f64>,
) -> f64 {
    product.resize(ROWS, 0.0);
    let of_rows = |(k, own): (usize, &[f64])| {
        let out = &mut product[..own.len()];
        out.fill(0.0);
        let (row, place) = (k * ROWS, 0);
        let block = RowBlock { row, out, place, x };
        sum.act(machine, Update::added(1.0), block);
        dot(own, &product[..own.len()])
    };
    x.chunks(ROWS).enumerate().map(of_rows).sum()
}

/// A complex number times e^{−i phase}.
fn turning(phase: f64) -> impl Fn([f64; 2]) -> [f64; 2] {
    let (sin, cos) = phase.sin_cos();
    move |[q, p]| [q * cos + p * sin, p * cos - q * sin]
}

/// Σ x y, block by block so that rounding errors stay small.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    const BLOCK: usize = 256;
    let blocks = x.chunks(BLOCK).zip(y.chunks(BLOCK));
    blocks
        .map(|(x, y)| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>())
        .sum()
}

fn form(a: &[f64], q: &[f64], p: &[f64]) -> f64 {
    let terms = a.iter().zip(q).zip(p);
    terms.map(|((a, q), p)| a * (q * q + p * p)).sum()
}

/// ⟨a + i b | q + i p⟩
pub(super) fn overlap([a, b]: [&[f64]; 2], [q, p]: [&[f64]; 2]) -> [f64; 2] {
    [dot(a, q) + dot(b, p), dot(a, p) - dot(b, q)]
}

/// A part of a member, which is the array itself where there is no other member.
#[expect(clippy::ptr_arg)] // the type of an array itself is looked at
fn part<S: Scalar>(x: &Vec<S>, member: usize) -> Cow<'_, [f64]> {
    match (x as &dyn Any).downcast_ref::<Vec<f64>>() {
        Some(x) => Cow::Borrowed(x),
        None => x.iter().map(|x| x.member(member)).collect(),
    }
}

impl<S: Scalar> Observe<Wave<S>> for Observer {
    fn width(&self, state: &Wave<S>) -> usize {
        self.members * self.columns(state.q.len())
    }

    fn observe(&mut self, t: f64, state: &Wave<S>, row: &mut Vec<f64>) -> Result<(), StepError> {
        let start = row.len();
        let is_wanted = |observable: &Observable| matches!(observable, Observable::Start);
        let keeps_starts = self.starts.is_empty() && self.observables.iter().any(is_wanted);
        for member in 0..self.members {
            let from = row.len();
            let (q, p) = (part(&state.q, member), part(&state.p, member));
            if keeps_starts {
                let mut parts = [Vec::new(), Vec::new()];
                for (kept, part) in parts.iter_mut().zip([&q, &p]) {
                    refill(kept, &[part])?;
                }
                self.starts.push((parts, state.phase));
            }
            let appended = self.append(member, t, ([&q, &p], state.phase), row);
            let appended = appended.and_then(|()| {
                match row[from..].iter().position(|value| !value.is_finite()) {
                    None => Ok(()),
                    Some(index) => {
                        let quantity = Quantity::Observable;
                        Err(StepError::NotFinite { quantity, index, t })
                    }
                }
            });
            appended.map_err(|error| {
                row.truncate(start);
                error.of_member(member)
            })?;
        }
        Ok(())
    }
}

/// The first states are not saved: a run that observes them starts with them.
impl Checkpoint for Observer {}
