//! A Hamiltonian as a weighted sum of its terms.

use super::kept::Kept;
use super::{Drive, Nonlinearity, Operator, Potential};
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
    /// Points of the potential that are looked at.
    looks: Kept,
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
            looks: Kept::default(),
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
            looks: Kept::default(),
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
            looks: Kept::default(),
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

    /// The same less i times a diagonal that absorbs, of which the split operator and Arnoldi's method alone know.
    ///
    /// # Panics
    /// When it has another size, or grows.
    #[must_use]
    pub fn with_absorber(self, absorber: Arc<[f64]>) -> Self {
        assert_eq!(absorber.len(), self.places(), "size of an absorber");
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

    /// Where the points of its potential that are looked at are kept.
    pub(crate) fn looks(&self) -> &Kept {
        &self.looks
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
}
