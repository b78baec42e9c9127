//! Which solver is used from which size on: the thresholds of all methods, each with its measurement.
//!
//! [`crate::simd`] lies below and keeps its own, the length from which one member's vectors are run with wide registers.

/// Whether sparse LU of this order and so many entries is faster than dense LU.
///
/// Measured, dense over sparse: chains (three entries a row) 0.95 at order 30, 1.1 at 36, 6.5 at 201; seven a row
/// 0.5 at 24, 1.5 at 60 (of a whole step), 1.9 at 100; full 0.6 at 128, 1.4 at 200.
pub fn prefers_sparse(order: usize, entries: usize) -> bool {
    order >= 32 && (6 * entries <= order * order || order >= 160)
}

/// The order of the largest diagonal block that is inverted.
pub const LARGEST_BLOCK: usize = 8;

/// The flops an entry of the factors from which sparse LU works in dense panels.
///
/// Measured: faer's own 1.0 makes plates of 144 to 1860 unknowns 1.5 to 6 times slower, 0.05 makes chains 3 times
/// slower; between 0.1 and 0.3 each gets its best.
pub const PANELS: f64 = 0.2;

/// Entries up to which dependent rows are found in a dense copy of a matrix, of 2 MB.
pub const LARGEST_DENSE_RANK: usize = 250_000;

/// Updates that elimination without pivoting may cost a block on average.
///
/// Chains and trees take 1, spherical joints of rigid bodies 22, revolute ones 60, and a few closed loops little more.
pub const MOST_UPDATES: usize = 150;

/// The most nodes whose blocks are eliminated; each number has code of its own.
pub const MOST_NODES: usize = 8;

/// Constraints from which a saddle's Schur complement is sparse, where most of `g_y` is zero.
///
/// Measured on plane chains, sparse over dense: 0.97 of a step with 10 links, 0.9 with 16, 0.84 with 24.
pub const SPARSE_SADDLE: usize = 10;

/// Constraints from which a saddle whose Schur complement is not sparse is solved as the KKT matrix.
///
/// Measured on chains with a diagonal mass, Schur complement over KKT matrix: 0.6 at 24 links, 1.0 at 48, 1.4 at 64.
pub const KKT_SADDLE: usize = 48;

/// The order of node Schur from which its matrix is sparse, and half of it where most of `g_y` is zero.
///
/// Measured on plane chains, sparse over dense: 0.85 of a step at order 16, 0.77 at 20, 0.5 at 32; with 3 rods in
/// space, order 24, 0.63.
pub const SPARSE_NODE_SCHUR: usize = 24;

/// The largest order of node Schur with a dense matrix: beyond it sparse full Newton takes less time ...
pub const LARGEST_DENSE_NODE_SCHUR: usize = 400;

/// ... and so it does where v_z p_z⁻¹ r_λ of all nodes has more entries than this.
pub const LARGEST_DENSE_INVERSE_MASS_RT: usize = 10_000_000;

/// Corrections node Schur may take before full Newton is the better choice, where a matrix of full Newton is cheap ...
///
/// ... or where it is of a higher order than [`CHEAP_NEWTON`], or p does not depend on y.
pub const SCHUR_ITERATIONS: [usize; 2] = [8, 20];

/// The order up to which a matrix of full Newton is cheap.
pub const CHEAP_NEWTON: usize = 40;

/// Members of an ensemble from which lock-step is faster than one by one.
pub const FEWEST_MEMBERS: usize = 3;

/// Coordinates and multipliers up to which lock-step is the faster way.
pub const LARGEST_MEMBER: usize = 64;
