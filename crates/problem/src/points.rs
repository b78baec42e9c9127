//! A model at all stages or nodes of a step: side by side where that is faster, with the same bits.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Model;
use liouville_base::linalg::Matrix;
use liouville_base::real::Real;
use liouville_base::tape::{BatchRegisters, PointRegisters, Registers, Tape};

/// Outputs that follow one another, cut at their sizes.
pub(super) type Parts<'a, const K: usize, R = f64> = [&'a [R]; K];

#[inline(always)]
pub(super) fn cut<const K: usize, R>(values: &[R], sizes: [usize; K]) -> Parts<'_, K, R> {
    let (mut parts, mut start) = ([&values[..0]; K], 0);
    for (part, size) in parts.iter_mut().zip(sizes) {
        *part = &values[start..start + size];
        start += size;
    }
    parts
}

/// The memory of one tape.
#[derive(Clone, Debug)]
pub(super) struct TapeRegisters<R> {
    pub(super) one: Registers<R>,
    pub(super) batch: Option<Box<BatchRegisters<R>>>,
}

impl<R: Real> TapeRegisters<R> {
    pub(super) fn new(tape: &Tape, params: &[R]) -> Self {
        Self {
            one: tape.bind(params),
            batch: None,
        }
    }

    pub(super) fn reserve_batch(&mut self, tape: &Tape, points: usize) {
        self.batch = tape.batch(&self.one, points).map(Box::new);
    }

    #[inline(always)]
    pub(super) fn at<'a, const N: usize>(
        &'a mut self,
        tape: &'a Tape,
        (times, args): PointRows<'a, R>,
        sizes: [usize; N],
    ) -> Points<'a, N, R> {
        if let Some(batch) = &mut self.batch {
            tape.eval_batch(batch, |i| times.at(i), args.map(Matrix::flat));
        }
        Points {
            tape,
            memory: self,
            times,
            args,
            sizes,
        }
    }
}

/// The times t + `c_i` h.
#[derive(Clone, Copy, Debug)]
pub struct Times<'a> {
    /// Where the step starts.
    pub t: f64,
    /// How long it is.
    pub h: f64,
    /// The nodes, as fractions of it.
    pub c: &'a [f64],
}

impl Times<'_> {
    /// The time of one.
    #[inline(always)]
    pub fn at(&self, i: usize) -> f64 {
        self.t + self.c[i] * self.h
    }
}

/// The times of several points, and the matrices whose rows are two other arguments there.
pub type PointRows<'a, R> = (Times<'a>, [&'a Matrix<R>; 2]);

/// A tape at several points, whose arguments are the rows of matrices.
#[derive(Debug)]
pub struct Points<'a, const N: usize, R = f64> {
    tape: &'a Tape,
    memory: &'a mut TapeRegisters<R>,
    times: Times<'a>,
    args: [&'a Matrix<R>; 2],
    sizes: [usize; N],
}

impl<const N: usize, R: Real> Points<'_, N, R> {
    /// Whether the values depend on parameters alone.
    pub fn is_constant(&self) -> bool {
        self.tape.is_empty()
    }

    /// The values at one point.
    #[inline(always)]
    pub fn at(&mut self, i: usize) -> Parts<'_, N, R> {
        let values = if let Some(batch) = &self.memory.batch {
            batch.at(i, self.tape.outputs())
        } else {
            let [a, b] = self.args.map(|arg| arg.row(i));
            let t = [R::splat(self.times.at(i))];
            self.tape.eval(&mut self.memory.one, [&t, a, b])
        };
        cut(values, self.sizes)
    }
}

impl<R: Real> Model<R> {
    /// Takes memory to be evaluated at so many stages and nodes at once.
    #[inline(never)]
    pub fn reserve_batch(&mut self, stages: usize, nodes: usize) {
        let problem = &self.problem;
        self.stage.reserve_batch(&problem.stage, stages);
        self.stage_blocks
            .reserve_batch(&problem.stage_blocks, stages);
        self.stage_jacobian
            .reserve_batch(&problem.stage_jacobian, stages);
        self.node.reserve_batch(&problem.node, nodes);
        self.node_blocks.reserve_batch(&problem.node_blocks, nodes);
        self.node_jacobian
            .reserve_batch(&problem.node_jacobian, nodes);
    }

    /// Memory of [`Model::stage`] at so many points, and of [`Model::node`] and [`Model::node_blocks`], with numbers
    /// that several of these become; `None` where they are large.
    pub fn at_points<P: Real>(
        &self,
        [stages, nodes]: [usize; 2],
        number: impl Fn(R) -> P + Copy,
    ) -> Option<[PointRegisters<P>; 3]> {
        let problem = &self.problem;
        Some([
            problem.stage.at_points(&self.stage.one, stages, number)?,
            problem.node.at_points(&self.node.one, nodes, number)?,
            (problem.node_blocks).at_points(&self.node_blocks.one, nodes, number)?,
        ])
    }

    /// The same of [`Model::stage_blocks`], [`Model::stage_jacobian`] and [`Model::node_jacobian`].
    pub fn jacobians_at_points<P: Real>(
        &self,
        [stages, nodes]: [usize; 2],
        number: impl Fn(R) -> P + Copy,
    ) -> Option<[PointRegisters<P>; 3]> {
        let problem = &self.problem;
        Some([
            (problem.stage_blocks).at_points(&self.stage_blocks.one, stages, number)?,
            (problem.stage_jacobian).at_points(&self.stage_jacobian.one, stages, number)?,
            (problem.node_jacobian).at_points(&self.node_jacobian.one, nodes, number)?,
        ])
    }

    /// [`Model::stage`] at several points (t, y, z).
    #[inline(always)]
    pub fn stages<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 3, R> {
        let sizes = self.stage_sizes();
        self.stage.at(&self.problem.stage, at, sizes)
    }

    /// [`Model::stage_blocks`] at several points.
    #[inline(always)]
    pub fn stages_blocks<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 2, R> {
        let (tape, sizes) = (&self.problem.stage_blocks, self.stage_blocks_sizes());
        self.stage_blocks.at(tape, at, sizes)
    }

    /// [`Model::stage_jacobian`] at several points.
    #[inline(always)]
    pub fn stages_jacobian<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 4, R> {
        let (tape, sizes) = (&self.problem.stage_jacobian, self.stage_jacobian_sizes());
        self.stage_jacobian.at(tape, at, sizes)
    }

    /// [`Model::node`] at several points (t, y, λ).
    #[inline(always)]
    pub fn nodes<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 2, R> {
        let sizes = self.node_sizes();
        self.node.at(&self.problem.node, at, sizes)
    }

    /// [`Model::node_blocks`] at several points.
    #[inline(always)]
    pub fn nodes_blocks<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 2, R> {
        let (tape, sizes) = (&self.problem.node_blocks, self.node_blocks_sizes());
        self.node_blocks.at(tape, at, sizes)
    }

    /// [`Model::node_jacobian`] at several points.
    #[inline(always)]
    pub fn nodes_jacobian<'a>(&'a mut self, at: PointRows<'a, R>) -> Points<'a, 1, R> {
        let (tape, sizes) = (
            &self.problem.node_jacobian,
            [self.problem.patterns.r_y.len()],
        );
        self.node_jacobian.at(tape, at, sizes)
    }
}
