//! A Hamiltonian as a weighted sum of its terms.

use super::{Block, Operator, Update};
use crate::trouble::Trouble;
use crate::vector::{Machine, Stored};

/// The terms H_k, read-only.
#[derive(Clone)]
pub struct Hamiltonian {
    terms: Vec<Operator>,
}

impl Hamiltonian {
    /// A sum of terms of the same size.
    ///
    /// # Panics
    /// When there are none, or their sizes differ.
    pub fn new(terms: Vec<Operator>) -> Self {
        let n = terms[0].size();
        assert!(terms.iter().all(|term| term.size() == n), "size of a term");
        Self { terms }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.terms[0].size()
    }

    /// The terms.
    pub fn terms(&self) -> &[Operator] {
        &self.terms
    }

    /// How far from the diagonal there are entries; none if any term is a whole one.
    pub fn reach(&self) -> Option<usize> {
        let reaches = self.terms.iter().map(Operator::reach);
        reaches.collect::<Option<Vec<_>>>()?.into_iter().max()
    }

    /// All terms with weight 1.
    pub fn sum(&self) -> Weighted<'_> {
        Weighted {
            terms: &self.terms,
            weights: None,
        }
    }
}

/// H = Σ w_k H_k.
#[derive(Clone, Copy)]
pub struct Weighted<'a> {
    /// H_k
    pub terms: &'a [Operator],
    /// w_k, all 1 if there are none.
    pub weights: Option<&'a [f64]>,
}

impl Weighted<'_> {
    fn weight(&self, k: usize) -> f64 {
        self.weights.map_or(1.0, |weights| weights[k])
    }

    /// Updates some rows by all terms.
    ///
    /// # Panics
    /// When a term is a whole one.
    pub fn act<S: Stored>(&self, machine: Machine, update: Update, block: Block<'_, S>) {
        let Block { row, out, place, x } = block;
        for (k, term) in self.terms.iter().enumerate() {
            let factor = self.weight(k) * update.factor;
            let update = if k == 0 {
                Update { factor, ..update }
            } else {
                Update::added(factor)
            };
            let out = &mut *out;
            term.act(machine, update, Block { row, out, place, x });
        }
    }

    /// Makes `out` the product with `x`, with `scratch` for whole terms.
    ///
    /// # Errors
    /// A product failed.
    pub fn multiply<S: Stored>(
        &self,
        machine: Machine,
        x: &[S],
        out: &mut [S],
        scratch: &mut [Vec<f64>; 2],
    ) -> Result<(), Trouble> {
        out.fill(S::splat(0.0));
        for (k, term) in self.terms.iter().enumerate() {
            let factor = self.weight(k);
            match term {
                Operator::Product(product) => {
                    let [from, to] = scratch;
                    for member in 0..S::MEMBERS {
                        from.clear();
                        from.extend(x.iter().map(|x| x.member(member)));
                        to.resize(x.len(), 0.0);
                        if !product.multiply(from, to) {
                            return Err(Trouble::Interrupted);
                        }
                        for (out, to) in out.iter_mut().zip(&*to) {
                            out.set_member(member, out.member(member) + factor * to);
                        }
                    }
                }
                Operator::Rows(_)
                | Operator::Diagonals(_)
                | Operator::Dense(_)
                | Operator::Spins(_) => {
                    let out = &mut *out;
                    let (row, place) = (0, 0);
                    let block = Block { row, out, place, x };
                    term.act(machine, Update::added(factor), block);
                }
            }
        }
        Ok(())
    }
}
