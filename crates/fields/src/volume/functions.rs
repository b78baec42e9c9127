//! Functions of the variables that the terms of pieces have as factors.
//!
//! Each has a place behind the variables, where all pieces read it. It is computed before a flow that wants it, in which its
//! variables stand still, and stays until a flow changes one of these: the sine and the cosine of a wave are made together,
//! and a function of time once for all flows at that time, and for all trajectories that share it.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::code::{Code, Variables, evaluate};
use super::order::Order;
use super::rows::{PolynomialRows, narrow};
use super::views::value;
use crate::problem::{Formula, Function, Piece};
use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::{ForEach, Kernel, Number, SimdView, SimdViews, Stored};
use liouville_base::tape::{Registers, Tape};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// The functions of a split.
#[derive(Debug, Default)]
pub(super) struct Functions {
    all: Vec<FunctionAt>,
    pieces: Vec<Wanted>,
    /// How many places they have.
    places: usize,
}

/// The functions that matter to a piece.
#[derive(Debug, Default)]
struct Wanted {
    /// Functions in its terms: their number among all, and in the piece.
    wanted: Vec<(usize, usize)>,
    /// Functions of the variables that it changes.
    outdated: Vec<usize>,
}

#[derive(Debug)]
pub(super) struct FunctionAt {
    variables: Vec<usize>,
    /// The places of these variables.
    pub(super) from: Vec<u32>,
    pub(super) formula: FormulaAt,
}

#[derive(Debug)]
pub(super) enum FormulaAt {
    Wave(Wave),
    /// A tape, the number of its memory, and the place of its first value.
    Tape {
        tape: Arc<Tape>,
        number: usize,
        place: usize,
    },
}

/// The sine and the cosine of an argument.
#[derive(Debug)]
pub(super) struct Wave {
    k: Vec<f64>,
    phase: f64,
    /// The place of a variable that is the argument by itself.
    alone: Option<usize>,
    argument: PolynomialRows,
    sine: Option<usize>,
    cosine: Option<usize>,
}

impl Functions {
    /// Gives the functions of the next piece their places.
    pub(super) fn place(&mut self, piece: &Piece, n: usize, order: &Order) -> Vec<u32> {
        let mut wanted = Vec::new();
        let mut places = Vec::new();
        for (own, function) in piece.functions().iter().enumerate() {
            let (number, place) = self.find(function, n, order);
            if wanted.iter().all(|(other, _)| *other != number) {
                wanted.push((number, own));
            }
            places.push(narrow(place));
        }
        // of the variables, until all functions are known
        let outdated = piece.changes(n);
        self.pieces.push(Wanted { wanted, outdated });
        places
    }

    /// Says which functions each piece outdates, once all have been placed.
    pub(super) fn link(&mut self, n: usize) {
        let mut of = vec![Vec::new(); n];
        for (number, function) in self.all.iter().enumerate() {
            for &variable in &function.variables {
                of[variable].push(number);
            }
        }
        for piece in &mut self.pieces {
            let changed = piece.outdated.iter();
            let mut outdated: Vec<usize> = changed.flat_map(|v| of[*v].iter().copied()).collect();
            outdated.sort_unstable();
            outdated.dedup();
            piece.outdated = outdated;
        }
    }

    /// The number of a function among all, and its place.
    fn find(&mut self, function: &Function, n: usize, order: &Order) -> (usize, usize) {
        let found = self.all.iter().position(|other| other.is_like(function));
        let number = found.unwrap_or_else(|| {
            let from = function.places.iter();
            let from: Vec<u32> = from.map(|v| narrow(order.place_of(*v))).collect();
            let tapes = self.all.iter().filter(|other| !other.is_wave()).count();
            let formula = FormulaAt::new(&function.formula, &from, tapes);
            self.all.push(FunctionAt {
                variables: function.places.clone(),
                from,
                formula,
            });
            self.all.len() - 1
        });
        let next = n + self.places;
        let place = match (&mut self.all[number].formula, &function.formula) {
            (FormulaAt::Wave(wave), Formula::Cosine { phase, .. }) => {
                if is_sine(*phase) {
                    *wave.sine.get_or_insert(next)
                } else {
                    *wave.cosine.get_or_insert(next)
                }
            }
            (FormulaAt::Tape { tape, place, .. }, Formula::Tape { output, .. }) => {
                if found.is_none() {
                    *place = next;
                    self.places += tape.outputs();
                }
                return (number, *place + output);
            }
            _ => unreachable!("a wave is no tape"),
        };
        self.places += usize::from(place == next);
        (number, place)
    }

    /// How many places they have.
    pub(super) fn places(&self) -> usize {
        self.places
    }

    /// Whether a piece has functions.
    pub(super) fn has(&self, piece: usize) -> bool {
        !self.pieces[piece].wanted.is_empty()
    }

    /// Whether one of a piece's functions has to be computed.
    #[inline(always)]
    pub(super) fn wants(&self, piece: usize, scratch: &FunctionScratch) -> bool {
        let mut wanted = self.pieces[piece].wanted.iter();
        wanted.any(|(number, _)| !scratch.is_known[*number])
    }

    /// Notes which functions are no longer known after a piece's flow.
    #[inline(always)]
    pub(super) fn outdate(&self, piece: usize, scratch: &mut FunctionScratch) {
        for &number in &self.pieces[piece].outdated {
            scratch.is_known[number] = false;
        }
    }
}

/// Whether cos(. + phase) is the sine.
#[allow(clippy::float_cmp)] // as it is given
fn is_sine(phase: f64) -> bool {
    phase == -FRAC_PI_2
}

/// The phase of the wave whose sine or cosine a function is.
fn phase_of(phase: f64) -> f64 {
    if is_sine(phase) { 0.0 } else { phase }
}

impl FormulaAt {
    fn new(formula: &Formula, from: &[u32], tapes: usize) -> Self {
        match formula {
            Formula::Cosine { k, phase } => {
                let phase = phase_of(*phase);
                let terms = from.iter().zip(k).map(|(place, k)| (*k, vec![*place]));
                let terms: Vec<_> = std::iter::once((phase, Vec::new())).chain(terms).collect();
                let mut argument = PolynomialRows::default();
                argument.push(0, &terms);
                let is_alone = k == &[1.0] && phase == 0.0;
                Self::Wave(Wave {
                    k: k.clone(),
                    phase,
                    alone: is_alone.then(|| from[0] as usize),
                    argument,
                    sine: None,
                    cosine: None,
                })
            }
            Formula::Tape { value, .. } => Self::Tape {
                tape: Arc::clone(value),
                number: tapes,
                place: 0,
            },
        }
    }
}

impl FunctionAt {
    fn is_wave(&self) -> bool {
        matches!(self.formula, FormulaAt::Wave(_))
    }

    /// Whether this is the function, or a wave that it is the sine or the cosine of.
    #[allow(clippy::float_cmp)] // the same numbers
    fn is_like(&self, other: &Function) -> bool {
        self.variables == other.places
            && match (&self.formula, &other.formula) {
                (FormulaAt::Wave(wave), Formula::Cosine { k, phase }) => {
                    wave.k == *k && wave.phase == phase_of(*phase)
                }
                (FormulaAt::Tape { tape, .. }, Formula::Tape { value, .. }) => {
                    Arc::ptr_eq(tape, value)
                }
                _ => false,
            }
    }
}

/// Memory of functions.
#[derive(Clone, Debug, Default)]
pub(super) struct FunctionScratch {
    is_known: Vec<bool>,
    /// Registers of each tape, for one trajectory and for several in lanes.
    pub(super) registers: Vec<Registers<f64>>,
    pub(super) in_lanes: Vec<Registers<Lanes>>,
    pub(super) arguments: Vec<f64>,
    pub(super) wide: Vec<Lanes>,
}

impl FunctionScratch {
    pub(super) fn new<S: Scalar>(functions: &Functions) -> Self {
        let mut scratch = Self {
            is_known: vec![false; functions.all.len()],
            ..Self::default()
        };
        let mut most = 0;
        for function in &functions.all {
            if let FormulaAt::Tape { tape, .. } = &function.formula {
                scratch.registers.push(tape.bind(&[]));
                if !S::IS_SINGLE {
                    scratch.in_lanes.push(tape.bind(&[]));
                }
                most = most.max(function.from.len());
            }
        }
        scratch.arguments = vec![0.0; most];
        scratch.wide = vec![Lanes::splat(0.0); most];
        scratch
    }

    /// Forgets what is known: the state is another.
    #[inline(always)]
    pub(super) fn forget(&mut self) {
        self.is_known.fill(false);
    }
}

/// Computes the functions that a piece wants; on failure which of its functions is not finite, and for which trajectory.
pub(super) struct SetFunctions<'a, S> {
    pub(super) functions: &'a Functions,
    pub(super) piece: usize,
    pub(super) clock: Option<u32>,
    pub(super) x: &'a mut [S],
    pub(super) scratch: &'a mut FunctionScratch,
}

impl<S: Stored> Kernel<S> for SetFunctions<'_, S> {
    type Output = Result<(), (usize, usize)>;

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) -> Result<(), (usize, usize)> {
        let Self { x, scratch, .. } = self;
        for &(number, own) in &self.functions.pieces[self.piece].wanted {
            if scratch.is_known[number] {
                continue;
            }
            scratch.is_known[number] = true;
            let function = &self.functions.all[number];
            let is_shared =
                !S::IS_SINGLE && self.clock.is_some_and(|clock| function.from == [clock]);
            match &function.formula {
                FormulaAt::Wave(wave) => {
                    for (_, program) in wave.argument.iter() {
                        if is_shared {
                            wave.share(program, x);
                        } else {
                            views.one_narrow(&mut SetWave { wave, program, x });
                        }
                    }
                }
                FormulaAt::Tape { .. } => {
                    let set = function.set_tape(is_shared, x, scratch);
                    set.map_err(|member| (own, member))?;
                }
            }
        }
        Ok(())
    }
}

impl Wave {
    /// Computes it of the first trajectory for all.
    fn share<S: Stored>(&self, program: &[Code], x: &mut [S]) {
        let argument = evaluate(program, 0.0, &FirstMember(x));
        let (sine, cosine) = argument.sin_and_cos();
        for (place, value) in [(self.sine, sine), (self.cosine, cosine)] {
            if let Some(place) = place {
                x[place] = S::splat(value);
            }
        }
    }
}

/// The variables of the first trajectory.
struct FirstMember<'a, S>(&'a [S]);

impl<S: Stored> Variables for FirstMember<'_, S> {
    type Number = f64;

    fn load(&self, place: u32) -> f64 {
        self.0[place as usize].member(0)
    }
}

struct SetWave<'a, S> {
    wave: &'a Wave,
    program: &'a [Code],
    x: &'a mut [S],
}

impl<S> ForEach<S> for SetWave<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let argument = match self.wave.alone {
            Some(place) => view.load(self.x, place),
            None => value(view, self.program, self.x),
        };
        let (sine, cosine) = argument.sin_and_cos();
        if let Some(place) = self.wave.sine {
            view.store(self.x, place, sine);
        }
        if let Some(place) = self.wave.cosine {
            view.store(self.x, place, cosine);
        }
        true
    }
}
