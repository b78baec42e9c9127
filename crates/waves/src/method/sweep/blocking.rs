//! Blocks of rows, and moves over them in one sweep, that fit a core's cache.

/// Bytes that stay in a core's own cache.
const NEAR: usize = 1 << 20;
/// Bytes that stay in the cache that cores share.
const FAR: usize = 1 << 22;
/// Most bytes of a thread between two polls for cancellation.
pub(super) const LONG: usize = 1 << 26;
/// Fewest and most rows of a block.
const ROWS: (usize, usize) = (256, 4096);
/// Most moves in a sweep; more are not faster.
const MOVES: usize = 32;

/// Blocks of rows and moves over them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Blocking {
    /// Rows of a block.
    pub(super) rows: usize,
    /// Moves in a sweep.
    pub(super) moves: usize,
}

impl Blocking {
    /// Blocking for n rows, of which each has so many bytes of vectors and matrix and reads up to `reach` others
    /// on both sides.
    pub(super) fn new(n: usize, reach: usize, bytes: usize, threads: usize) -> Self {
        let plain = Self {
            rows: (NEAR / 8 / bytes).next_multiple_of(64).min(n),
            moves: 1,
        };
        if n * bytes <= 2 * NEAR {
            return Self { rows: n, ..plain };
        }
        let rows = reach.next_multiple_of(64).clamp(ROWS.0, ROWS.1);
        let blocking = Self { rows, moves: 1 };
        let of_move = (blocking.lag(reach) + 1) * rows * bytes;
        let moves = match NEAR / of_move {
            0..4 => FAR / threads / of_move,
            moves => moves,
        };
        let in_time = 8 * LONG * threads / (n * bytes);
        match moves.min(in_time).min(MOVES) {
            0 | 1 => plain,
            moves => Self { rows, moves },
        }
    }

    /// Blocks that a move is behind the one before: so many that all its input is computed, and that it overwrites nothing
    /// that the one before still reads.
    pub(super) fn lag(self, reach: usize) -> usize {
        reach.div_ceil(self.rows)
    }
}
