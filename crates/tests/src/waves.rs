//! Hamiltonians whose eigenvectors are known, and what they make of wave functions.

use liouville_base::linalg::Rows;
use liouville_waves::method::Wave;
use liouville_waves::problem::{Hamiltonian, Operator};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A wave function as its real and imaginary parts.
pub type Parts = (Vec<f64>, Vec<f64>);

/// A Hamiltonian of entries (row, column, value).
pub fn sparse(n: usize, entries: &[(usize, usize, f64)]) -> Arc<Hamiltonian> {
    let row: Vec<usize> = entries.iter().map(|entry| entry.0).collect();
    let col: Vec<usize> = entries.iter().map(|entry| entry.1).collect();
    let values: Vec<f64> = entries.iter().map(|entry| entry.2).collect();
    let rows = Rows::new((n, n), &row, &col, &values).expect("entries of the matrix");
    let terms = vec![Operator::Rows(Arc::new(rows))];
    Arc::new(Hamiltonian::new(terms))
}

/// An open chain: −1 beside the diagonal, `potential` on it.
pub fn chain(n: usize, potential: f64) -> Arc<Hamiltonian> {
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, potential));
        if i + 1 < n {
            entries.extend([(i, i + 1, -1.0), (i + 1, i, -1.0)]);
        }
    }
    sparse(n, &entries)
}

/// The end of the spectrum of a chain without potential, which begins at minus this.
pub fn edge(n: usize) -> f64 {
    2.0 * (PI / (n as f64 + 1.0)).cos()
}

/// Sums of e^{−iλt} v v† ψ over eigenvalues λ and eigenvectors v.
fn summed(spectrum: &[(f64, Parts)], t: f64, psi: &Parts) -> Parts {
    let n = psi.0.len();
    let (mut q, mut p) = (vec![0.0; n], vec![0.0; n]);
    for (value, (v_q, v_p)) in spectrum {
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..n {
            re += v_q[i] * psi.0[i] + v_p[i] * psi.1[i];
            im += v_q[i] * psi.1[i] - v_p[i] * psi.0[i];
        }
        let (sin, cos) = (value * t).sin_cos();
        let (re, im) = (re * cos + im * sin, im * cos - re * sin);
        for i in 0..n {
            q[i] += re * v_q[i] - im * v_p[i];
            p[i] += re * v_p[i] + im * v_q[i];
        }
    }
    (q, p)
}

/// What ψ on a [`chain`] is after t, from its sines and cosines.
pub fn chain_after(potential: f64, t: f64, psi: &Parts) -> Parts {
    let n = psi.0.len();
    let mode = |k: usize| {
        let angle = PI * k as f64 / (n as f64 + 1.0);
        let scale = (2.0 / (n as f64 + 1.0)).sqrt();
        let v = (1..=n).map(|i| scale * (angle * i as f64).sin()).collect();
        (potential - 2.0 * angle.cos(), (v, vec![0.0; n]))
    };
    let spectrum: Vec<_> = (1..=n).map(mode).collect();
    summed(&spectrum, t, psi)
}

/// A ring that a flux goes through, −e^{±iθ} from site to site, as [[A, −B], [B, A]] of H = A + iB.
pub fn ring(n: usize, theta: f64) -> Arc<Hamiltonian> {
    let (sin, cos) = theta.sin_cos();
    let mut entries = Vec::new();
    for i in 0..n {
        let j = (i + 1) % n;
        // H_ij = −e^{iθ} and H_ji its conjugate
        for (i, j, sin) in [(i, j, sin), (j, i, -sin)] {
            entries.extend([(i, j, -cos), (n + i, n + j, -cos)]);
            entries.extend([(i, n + j, sin), (n + i, j, -sin)]);
        }
    }
    let rows = sparse(2 * n, &entries).terms().to_vec();
    Arc::new(Hamiltonian::new(rows).doubled())
}

/// What ψ on a [`ring`] is after t, from its plane waves.
pub fn ring_after(theta: f64, t: f64, psi: &Parts) -> Parts {
    let n = psi.0.len();
    let scale = 1.0 / (n as f64).sqrt();
    let mode = |m: usize| {
        let k = TAU * m as f64 / n as f64;
        let turned = |i: usize| ((k * i as f64).cos() * scale, (k * i as f64).sin() * scale);
        (-2.0 * (k + theta).cos(), (0..n).map(turned).unzip())
    };
    let spectrum: Vec<_> = (0..n).map(mode).collect();
    summed(&spectrum, t, psi)
}

/// A wave function of norm 1 with parts everywhere.
pub fn anyhow(n: usize) -> Parts {
    let angle = |i: usize| 12.9898 * (i as f64 + 1.0).powi(2);
    let q: Vec<f64> = (0..n).map(|i| angle(i).sin()).collect();
    let p: Vec<f64> = (0..n).map(|i| (1.7 * angle(i)).cos()).collect();
    let norm = q.iter().chain(&p).map(|x| x * x).sum::<f64>().sqrt();
    let scaled = |x: Vec<f64>| x.into_iter().map(|x| x / norm).collect();
    (scaled(q), scaled(p))
}

/// A wave function at one site.
pub fn at_site(n: usize, site: usize) -> Parts {
    let mut q = vec![0.0; n];
    q[site] = 1.0;
    (q, vec![0.0; n])
}

/// How far a wave function is from what it should be.
pub fn distance(wave: &Wave<f64>, exact: &Parts) -> f64 {
    let (sin, cos) = wave.phase.sin_cos();
    let mut square = 0.0;
    for i in 0..wave.q.len() {
        let (q, p) = (wave.q[i], wave.p[i]);
        let (q, p) = (q * cos + p * sin, p * cos - q * sin);
        square += (q - exact.0[i]).powi(2) + (p - exact.1[i]).powi(2);
    }
    square.sqrt()
}
