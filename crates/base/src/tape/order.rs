//! The order of a program: the same operation on many values, one after another or at once.
//!
//! Jumps from one operation to the next take more time than most operations. So a program is cut into
//! windows, whose values fit the cache next to the processor, and within a window instructions are
//! ordered by how deep their expressions are, then by operation and by the shape of the expression.
//! The program of a large mechanism repeats a few operations for each link; results get registers side
//! by side, so that most of it walks through the registers with constant strides and runs in batches.
//! Each value is made by the same operation from the same operands, hence with the same bits.

use super::execute::{Cheap, Instr, Strided};
use super::program::{Program, ProgramStep};
use std::ops::Range;

/// Instructions of a window.
const WINDOW: usize = 4096;

/// Instructions that make a batch worth its loop.
const ENOUGH: usize = 8;

/// Components of vectors whose instructions are distinguished.
const MOST_COMPONENTS: usize = 4;

/// Orders a body, whose results but for its outputs are in `temporaries`. Returns it with the number of
/// registers that it then takes; `None` if it is long and that would save little, or cost much memory.
pub(super) fn ordered(
    body: &[Instr],
    groups: &[Range<usize>],
    outputs: &Range<usize>,
    temporaries: Range<usize>,
) -> Option<(Program, usize)> {
    let first = temporaries.start;
    let read = Reading::new(body, groups, outputs);
    let windows = (0..body.len())
        .step_by(WINDOW)
        .map(|from| from..(from + WINDOW).min(body.len()));
    let passing = |window: Range<usize>| window.filter(|k| read.home[*k] == Home::SimdView).count();
    let most = windows.clone().map(passing).max().unwrap_or(0);
    let mut writing = Writing {
        read: &read,
        body,
        placed: vec![0; body.len()],
        next: [first, first + most],
        instrs: Vec::new(),
        steps: Vec::new(),
    };
    for window in windows {
        writing.next[0] = first;
        writing.window(window);
    }
    let (instrs, steps) = (writing.instrs, writing.steps);
    let jumps = jumps(&instrs) + 2 * steps.len();
    let is_dear = writing.next[1] > 2 * temporaries.end + WINDOW;
    if body.len() > WINDOW && (4 * jumps > 3 * self::jumps(body) || is_dear) {
        return None;
    }
    let program = match steps[..] {
        [] | [ProgramStep::Mixed(_)] => Program::Plain(instrs),
        _ => Program::Batched { instrs, steps },
    };
    Some((program, writing.next[1]))
}

/// How often the operation changes.
fn jumps(instrs: &[Instr]) -> usize {
    let pairs = instrs.windows(2);
    pairs.filter(|pair| pair[0].op != pair[1].op).count()
}

/// Where an operand comes from.
#[derive(Clone, Copy)]
enum Source {
    /// A register that the body does not write.
    Given(u32),
    /// The result of an earlier instruction.
    Made(u32),
}

/// Where a result goes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Home {
    /// The output's register.
    Output,
    /// A register that the next window uses again.
    SimdView,
    /// A register of its own.
    Own,
}

/// Properties of each instruction of a body.
struct Reading {
    operands: Vec<[Source; 2]>,
    /// The depth of its expression, counted from values of earlier windows.
    level: Vec<u32>,
    /// Fixed for the same operations on elements of the same inputs and on the same constants.
    shape: Vec<u64>,
    home: Vec<Home>,
}

impl Reading {
    fn new(body: &[Instr], groups: &[Range<usize>], outputs: &Range<usize>) -> Self {
        let home = |instr: &Instr| {
            if outputs.contains(&(instr.out as usize)) {
                Home::Output
            } else {
                Home::SimdView
            }
        };
        let mut read = Self {
            operands: Vec::with_capacity(body.len()),
            level: vec![0; body.len()],
            shape: vec![0; body.len()],
            home: body.iter().map(home).collect(),
        };
        let most = body.iter().map(|instr| instr.out).max().unwrap_or(0);
        let mut writers: Vec<Option<u32>> = vec![None; most as usize + 1];
        for (k, instr) in body.iter().enumerate() {
            let mut shape = instr.op as u64;
            let operands = [instr.a, instr.b].map(|register| {
                let Some(&Some(by)) = writers.get(register as usize) else {
                    shape = mixed(shape, given(register, groups));
                    return Source::Given(register);
                };
                shape = mixed(shape, read.shape[by as usize]);
                read.needs(k, by as usize);
                Source::Made(by)
            });
            read.operands.push(operands);
            read.shape[k] = shape;
            #[allow(clippy::cast_possible_truncation)] // instructions are numbered in 32 bits
            let k = k as u32;
            writers[instr.out as usize] = Some(k);
        }
        read
    }

    fn needs(&mut self, k: usize, by: usize) {
        if by / WINDOW == k / WINDOW {
            self.level[k] = self.level[k].max(self.level[by] + 1);
        } else if self.home[by] == Home::SimdView {
            self.home[by] = Home::Own;
        }
    }
}

/// The shape of an operand from outside a body: elements of an input are alike, constants are not.
fn given(register: u32, groups: &[Range<usize>]) -> u64 {
    let group = groups
        .iter()
        .position(|group| group.contains(&(register as usize)));
    group.map_or(u64::from(register) << 32, |group| group as u64)
}

/// A hash of a number that follows another.
fn mixed(hash: u64, x: u64) -> u64 {
    let x = (hash.rotate_left(23) ^ x ^ 0x9e37_79b9_7f4a_7c15).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (x ^ (x >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb)
}

/// The output of batches.
struct Writing<'a> {
    read: &'a Reading,
    body: &'a [Instr],
    /// The register of each result so far.
    placed: Vec<u32>,
    /// The next registers of the window, and of those that are not used again.
    next: [usize; 2],
    instrs: Vec<Instr>,
    steps: Vec<ProgramStep>,
}

impl Writing<'_> {
    fn window(&mut self, window: Range<usize>) {
        let (read, body) = (self.read, self.body);
        let alike = |k: &usize| {
            (
                read.level[*k],
                body[*k].op as u32,
                read.shape[*k],
                read.home[*k],
            )
        };
        let mut order: Vec<usize> = window.collect();
        order.sort_by_cached_key(alike);
        for level in order.chunk_by_mut(|j, k| read.level[*j] == read.level[*k]) {
            let mut rest = Vec::new();
            for group in level.chunk_by_mut(|j, k| alike(j) == alike(k)) {
                group.sort_by_cached_key(|k| (self.operands(*k), *k));
                let instrs: Vec<Instr> = group.iter().map(|k| self.place(*k)).collect();
                self.strided(&instrs, &mut rest);
            }
            self.listed(&rest);
        }
    }

    fn operands(&self, k: usize) -> [u32; 2] {
        self.read.operands[k].map(|source| match source {
            Source::Given(register) => register,
            Source::Made(by) => self.placed[by as usize],
        })
    }

    /// The instruction with its new registers.
    fn place(&mut self, k: usize) -> Instr {
        let instr = self.body[k];
        let own = match self.read.home[k] {
            Home::Output => None,
            Home::SimdView => Some(0),
            Home::Own => Some(1),
        };
        #[allow(clippy::cast_possible_truncation)] // registers are numbered in 32 bits
        let out = own.map_or(instr.out, |own| {
            self.next[own] += 1;
            (self.next[own] - 1) as u32
        });
        self.placed[k] = out;
        let [a, b] = self.operands(k);
        Instr { out, a, b, ..instr }
    }

    /// Writes batches of strides; instructions in none go to the rest. Instructions that walk in threes,
    /// say, are the components of vectors side by side.
    fn strided(&mut self, instrs: &[Instr], rest: &mut Vec<Instr>) {
        let Some(op) = Cheap::of(instrs[0].op) else {
            rest.extend(instrs);
            return;
        };
        let every = |period: usize| -> Vec<Instr> {
            let phases = (0..period.min(instrs.len()))
                .flat_map(|phase| instrs[phase..].iter().step_by(period));
            phases.copied().collect()
        };
        let walking = |period: &usize| {
            let instrs = every(*period);
            let counts = walks(&instrs).map(<[Instr]>::len);
            counts.filter(|count| *count >= ENOUGH).sum::<usize>()
        };
        let period = (1..=MOST_COMPONENTS).rev().max_by_key(walking);
        for walk in walks(&every(period.unwrap_or(1))) {
            if walk.len() < ENOUGH {
                rest.extend(walk);
                continue;
            }
            self.steps.push(ProgramStep::Strided(Strided {
                op,
                first: walk[0],
                strides: strides(walk),
                count: walk.len(),
            }));
        }
    }

    /// Writes instructions out.
    fn listed(&mut self, rest: &[Instr]) {
        let from = self.instrs.len();
        self.instrs.extend(rest);
        let end = self.instrs.len();
        match self.steps.last_mut() {
            Some(ProgramStep::Mixed(last)) => last.end = end,
            _ if from < end => self.steps.push(ProgramStep::Mixed(from..end)),
            _ => {}
        }
    }
}

/// How far the second instruction's registers are from the first one's.
#[allow(clippy::cast_possible_wrap)] // there are less than 2^31 registers
fn strides(instrs: &[Instr]) -> [i32; 3] {
    let far = |from: u32, to: u32| to as i32 - from as i32;
    let (x, y) = (instrs[0], instrs[1]);
    [far(x.out, y.out), far(x.a, y.a), far(x.b, y.b)]
}

/// Cuts instructions where their registers stop walking with the strides that they started with.
fn walks(instrs: &[Instr]) -> impl Iterator<Item = &[Instr]> {
    let mut left = instrs;
    std::iter::from_fn(move || {
        let pairs = left.windows(2);
        let same = pairs
            .take_while(|pair| strides(pair) == strides(left))
            .count();
        let (walk, after) = left.split_at((same + 1).min(left.len()));
        left = after;
        (!walk.is_empty()).then_some(walk)
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Line, Op, Tape};
    use super::{Program, ProgramStep};

    /// |r_i − r_{i−1}|² of a chain, and its derivatives.
    fn chain(links: usize) -> Tape {
        let mut lines = Vec::new();
        for link in 0..links {
            let [x, y, before_x, before_y] = [0, 1, 2, 3].map(|k| (4 * link + k) % 8);
            let input = |slot, element| Line::Input {
                slot,
                group: 0,
                element,
            };
            let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
            let output = |k, slot| Line::Output {
                element: 3 * link + k,
                slot,
            };
            let before = link.saturating_sub(1);
            lines.extend([
                input(x, 2 * link),
                input(y, 2 * link + 1),
                input(before_x, 2 * before),
                input(before_y, 2 * before + 1),
                apply(Op::Sub, x, x, before_x),
                apply(Op::Sub, y, y, before_y),
                apply(Op::Twice, before_x, x, x),
                output(1, before_x),
                apply(Op::Twice, before_y, y, y),
                output(2, before_y),
                apply(Op::Sq, x, x, x),
                apply(Op::Sq, y, y, y),
                apply(Op::Add, x, x, y),
                output(0, x),
            ]);
        }
        Tape::new(&[2 * links, 0], 3 * links, &lines).expect("a valid program")
    }

    #[test]
    fn a_chain_runs_in_strides() {
        let tape = chain(2000);
        let Program::Batched { instrs, steps } = &tape.body else {
            panic!("the program of a long chain in batches");
        };
        assert!(20 * instrs.len() < tape.len(), "{} left over", instrs.len());
        assert!(100 * steps.len() < tape.len(), "{} steps", steps.len());
        assert!(
            steps
                .iter()
                .any(|step| matches!(step, ProgramStep::Strided(_)))
        );
        assert!(tape.registers < 7 * 2000 + super::WINDOW);
    }

    #[test]
    fn a_short_program_runs_operation_by_operation() {
        let Program::Plain(instrs) = &chain(3).body else {
            panic!("a program without batches");
        };
        assert_eq!(super::jumps(instrs), 3); // Sub, Sq, Twice, Add
    }
}
