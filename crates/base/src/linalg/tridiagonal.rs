//! Eigenvalues and eigenvectors of small symmetric tridiagonal matrices, by faer.

use faer::diag::{DiagMut, DiagRef};
use faer::dyn_stack::MemStack;
use faer::linalg::evd::{
    ComputeEigenvectors, SelfAdjointEvdParams, self_adjoint_evd_scratch,
    tridiagonal_self_adjoint_evd,
};
use faer::{MatMut, Par, Spec};
use std::mem::MaybeUninit;

/// T = U Λ Uᵀ, with memory for the largest T.
#[derive(Clone, Debug)]
pub struct Tridiagonal {
    values: Vec<f64>,
    vectors: Vec<f64>,
    memory: Vec<MaybeUninit<u8>>,
}

fn parameters() -> Spec<SelfAdjointEvdParams, f64> {
    Spec::default()
}

impl Tridiagonal {
    /// Memory for matrices up to this order.
    pub fn new(most: usize) -> Self {
        let yes = ComputeEigenvectors::Yes;
        let memory = self_adjoint_evd_scratch::<f64>(most, yes, Par::Seq, parameters());
        Self {
            values: Vec::with_capacity(most),
            vectors: Vec::with_capacity(most * most),
            memory: vec![MaybeUninit::uninit(); memory.unaligned_bytes_required()],
        }
    }

    /// Takes apart the matrix with this diagonal, and with the numbers beside it at the head of `beside`.
    ///
    /// # Panics
    /// When a number is not finite, or there are not enough of them.
    pub fn solve(&mut self, diagonal: &[f64], beside: &[f64]) {
        let n = diagonal.len();
        let beside = &beside[..n.saturating_sub(1)];
        let mut numbers = diagonal.iter().chain(beside);
        assert!(numbers.all(|x| x.is_finite()), "numbers of a matrix");
        self.values.resize(n, 0.0);
        self.vectors.resize(n * n, 0.0);
        let outcome = tridiagonal_self_adjoint_evd(
            DiagRef::from_slice(diagonal),
            DiagRef::from_slice(beside),
            DiagMut::from_slice_mut(&mut self.values),
            Some(MatMut::from_column_major_slice_mut(&mut self.vectors, n, n)),
            Par::Seq,
            MemStack::new(&mut self.memory),
            parameters(),
        );
        assert!(outcome.is_ok(), "eigenvalues of a finite matrix are found");
    }

    /// The eigenvalues, the smallest first.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The eigenvector of eigenvalue k.
    pub fn vector(&self, k: usize) -> &[f64] {
        let n = self.values.len();
        &self.vectors[k * n..(k + 1) * n]
    }
}
