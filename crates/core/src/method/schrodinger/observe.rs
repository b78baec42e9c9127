//! What is recorded of a wave function at an output point.

use super::{Wave, squares};
use crate::problem::Observe;
use crate::problem::quantum::{Hamiltonian, Weighted};
use crate::real::Scalar;
use crate::trouble::{Quantity, Trouble};
use crate::vector::Machine;
use std::sync::Arc;

/// A quantity of a wave function.
#[derive(Clone)]
pub enum Observable {
    /// ⟨ψ|A|ψ⟩ of a diagonal A.
    Diagonal(Vec<f64>),
    /// ⟨ψ|A|ψ⟩ of a real symmetric A.
    Symmetric(Arc<Hamiltonian>),
    /// ⟨φ|ψ⟩ of a state φ = q + i p, two numbers.
    Overlap(Vec<f64>, Vec<f64>),
}

impl Observable {
    fn width(&self) -> usize {
        match self {
            Self::Overlap(..) => 2,
            _ => 1,
        }
    }
}

/// Records ψ (where states are wanted), its real and imaginary parts in turn, then its norm, then
/// observables, one member after another.
#[derive(Clone)]
pub struct Observer {
    members: usize,
    states: bool,
    observables: Vec<Observable>,
    machine: Machine,
    q: Vec<f64>,
    p: Vec<f64>,
    product: Vec<f64>,
    scratch: [Vec<f64>; 2],
}

impl Observer {
    /// An observer of the first `members` wave functions of a state.
    pub fn new(members: usize, states: bool, observables: Vec<Observable>) -> Self {
        Self {
            members,
            states,
            observables,
            machine: Machine::default(),
            q: Vec::new(),
            p: Vec::new(),
            product: Vec::new(),
            scratch: [Vec::new(), Vec::new()],
        }
    }

    /// How many numbers a wave function of n places has in a row.
    pub fn columns(&self, n: usize) -> usize {
        let states = if self.states { 2 * n } else { 0 };
        let observed: usize = self.observables.iter().map(Observable::width).sum();
        states + 1 + observed
    }

    fn append(&mut self, phase: f64, row: &mut Vec<f64>) -> Result<(), Trouble> {
        let (sin, cos) = phase.sin_cos();
        let turned = |q: f64, p: f64| (q * cos + p * sin, p * cos - q * sin);
        if self.states {
            for (q, p) in self.q.iter().zip(&self.p) {
                let (q, p) = turned(*q, *p);
                row.extend([q, p]);
            }
        }
        let norm = squares(&self.q, &self.p);
        row.push(norm.sqrt());
        for k in 0..self.observables.len() {
            match &self.observables[k] {
                Observable::Diagonal(values) => row.push(form(values, &self.q, &self.p)),
                Observable::Symmetric(_) => {
                    let value = self.expectation(k)?;
                    row.push(value);
                }
                Observable::Overlap(q, p) => {
                    let real = dot(q, &self.q) + dot(p, &self.p);
                    let imaginary = dot(q, &self.p) - dot(p, &self.q);
                    let (real, imaginary) = turned(real, imaginary);
                    row.extend([real, imaginary]);
                }
            }
        }
        Ok(())
    }

    fn expectation(&mut self, k: usize) -> Result<f64, Trouble> {
        let Observable::Symmetric(hamiltonian) = &self.observables[k] else {
            return Ok(0.0);
        };
        let sum: Weighted<'_> = hamiltonian.sum();
        self.product.resize(self.q.len(), 0.0);
        let mut total = 0.0;
        for x in [&self.q, &self.p] {
            sum.multiply(self.machine, x, &mut self.product, &mut self.scratch)?;
            total += dot(x, &self.product);
        }
        Ok(total)
    }
}

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

impl<S: Scalar> Observe<Wave<S>> for Observer {
    fn width(&self, state: &Wave<S>) -> usize {
        self.members * self.columns(state.q.len())
    }

    fn observe(&mut self, t: f64, state: &Wave<S>, row: &mut Vec<f64>) -> Result<(), Trouble> {
        let start = row.len();
        for member in 0..self.members {
            let parts = [(&mut self.q, &state.q), (&mut self.p, &state.p)];
            for (mine, theirs) in parts {
                mine.clear();
                mine.extend(theirs.iter().map(|x| x.member(member)));
            }
            let from = row.len();
            let appended = self.append(state.phase, row).and_then(|()| {
                match row[from..].iter().position(|value| !value.is_finite()) {
                    None => Ok(()),
                    Some(index) => {
                        let quantity = Quantity::Observable;
                        Err(Trouble::NotFinite { quantity, index, t })
                    }
                }
            });
            appended.map_err(|trouble| {
                row.truncate(start);
                trouble.of_member(member)
            })?;
        }
        Ok(())
    }
}
