//! A sum of terms with weights, and a potential: products with vectors, and expectations.

use super::{Operator, Product, RowBlock, Update};
use liouville_base::error::StepError;
use liouville_base::run::resize;
use liouville_base::simd::{InstructionSet, Stored};
use liouville_fourier::FourierScratch;

/// H = Σ w_k H_k + V.
#[derive(Clone, Copy)]
pub struct WeightedTerms<'a> {
    /// H_k
    pub terms: &'a [Operator],
    /// w_k, all 1 if there are none.
    pub weights: Option<&'a [f64]>,
    /// The diagonal V, empty if there is none.
    pub potential: &'a [f64],
    /// Pairs (a, t) of the sums Σ a H(t) of terms that depend on time by themselves.
    pub nodes: &'a [(f64, f64)],
}

/// Memory of products with whole terms.
#[derive(Clone, Debug, Default)]
pub struct ProductScratch {
    from: Vec<f64>,
    to: Vec<f64>,
    memory: FourierScratch,
}

impl WeightedTerms<'_> {
    fn weight(&self, k: usize) -> f64 {
        if self.terms[k].is_driven() {
            return 1.0;
        }
        self.weights.map_or(1.0, |weights| weights[k])
    }

    /// Products that one counts as: one for each time of a term that depends on time by itself.
    pub fn products(&self) -> usize {
        if self.terms.iter().any(Operator::is_driven) {
            self.nodes.len()
        } else {
            1
        }
    }

    /// The update by a term: the first one keeps its part of `out`, others add.
    fn part(&self, k: usize, update: Update) -> Update {
        let factor = self.weight(k) * update.factor;
        if k == 0 {
            Update { factor, ..update }
        } else {
            Update::added(factor)
        }
    }

    /// Updates some rows by all terms.
    ///
    /// # Panics
    /// When a term is a whole one.
    pub fn act<S: Stored>(&self, machine: InstructionSet, update: Update, block: RowBlock<'_, S>) {
        let RowBlock { row, out, place, x } = block;
        for (k, term) in self.terms.iter().enumerate() {
            let out = &mut *out;
            let update = self.part(k, update);
            term.act(machine, update, RowBlock { row, out, place, x });
        }
        self.add_potential(update.factor, RowBlock { row, out, place, x });
    }

    fn add_potential<S: Stored>(&self, factor: f64, block: RowBlock<'_, S>) {
        let RowBlock { row, out, place, x } = block;
        if self.potential.is_empty() {
            return;
        }
        let potential = &self.potential[row..];
        for ((out, x), v) in out.iter_mut().zip(&x[row - place..]).zip(potential) {
            for m in 0..S::MEMBERS {
                out.set_member(m, out.member(m) + factor * v * x.member(m));
            }
        }
    }

    /// Updates all rows, by terms of any kind.
    ///
    /// # Errors
    /// A product failed; `out` may be anything then.
    pub fn update<S: Stored>(
        &self,
        machine: InstructionSet,
        update: Update,
        x: &[S],
        out: &mut [S],
        scratch: &mut ProductScratch,
    ) -> Result<(), StepError> {
        for (k, term) in self.terms.iter().enumerate() {
            let update = (self.part(k, update), self.nodes);
            update_all(term, machine, update, x, out, scratch)?;
        }
        let (row, place) = (0, 0);
        self.add_potential(update.factor, RowBlock { row, out, place, x });
        Ok(())
    }

    /// Makes `out` the product with `x`.
    ///
    /// # Errors
    /// A product failed.
    pub fn multiply<S: Stored>(
        &self,
        machine: InstructionSet,
        x: &[S],
        out: &mut [S],
        scratch: &mut ProductScratch,
    ) -> Result<(), StepError> {
        out.fill(S::splat(0.0));
        self.update(machine, Update::added(1.0), x, out, scratch)
    }

    /// Makes `out` the product with `x` by all terms but kinetic energies, and returns ⟨x|T|x⟩ of these, which takes no
    /// transform back.
    ///
    /// # Errors
    /// A product failed.
    pub(crate) fn without_kinetic(
        &self,
        machine: InstructionSet,
        x: &[f64],
        out: &mut [f64],
        scratch: &mut ProductScratch,
    ) -> Result<f64, StepError> {
        out.fill(0.0);
        let mut kinetic = 0.0;
        for (k, term) in self.terms.iter().enumerate() {
            if let Some(term) = term.kinetic() {
                for x in x.chunks_exact(term.size()) {
                    kinetic += self.weight(k) * term.expectation(x, &mut scratch.memory)?;
                }
            } else {
                let update = (Update::added(self.weight(k)), self.nodes);
                update_all(term, machine, update, x, out, scratch)?;
            }
        }
        let (row, place) = (0, 0);
        self.add_potential(1.0, RowBlock { row, out, place, x });
        Ok(kinetic)
    }
}

/// The use of a product, and pairs (a, t) where a term depends on time by itself.
type At<'a> = (Update, &'a [(f64, f64)]);

/// Updates all rows by a term.
fn update_all<S: Stored>(
    term: &Operator,
    machine: InstructionSet,
    (update, nodes): At<'_>,
    x: &[S],
    out: &mut [S],
    scratch: &mut ProductScratch,
) -> Result<(), StepError> {
    let (row, place) = (0, 0);
    match term {
        Operator::Product(product) => apply(&**product, (update, nodes), x, out, scratch)?,
        Operator::Kinetic(kinetic) => kinetic.update(update, x, out, &mut scratch.memory)?,
        Operator::Coupling(coupling) => coupling.update(update, x, out),
        Operator::Repeated(operator, _) => {
            let n = operator.size();
            for (x, out) in x.chunks(n).zip(out.chunks_mut(n)) {
                update_all(operator, machine, (update, nodes), x, out, scratch)?;
            }
        }
        Operator::Rows(_)
        | Operator::Sparse(_)
        | Operator::Diagonals(_)
        | Operator::Dense(_)
        | Operator::Spins(_) => term.act(machine, update, RowBlock { row, out, place, x }),
    }
    Ok(())
}

/// Updates all rows by a product of the user, member by member.
fn apply<S: Stored>(
    product: &dyn Product,
    (update, nodes): At<'_>,
    x: &[S],
    out: &mut [S],
    scratch: &mut ProductScratch,
) -> Result<(), StepError> {
    let ProductScratch { from, to, .. } = scratch;
    for member in 0..S::MEMBERS {
        for part in [&mut *from, to] {
            if part.len() != x.len() {
                resize(part, x.len(), 0.0)?;
            }
        }
        for (from, x) in from.iter_mut().zip(x) {
            *from = x.member(member);
        }
        if !product.multiply(nodes, from, to) {
            return Err(StepError::Interrupted);
        }
        for ((out, x), product) in out.iter_mut().zip(&*from).zip(&*to) {
            let change = update.factor * product + update.diagonal * x;
            out.set_member(member, update.keep * out.member(member) + change);
        }
    }
    Ok(())
}
