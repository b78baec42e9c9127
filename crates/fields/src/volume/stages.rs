//! Runge-Kutta steps of triangular pieces, and their adjoints.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::State;
use super::code::Code;
use super::kernel::{Scratch, add, set_rows, value};
use super::rows::Rows;
use super::triangular::Triangular;
use liouville_base::simd::{ForEach, Number, SimdView, SimdViews};

/// Z_r = x + h Σ_{q<r} A_rq K_q, for a run.
struct SetStage<'a, S> {
    weights: &'a [f64],
    place: usize,
    h: f64,
    x: &'a [S],
    earlier: &'a [[Vec<S>; 2]],
    out: &'a mut [S],
}

impl<S> ForEach<S> for SetStage<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let x = window.load(self.x, self.place);
        let change = combined(window, self.weights, self.earlier, self.place);
        window.store(self.out, self.place, x + change.scaled(self.h));
        true
    }
}

/// Σ weights_q K_q
#[inline(always)]
fn combined<W: SimdView>(
    window: W,
    weights: &[f64],
    stages: &[[Vec<W::Stored>; 2]],
    place: usize,
) -> W::Number {
    let mut sum = window.constant(0.0);
    for (weight, [_, k]) in weights.iter().zip(stages) {
        sum = sum + window.load(k, place).scaled(*weight);
    }
    sum
}

/// x += h Σ b_r K_r, for a run.
struct Finish<'a, S> {
    weights: &'a [f64],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
    stages: &'a [[Vec<S>; 2]],
}

impl<S> ForEach<S> for Finish<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let change = combined(window, self.weights, self.stages, self.place);
        let change = change.scaled(self.h);
        add(window, self.state.parts(), self.place, change);
        true
    }
}

/// The step: Z_r and K_r stage after stage.
#[inline(always)]
pub(super) fn runge_kutta<W: SimdViews>(
    windows: W,
    piece: &Triangular,
    h: f64,
    state: &mut State<W::Stored>,
    scratch: &mut Scratch<W::Stored>,
) where
    W::Stored: Copy,
{
    let s = piece.stages;
    let runs = || piece.levels.iter().flat_map(Rows::iter);
    for r in 0..s {
        let (earlier, later) = scratch.stages.split_at_mut(r);
        let [z, k] = &mut later[0];
        z.copy_from_slice(&state.x);
        for (run, _) in runs() {
            let mut stage = SetStage {
                weights: &piece.a[r * s..r * s + r],
                place: run.place,
                h,
                x: &state.x,
                earlier: &*earlier,
                out: &mut *z,
            };
            windows.each(run.count, &mut stage);
        }
        for level in &piece.levels {
            set_rows(windows, level, z, k);
        }
    }
    for (run, _) in runs() {
        let mut finish = Finish {
            weights: &piece.b,
            place: run.place,
            h,
            state: &mut *state,
            stages: &scratch.stages[..s],
        };
        windows.each(run.count, &mut finish);
    }
}

/// All stages of a run whose earlier levels are known: K_r, z, Z_r.
struct Substitute<'a, S> {
    piece: &'a Triangular,
    program: &'a [Code],
    place: usize,
    h: f64,
    state: &'a mut State<S>,
    stages: &'a mut [[Vec<S>; 2]],
}

impl<S> ForEach<S> for Substitute<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let s = self.piece.stages;
        for [z, k] in &mut self.stages[..s] {
            let change = value(window, self.program, z);
            window.store(k, self.place, change);
        }
        let change = combined(window, &self.piece.b, self.stages, self.place);
        let change = change.scaled(self.h);
        add(window, self.state.parts(), self.place, change);
        let end = window.load(&self.state.x, self.place);
        for r in 0..s {
            let weights = &self.piece.a[r * s..r * s + r];
            let change = combined(window, weights, self.stages, self.place);
            let z = &mut self.stages[r][0];
            window.store(z, self.place, end - change.scaled(self.h));
        }
        true
    }
}

/// The adjoint step, level after level.
#[inline(always)]
pub(super) fn substitute<W: SimdViews>(
    windows: W,
    piece: &Triangular,
    h: f64,
    state: &mut State<W::Stored>,
    scratch: &mut Scratch<W::Stored>,
) where
    W::Stored: Copy,
{
    for [z, _] in &mut scratch.stages[..piece.stages] {
        z.copy_from_slice(&state.x);
    }
    for level in &piece.levels {
        for (run, program) in level.iter() {
            let mut substitute = Substitute {
                piece,
                program,
                place: run.place,
                h,
                state: &mut *state,
                stages: &mut scratch.stages,
            };
            windows.each(run.count, &mut substitute);
        }
    }
}
