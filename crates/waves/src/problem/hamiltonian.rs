//! A Hamiltonian as a weighted sum of its terms.

use super::kept::Kept;
use super::{Drive, HamiltonianAt, Nonlinearity, Operator, Potential, Product, RowBlock, Update};
use liouville_base::error::StepError;
use liouville_base::run::resize;
use liouville_base::simd::{InstructionSet, Stored};
use liouville_fourier::FourierScratch;
use std::sync::Arc;

/// The terms H_k, read-only, and their dependence on time: H(t) = Σ f_k(t) H_k + V(t).
#[derive(Clone)]
pub struct Hamiltonian {
    pub(super) terms: Vec<Operator>,
    pub(super) drive: Option<Drive>,
    pub(super) potential: Option<Potential>,
    nonlinearity: Option<Nonlinearity>,
    /// W of V − iW, empty if there is none.
    absorber: Arc<[f64]>,
    is_doubled: bool,
    /// Windows of series in time.
    windows: Kept,
    /// Values of its functions of time.
    scan: Kept,
}

impl Hamiltonian {
    /// A sum of terms of the same size.
    ///
    /// # Panics
    /// When there are none, or their sizes differ.
    pub fn new(terms: Vec<Operator>) -> Self {
        let n = terms[0].size();
        assert!(terms.iter().all(|term| term.size() == n), "size of a term");
        Self {
            terms,
            drive: None,
            potential: None,
            nonlinearity: None,
            absorber: Arc::default(),
            is_doubled: false,
            windows: Kept::default(),
            scan: Kept::default(),
        }
    }

    /// The same as [[A, −B], [B, A]] of a complex Hermitian H = A + iB, which acts on (q, p).
    ///
    /// It is real and symmetric, with every eigenvalue of H twice, and an even number of rows.
    #[must_use]
    pub fn doubled(self) -> Self {
        let is_doubled = true;
        Self { is_doubled, ..self }
    }

    /// Whether it acts on real and imaginary parts one after the other, as a complex H does.
    pub fn is_doubled(&self) -> bool {
        self.is_doubled
    }

    /// Number of places of a wave function.
    pub fn places(&self) -> usize {
        if self.is_doubled {
            self.size() / 2
        } else {
            self.size()
        }
    }

    /// Some of the terms without their dependence on time.
    #[must_use]
    pub(crate) fn part(&self, terms: &[Operator]) -> Self {
        let is_doubled = self.is_doubled;
        Self {
            is_doubled,
            ..Self::new(terms.to_vec())
        }
    }

    /// The same with weights that depend on time.
    ///
    /// # Panics
    /// When there are not as many as terms.
    #[must_use]
    pub fn with_drive(self, drive: Drive) -> Self {
        assert_eq!(drive.terms(), self.terms.len(), "number of weights");
        Self {
            drive: Some(drive),
            windows: Kept::default(),
            scan: Kept::default(),
            ..self
        }
    }

    /// The same with a potential that depends on time.
    ///
    /// # Panics
    /// When it has another size.
    #[must_use]
    pub fn with_potential(self, potential: Potential) -> Self {
        assert_eq!(potential.size(), self.size(), "size of a potential");
        Self {
            potential: Some(potential),
            windows: Kept::default(),
            scan: Kept::default(),
            ..self
        }
    }

    /// The same with a potential that depends on the density, of which the split operator alone knows.
    #[must_use]
    pub fn with_nonlinearity(self, nonlinearity: Nonlinearity) -> Self {
        let nonlinearity = Some(nonlinearity);
        Self {
            nonlinearity,
            ..self
        }
    }

    /// The same less i times a diagonal that absorbs, of which the split operator alone knows.
    ///
    /// # Panics
    /// When it has another size, or grows.
    #[must_use]
    pub fn with_absorber(self, absorber: Arc<[f64]>) -> Self {
        assert_eq!(absorber.len(), self.size(), "size of an absorber");
        assert!(absorber.iter().all(|w| *w >= 0.0), "sign of an absorber");
        Self { absorber, ..self }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.terms[0].size()
    }

    /// The terms.
    pub fn terms(&self) -> &[Operator] {
        &self.terms
    }

    /// The weights that depend on time.
    pub(crate) fn drive(&self) -> Option<&Drive> {
        self.drive.as_ref()
    }

    /// The potential that depends on time.
    pub(crate) fn potential(&self) -> Option<&Potential> {
        self.potential.as_ref()
    }

    /// The potential that depends on the density.
    pub(crate) fn nonlinearity(&self) -> Option<&Nonlinearity> {
        self.nonlinearity.as_ref()
    }

    /// The diagonal that absorbs, empty if there is none.
    pub(crate) fn absorber(&self) -> &[f64] {
        &self.absorber
    }

    /// Where windows of series in time are kept.
    pub(crate) fn windows(&self) -> &Kept {
        &self.windows
    }

    /// Where values of its functions of time are kept.
    pub(crate) fn scan(&self) -> &Kept {
        &self.scan
    }

    /// Whether it depends on time.
    pub fn is_driven(&self) -> bool {
        self.drive.is_some() || self.potential.is_some() || self.is_by_products()
    }

    /// Whether nothing is known of how it depends on time but its products at any time.
    pub fn is_by_products(&self) -> bool {
        self.terms.iter().any(Operator::is_driven)
    }

    /// Products that one counts as: as many as the user's functions make, and at least one.
    pub fn products(&self) -> usize {
        self.calls().max(1)
    }

    /// Calls of the user's functions in a product.
    pub(crate) fn calls(&self) -> usize {
        let is_foreign = |term: &&Operator| matches!(term, Operator::Product(_));
        self.terms.iter().filter(is_foreign).count()
    }

    /// The largest distance of an entry from the diagonal; none if any term is a whole one.
    pub fn reach(&self) -> Option<usize> {
        let reaches = self.terms.iter().map(Operator::reach);
        reaches.collect::<Option<Vec<_>>>()?.into_iter().max()
    }

    /// Memory for weights and potential at a time; none where nothing depends on time.
    pub fn current(&self) -> Option<HamiltonianAt> {
        self.is_driven().then(|| HamiltonianAt::new(self))
    }

    /// All terms with weight 1, and no potential.
    pub fn sum(&self) -> WeightedTerms<'_> {
        self.at(None)
    }

    /// The terms with weights and potential at a time; all weights are 1 without them.
    pub fn at<'a>(&'a self, current: Option<&'a HamiltonianAt>) -> WeightedTerms<'a> {
        WeightedTerms {
            terms: &self.terms,
            weights: current.map(|current| &current.weights[..]),
            potential: current.map_or(&[], |current| &current.potential),
            nodes: current.map_or(&[], |current| &current.nodes),
        }
    }
}

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
        Operator::Twice(operator) => {
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
