//! A real symmetric Hamiltonian, known by its products: i ψ' = H ψ with H = Σ w_k H_k.
//!
//! With ψ = q + i p this is q' = H p, p' = −H q. A complex Hermitian H = A + iB is the real symmetric matrix
//! [[A, −B], [B, A]] of (q, p), which methods take as one of their products. Terms are of two kinds. A term by rows computes some rows of a product from
//! their neighbourhood in x, so that several products go over the matrix in one sweep and threads share the rows; a
//! whole term computes all of a product at once.

mod coupling;
mod dense;
mod diagonals;
mod drive;
mod hamiltonian;
mod hamiltonian_at;
mod kept;
mod kinetic;
mod nonlinearity;
mod potential;
mod product;
mod row_product;
mod rows;
mod sparse;
mod spins;
mod weighted_terms;

pub use coupling::Coupling;
pub use dense::Dense;
pub use diagonals::Diagonals;
pub use drive::Drive;
pub use hamiltonian::Hamiltonian;
pub use hamiltonian_at::HamiltonianAt;
pub use kinetic::Kinetic;
pub(crate) use nonlinearity::DensityRegisters;
pub use nonlinearity::Nonlinearity;
pub use potential::Potential;
pub(crate) use potential::{AT_ONCE, PotentialRegisters};
pub use product::Product;
pub use row_product::{RowBlock, Update};
pub use sparse::Sparse;
pub use spins::{Bond, Spins};
pub use weighted_terms::{ProductScratch, WeightedTerms};

use liouville_base::linalg::Rows;
use liouville_base::simd::{InstructionSet, Stored};
use row_product::update_rows;
use std::sync::Arc;

/// One real symmetric matrix H_k.
#[derive(Clone)]
pub enum Operator {
    /// A sparse matrix by rows.
    Rows(Arc<Rows>),
    /// A sparse matrix, most of it by diagonals.
    Sparse(Arc<Sparse>),
    /// Kinetic energy on a grid.
    Kinetic(Arc<Kinetic>),
    /// A matrix by its diagonals.
    Diagonals(Arc<Diagonals>),
    /// A dense matrix.
    Dense(Arc<Dense>),
    /// A chain of spins.
    Spins(Arc<Spins>),
    /// Any function that computes products.
    Product(Arc<dyn Product>),
    /// A matrix that acts on each of so many parts of a state: real and imaginary ones, or components.
    Repeated(Arc<Operator>, usize),
    /// A matrix between components.
    Coupling(Arc<Coupling>),
}

impl Operator {
    /// A sparse matrix, by diagonals if it has some that hold most of it.
    pub fn sparse(rows: Arc<Rows>) -> Self {
        match Sparse::new(&rows) {
            Some(sparse) => Self::Sparse(Arc::new(sparse)),
            None => Self::Rows(rows),
        }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        match self {
            Self::Rows(rows) => rows.shape().0,
            Self::Sparse(sparse) => sparse.size(),
            Self::Kinetic(kinetic) => kinetic.size(),
            Self::Diagonals(diagonals) => diagonals.size(),
            Self::Dense(dense) => dense.size(),
            Self::Spins(spins) => spins.size(),
            Self::Product(product) => product.size(),
            Self::Repeated(operator, times) => times * operator.size(),
            Self::Coupling(coupling) => coupling.size(),
        }
    }

    /// Whether it depends on time by itself, as a function of the user's may.
    pub fn is_driven(&self) -> bool {
        matches!(self, Self::Product(product) if product.is_driven())
    }

    /// The kinetic energy on a grid, if it is that, be it of each component.
    pub(crate) fn kinetic(&self) -> Option<&Arc<Kinetic>> {
        match self {
            Self::Kinetic(kinetic) => Some(kinetic),
            Self::Repeated(operator, _) => operator.kinetic(),
            _ => None,
        }
    }

    /// The largest distance of an entry from the diagonal; none for a whole term.
    pub fn reach(&self) -> Option<usize> {
        match self {
            Self::Rows(rows) => Some(rows.reach()),
            Self::Sparse(sparse) => Some(sparse.reach()),
            Self::Kinetic(_) | Self::Product(_) | Self::Repeated(..) | Self::Coupling(_) => None,
            Self::Diagonals(diagonals) => Some(diagonals.reach()),
            Self::Dense(dense) => Some(dense.size()),
            Self::Spins(spins) => Some(spins.size()),
        }
    }

    /// Mean bytes of a row of a term by rows.
    pub fn bytes_a_row(&self) -> usize {
        let bytes = match self {
            Self::Rows(rows) => rows.bytes(),
            Self::Sparse(sparse) => sparse.bytes(),
            Self::Diagonals(diagonals) => diagonals.bytes(),
            Self::Dense(dense) => dense.bytes(),
            Self::Spins(spins) => spins.bytes(),
            Self::Kinetic(_) | Self::Product(_) | Self::Repeated(..) | Self::Coupling(_) => 0,
        };
        bytes.div_ceil(self.size())
    }

    /// Updates some rows.
    ///
    /// # Panics
    /// When this is a whole term.
    pub fn act<S: Stored>(&self, machine: InstructionSet, update: Update, block: RowBlock<'_, S>) {
        match self {
            Self::Rows(rows) => update_rows(&**rows, machine, update, block),
            Self::Sparse(sparse) => sparse.act(machine, update, block),
            Self::Kinetic(_) | Self::Product(_) | Self::Repeated(..) | Self::Coupling(_) => {
                unreachable!("whole terms have no rows")
            }
            Self::Diagonals(diagonals) => update_rows(&**diagonals, machine, update, block),
            Self::Dense(dense) => update_rows(&**dense, machine, update, block),
            Self::Spins(spins) => spins.act(machine, update, block),
        }
    }
}
