//! What is recorded of a wave function at an output point.

use super::{Wave, squares};
use crate::problem::{Hamiltonian, HamiltonianAt, Scratch};
use liouville_base::checkpoint::Checkpoint;
use liouville_base::error::{Quantity, StepError};
use liouville_base::observe::Observe;
use liouville_base::real::Scalar;
use liouville_base::simd::InstructionSet;
use std::sync::Arc;

/// A quantity of a wave function.
#[derive(Clone)]
pub enum Observable {
    /// ⟨ψ|A|ψ⟩ of a diagonal A.
    Diagonal(Vec<f64>),
    /// ⟨ψ|A|ψ⟩ of a real symmetric A, at the time of the record if it depends on time; twice as large as
    /// ψ where it acts on real and imaginary parts one after the other.
    Symmetric(Arc<Hamiltonian>),
    /// ⟨φ|ψ⟩ of a state φ = q + i p, two numbers.
    Overlap(Vec<f64>, Vec<f64>),
    /// ⟨ψ(0)|ψ⟩, the overlap with what is observed first.
    Start,
}

impl Observable {
    fn width(&self) -> usize {
        match self {
            Self::Overlap(..) | Self::Start => 2,
            Self::Diagonal(_) | Self::Symmetric(_) => 1,
        }
    }

    /// H as it is at a time.
    fn present(&self, t: f64) -> Option<HamiltonianAt> {
        let Self::Symmetric(hamiltonian) = self else {
            return None;
        };
        let mut present = hamiltonian.present()?;
        present.set(hamiltonian, &[(1.0, t)]);
        Some(present)
    }
}

/// Records ψ (where states are wanted), its real and imaginary parts in turn, then its norm, then
/// observables, one member after another.
#[derive(Clone)]
pub struct Observer {
    members: usize,
    states: bool,
    observables: Vec<Observable>,
    /// What each member was first, if that is to be known.
    starts: Vec<[Vec<f64>; 2]>,
    machine: InstructionSet,
    product: Vec<f64>,
    scratch: Scratch,
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
            scratch: Scratch::default(),
        }
    }

    /// How many numbers a wave function of n places has in a row.
    pub fn columns(&self, n: usize) -> usize {
        let states = if self.states { 2 * n } else { 0 };
        let observed: usize = self.observables.iter().map(Observable::width).sum();
        states + 1 + observed
    }

    fn append(
        &mut self,
        member: usize,
        t: f64,
        parts @ [q, p]: &[Vec<f64>; 2],
        row: &mut Vec<f64>,
    ) -> Result<(), StepError> {
        if self.states {
            row.extend(q.iter().zip(p).flat_map(|(q, p)| [*q, *p]));
        }
        row.push(squares(q, p).sqrt());
        for k in 0..self.observables.len() {
            match &self.observables[k] {
                Observable::Diagonal(values) => row.push(form(values, q, p)),
                Observable::Symmetric(_) => row.push(self.expectation(k, t, parts)?),
                Observable::Overlap(a, b) => row.extend(overlap([a, b], [q, p])),
                Observable::Start => {
                    let [a, b] = &self.starts[member];
                    row.extend(overlap([a, b], [q, p]));
                }
            }
        }
        Ok(())
    }

    fn expectation(&mut self, k: usize, t: f64, [q, p]: &[Vec<f64>; 2]) -> Result<f64, StepError> {
        let present = self.observables[k].present(t);
        let Observable::Symmetric(hamiltonian) = &self.observables[k] else {
            return Ok(0.0);
        };
        let sum = hamiltonian.at(present.as_ref());
        let mut of = |x: &[f64]| {
            self.product.resize(x.len(), 0.0);
            sum.multiply(self.machine, x, &mut self.product, &mut self.scratch)?;
            Ok(dot(x, &self.product))
        };
        if hamiltonian.size() > q.len() {
            return of(&[q.as_slice(), p].concat());
        }
        Ok(of(q)? + of(p)?)
    }
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
fn overlap([a, b]: [&[f64]; 2], [q, p]: [&[f64]; 2]) -> [f64; 2] {
    [dot(a, q) + dot(b, p), dot(a, p) - dot(b, q)]
}

/// Real and imaginary part of a member, with the phase taken off.
fn parts<S: Scalar>(state: &Wave<S>, member: usize) -> [Vec<f64>; 2] {
    let (sin, cos) = state.phase.sin_cos();
    let pairs = state.q.iter().zip(&state.p);
    let turned = pairs.map(|(q, p)| {
        let (q, p) = (q.member(member), p.member(member));
        (q * cos + p * sin, p * cos - q * sin)
    });
    let (q, p) = turned.unzip();
    [q, p]
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
            let parts = parts(state, member);
            if keeps_starts {
                self.starts.push(parts.clone());
            }
            let appended = self.append(member, t, &parts, row).and_then(|()| {
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

/// What each member was first is with whoever observes a start.
impl Checkpoint for Observer {}
