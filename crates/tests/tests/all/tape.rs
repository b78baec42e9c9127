//! A tape does what its lines say, bit for bit, whatever the lines: plain, batched, in lanes and side by side, in one
//! file since nearly all are held against the same interpreter of the same programs.
//!
//! Miri runs it in five minutes, by `make sanitize`.

use liouville_base::real::{Lanes, WIDTH};
use liouville_base::tape::{Column, Line, Op, Tape};
use liouville_tests::meaning::{meaning, of_numbers};
use liouville_tests::properties::properties;
use proptest::prelude::*;
use std::ops::Range;

/// A program with three input groups, the last the parameters.
#[derive(Clone, Debug)]
struct Program {
    sizes: [usize; 3],
    outputs: usize,
    lines: Vec<Line>,
}

impl Program {
    fn tape(&self) -> Tape {
        Tape::new(&self.sizes, self.outputs, &self.lines).expect("a valid program")
    }

    /// Runs the lines one after another over slots, as they are written.
    ///
    /// `None` where the sign of a NaN would decide, which no floating-point standard fixes.
    fn interpret(&self, inputs: [&[f64]; 3]) -> Option<Vec<f64>> {
        let mut slots = vec![f64::NAN; self.lines.len()];
        let mut outputs = vec![f64::NAN; self.outputs];
        for line in &self.lines {
            match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => slots[slot] = inputs[group][element],
                Line::Constant { slot, value } => slots[slot] = value,
                Line::Apply { op, slot, a, b } => {
                    let b = if op.arity() == 2 { slots[b] } else { 0.0 };
                    if op == Op::Copysign && b.is_nan() {
                        return None;
                    }
                    slots[slot] = meaning(op, slots[a], b);
                }
                Line::Output { element, slot } => outputs[element] = slots[slot],
            }
        }
        Some(outputs)
    }
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn all_same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(*a, *b))
}

/// One value in a program before it is known which slots can be read.
type Gene = (usize, usize, usize, usize, f64);

fn value() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -4.0..4.0,
        1 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 2.0, 0.5, f64::INFINITY, f64::NAN]),
        1 => any::<f64>(),
    ]
}

fn gene() -> impl Strategy<Value = Gene> {
    (
        0..16_usize,
        0..1000_usize,
        0..1000_usize,
        0..1000_usize,
        value(),
    )
}

/// Valid programs: slots reused, outputs written anywhere, from inputs, constants and one slot twice.
fn programs() -> impl Strategy<Value = Program> {
    let shape = ([0..4_usize, 0..4_usize, 0..4_usize], 0..5_usize, 1..6_usize);
    (shape, prop::collection::vec(gene(), 6..60)).prop_map(|((sizes, outputs, pool), genes)| {
        let elements: Vec<(usize, usize)> = (0..3)
            .flat_map(|group| (0..sizes[group]).map(move |element| (group, element)))
            .collect();
        let mut missing: Vec<usize> = (0..outputs).collect();
        let mut written: Vec<usize> = Vec::new();
        let mut lines = Vec::new();
        for (kind, x, y, z, value) in genes {
            let slot = z % pool;
            let line = match kind {
                0..3 if !elements.is_empty() => {
                    let (group, element) = elements[x % elements.len()];
                    Line::Input {
                        slot,
                        group,
                        element,
                    }
                }
                3..=5 if !written.is_empty() && !missing.is_empty() => {
                    lines.push(Line::Output {
                        element: missing.swap_remove(x % missing.len()),
                        slot: written[y % written.len()],
                    });
                    continue;
                }
                6.. if !written.is_empty() => {
                    let op = of_numbers()[x % of_numbers().len()];
                    let b = written[(y / 7) % written.len()];
                    Line::Apply {
                        op,
                        slot,
                        a: written[y % written.len()],
                        // an operation of one operand must not look at its second
                        b: if op.arity() == 2 { b } else { usize::MAX - x },
                    }
                }
                _ => Line::Constant { slot, value },
            };
            lines.push(line);
            if !written.contains(&slot) {
                written.push(slot);
            }
        }
        lines.extend(missing.iter().map(|&element| Line::Output {
            element,
            slot: written[element % written.len()],
        }));
        Program {
            sizes,
            outputs,
            lines,
        }
    })
}

/// Eight points, each with inputs of 3 + 3 + 3 elements, of which a program uses the first ones.
fn points() -> impl Strategy<Value = Vec<[[f64; 3]; 3]>> {
    prop::collection::vec(prop::array::uniform3(prop::array::uniform3(value())), WIDTH)
}

fn cut<'a>(program: &Program, point: &'a [[f64; 3]; 3]) -> [&'a [f64]; 3] {
    [0, 1, 2].map(|group| &point[group][..program.sizes[group]])
}

/// A program over again for each of many links, with its inputs and outputs side by side, parameters in
/// common. Two of three operations of two operands are arithmetic, and of those some read the link before or
/// one far back: there are sets of slots for half of the links, taken in turn.
fn repeated(program: &Program, links: usize) -> Program {
    let [x, y, params] = program.sizes;
    let pool = program.lines.iter().map(|line| match *line {
        Line::Input { slot, .. } | Line::Constant { slot, .. } | Line::Apply { slot, .. } => {
            slot + 1
        }
        Line::Output { .. } => 0,
    });
    let pool = pool.max().unwrap_or(0);
    let lines = (0..links).flat_map(|link| {
        let at = move |link: usize, slot: usize| slot + pool * (link % (links / 2 + 1));
        let other = move |k: usize| match k % 6 {
            0 => link.saturating_sub(1),
            1 => link.saturating_sub(links / 3),
            _ => link,
        };
        let arithmetic = move |k: usize, op: Op| match (op.arity(), k % 6) {
            (2, 0 | 2) => Op::Sub,
            (2, 1) => Op::Add,
            (2, 3) => Op::Mul,
            _ => op,
        };
        program
            .lines
            .iter()
            .enumerate()
            .map(move |(k, line)| match *line {
                Line::Input {
                    slot,
                    group,
                    element,
                } => Line::Input {
                    slot: at(link, slot),
                    group,
                    element: if group < 2 {
                        element + link * [x, y][group]
                    } else {
                        element
                    },
                },
                Line::Constant { slot, value } => Line::Constant {
                    slot: at(link, slot),
                    value,
                },
                Line::Apply { op, slot, a, b } => Line::Apply {
                    op: arithmetic(k, op),
                    slot: at(link, slot),
                    a: at(link, a),
                    b: if op.arity() == 2 { at(other(k), b) } else { b },
                },
                Line::Output { element, slot } => Line::Output {
                    element: element + link * program.outputs,
                    slot: at(link, slot),
                },
            })
    });
    Program {
        sizes: [x * links, y * links, params],
        outputs: program.outputs * links,
        lines: lines.collect(),
    }
}

proptest! {
    #![proptest_config(properties(100))]

    #[test]
    fn a_long_tape_has_the_bits_of_its_lines(
        program in programs(),
        links in prop_oneof![4 => 5..60_usize, 1 => 200..400_usize],
        values in prop::collection::vec(value(), 97),
    ) {
        let program = repeated(&program, if cfg!(miri) { links.min(20) } else { links });
        let tape = program.tape();
        let inputs = |from: usize| program.sizes.map(|size| {
            values.iter().copied().cycle().skip(from + size).take(size).collect::<Vec<_>>()
        });
        let members: [_; WIDTH] = std::array::from_fn(inputs);
        let lanes = |group: usize| -> Vec<Lanes> {
            (0..program.sizes[group])
                .map(|element| Lanes(std::array::from_fn(|i| members[i][group][element])))
                .collect()
        };
        let mut together = tape.bind(&lanes(2));
        let together = tape.eval(&mut together, [&lanes(0), &lanes(1)]);
        for (i, [x, y, params]) in members.iter().enumerate() {
            if let Some(wanted) = program.interpret([x, y, params]) {
                let mut alone = tape.bind(params);
                prop_assert!(all_same(tape.eval(&mut alone, [x, y]), &wanted));
                prop_assert!(all_same(tape.eval(&mut alone, [x, y]), &wanted), "a second time");
                let member: Vec<f64> = together.iter().map(|lanes| lanes.0[i]).collect();
                prop_assert!(all_same(&member, &wanted), "lane {i}");
            }
        }
    }
}

proptest! {
    #![proptest_config(properties(1000))]

    #[test]
    fn a_tape_has_the_bits_of_its_lines(program in programs(), points in points()) {
        let tape = program.tape();
        for bound in &points[..2] {
            let params = cut(&program, bound)[2];
            let mut registers = tape.bind(params);
            for point in &points {
                let [x, y, _] = cut(&program, point);
                let values = tape.eval(&mut registers, [x, y]);
                if let Some(wanted) = program.interpret([x, y, params]) {
                    prop_assert!(all_same(values, &wanted), "{values:?} for {wanted:?}");
                }
            }
        }
    }

    #[test]
    fn every_lane_has_the_bits_of_one_number(program in programs(), points in points()) {
        let tape = program.tape();
        let lanes = |group: usize| -> Vec<Lanes> {
            (0..program.sizes[group])
                .map(|element| Lanes(std::array::from_fn(|i| points[i][group][element])))
                .collect()
        };
        // parameters may differ from lane to lane as well
        let mut registers = tape.bind(&lanes(2));
        let values = tape.eval(&mut registers, [&lanes(0), &lanes(1)]);
        for (i, point) in points.iter().enumerate() {
            if let Some(wanted) = program.interpret(cut(&program, point)) {
                let values: Vec<f64> = values.iter().map(|lanes| lanes.0[i]).collect();
                prop_assert!(all_same(&values, &wanted), "lane {i}: {values:?} for {wanted:?}");
            }
        }
    }

    #[test]
    fn a_map_is_the_tape_at_each_point(program in programs(), points in points(), k in 0..20_usize) {
        let tape = program.tape();
        let at = |i: usize| cut(&program, &points[i % WIDTH]);
        let params = at(0)[2];
        let rows = |group: usize| (0..k).flat_map(|i| at(i)[group].iter().copied()).collect::<Vec<_>>();
        let values = tape.map(params, &[&rows(0), &rows(1)], k);
        prop_assert_eq!(values.len(), k * program.outputs);
        for i in 0..k {
            if let Some(wanted) = program.interpret([at(i)[0], at(i)[1], params]) {
                let values = &values[i * program.outputs..(i + 1) * program.outputs];
                prop_assert!(all_same(values, &wanted), "point {i}: {values:?} for {wanted:?}");
            }
        }
    }

    #[test]
    fn garbage_is_refused_or_runs(
        sizes in prop::collection::vec(index(0..4), 0..4),
        outputs in index(0..4),
        lines in prop::collection::vec(line(), 0..24),
    ) {
        if let Ok(tape) = Tape::new(&sizes, outputs, &lines) {
            run(&tape);
        }
    }

    #[test]
    fn a_damaged_program_is_refused_or_runs(
        program in programs(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), line()), 0..4),
        outputs in prop::option::weighted(0.1, index(0..4)),
    ) {
        let mut lines = program.lines;
        for (place, line) in damage {
            *place.get_mut(&mut lines) = line;
        }
        if let Ok(tape) = Tape::new(&program.sizes, outputs.unwrap_or(program.outputs), &lines) {
            run(&tape);
        }
    }
}

/// Evaluates a tape nobody knows, if it is no larger than a test should be.
fn run(tape: &Tape) {
    if let [x, y, params] = *tape.inputs()
        && x.max(y).max(params) < 100
    {
        let values = [0.5; 900];
        let mut registers = tape.bind(&values[..params]);
        tape.eval(&mut registers, [&values[..x], &values[..y]]);
        tape.map(&values[..params], &[&values[..9 * x], &values[..9 * y]], 9);
    }
}

/// Mostly small, sometimes anything.
fn index(small: Range<usize>) -> impl Strategy<Value = usize> {
    prop_oneof![30 => small, 1 => any::<usize>(), 1 => Just(usize::MAX)]
}

fn line() -> impl Strategy<Value = Line> {
    let small = || index(0..4);
    prop_oneof![
        (small(), small(), small()).prop_map(|(slot, group, element)| Line::Input {
            slot,
            group,
            element
        }),
        (small(), value()).prop_map(|(slot, value)| Line::Constant { slot, value }),
        (0..Op::ALL.len(), small(), small(), small()).prop_map(|(op, slot, a, b)| Line::Apply {
            op: Op::ALL[op],
            slot,
            a,
            b
        }),
        (small(), small()).prop_map(|(element, slot)| Line::Output { element, slot }),
    ]
}

fn add(slot: usize, a: usize, b: usize) -> Line {
    Line::Apply {
        op: Op::Add,
        slot,
        a,
        b,
    }
}

fn output(element: usize, slot: usize) -> Line {
    Line::Output { element, slot }
}

fn input(slot: usize, group: usize, element: usize) -> Line {
    Line::Input {
        slot,
        group,
        element,
    }
}

#[test]
fn what_depends_on_parameters_alone_is_not_evaluated_again() {
    // (x + p * p, p * p), with p the parameter
    let lines = [
        input(0, 1, 0),
        Line::Apply {
            op: Op::Mul,
            slot: 1,
            a: 0,
            b: 0,
        },
        output(1, 1),
        input(0, 0, 0),
        add(0, 0, 1),
        output(0, 0),
    ];
    let tape = Tape::new(&[1, 1], 2, &lines).expect("a valid program");
    assert_eq!(
        (tape.inputs(), tape.outputs(), tape.len()),
        (&[1, 1][..], 2, 1)
    );
    let mut registers = tape.bind(&[3.0]);
    for x in [0.5, -8.0, 0.0] {
        assert_eq!(tape.eval(&mut registers, [&[x]]), [x + 9.0, 9.0]);
    }
    assert!(!tape.is_empty());
}

#[test]
fn a_tape_of_parameters_alone_is_empty() {
    let tape = Tape::new(
        &[1],
        2,
        &[input(0, 0, 0), output(1, 0), add(0, 0, 0), output(0, 0)],
    );
    let tape = tape.expect("a valid program");
    assert!(tape.is_empty());
    assert_eq!(tape.eval(&mut tape.bind(&[2.5]), []), [5.0, 2.5]);
    assert_eq!(tape.map(&[2.5], &[], 3), [5.0, 2.5, 5.0, 2.5, 5.0, 2.5]);
}

#[test]
fn blocks_of_eight_end_anywhere() {
    let lines = [input(0, 0, 1), input(1, 0, 0), add(0, 0, 1), output(0, 0)];
    let tape = Tape::new(&[2, 0], 1, &lines).expect("a valid program");
    for k in [0, 1, 7, 8, 9, 17] {
        let rows: Vec<f64> = (0..2 * k).map(|i| f64::from(i).sqrt()).collect();
        let wanted: Vec<f64> = rows.chunks(2).map(|row| row[0] + row[1]).collect();
        let k = usize::try_from(k).expect("not negative");
        assert_eq!(tape.map(&[], &[&rows], k), wanted);
    }
}

#[test]
fn codes_are_positions_in_the_list_of_operations() {
    for (code, op) in Op::ALL.iter().enumerate() {
        assert_eq!(*op as usize, code);
        assert!((1..=2).contains(&op.arity()));
        assert_eq!(Op::ALL.iter().filter(|o| o.name() == op.name()).count(), 1);
    }
}

#[test]
fn what_is_needed_far_ahead_is_kept() {
    const LINKS: usize = 3000;
    const HALF: usize = 2 * LINKS;
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let mut lines = vec![Line::Constant {
        slot: HALF,
        value: 0.5,
    }];
    for link in 0..LINKS {
        let (x, y, before) = (2 * link, 2 * link + 1, link.saturating_sub(1));
        lines.extend([
            input(x, 0, link),
            apply(Op::Sub, y, x, 2 * before),
            apply(Op::Mul, y, y, HALF),
            apply(Op::Mul, HALF + 1, y, 2 * (link / 3) + 1), // of a link far back
            apply(Op::Add, HALF + 1, HALF + 1, x),
            output(link, HALF + 1),
        ]);
    }
    let program = Program {
        sizes: [LINKS, 0, 0],
        outputs: LINKS,
        lines,
    };
    let x: Vec<f64> = (0..LINKS).map(|k| (k as f64).sin()).collect();
    let tape = program.tape();
    let mut registers = tape.bind(&[]);
    let wanted = program.interpret([&x, &[], &[]]).expect("numbers");
    for _ in 0..2 {
        assert_eq!(tape.eval(&mut registers, [&x, &[]]), wanted);
    }
}

#[test]
fn points_side_by_side_have_the_bits_of_each_alone() {
    const POINTS: usize = 11; // a whole pass and a part of one
    let (t, y, lam, scale, acc) = (0, 1, 2, 3, 4);
    let input = |slot, group, element| Line::Input {
        slot,
        group,
        element,
    };
    let apply = |op, a, b| Line::Apply {
        op,
        slot: acc,
        a,
        b,
    };
    let mut lines = vec![
        input(t, 0, 0),
        input(y, 1, 1),
        input(lam, 2, 0),
        input(scale, 3, 0),
        apply(Op::Mul, y, scale),
    ];
    for round in [t, y, lam].repeat(12) {
        lines.extend([apply(Op::Add, acc, round), apply(Op::Sin, acc, acc)]);
    }
    let output = |element, slot| Line::Output { element, slot };
    lines.extend([output(0, acc), apply(Op::Div, acc, lam), output(1, acc)]);
    let tape = Tape::new(&[1, 2, 1, 1], 2, &lines).expect("a valid program");
    let mut one = tape.bind(&[0.7]);
    let mut batch = tape.batch(&one, POINTS).expect("long enough");
    let value = |k: usize| (1.0 + k as f64).sqrt() - 2.0;
    let (ys, lams): (Vec<f64>, Vec<f64>) = (
        (0..2 * POINTS).map(value).collect(),
        (0..POINTS).map(|k| 3.0 * value(k)).collect(),
    );
    for start in [0.0, 1e6] {
        let time = |k: usize| start + 0.1 * k as f64;
        tape.eval_batch(&mut batch, time, [&ys, &lams]);
        for k in 0..POINTS {
            let args = [&[time(k)], &ys[2 * k..][..2], &lams[k..][..1]];
            let wanted = tape.eval(&mut one, args);
            assert_eq!(batch.at(k, 2), wanted, "point {k}");
        }
    }
}

/// 1 of x, 2 of y: the starts 0, 1 and 2 with four numbers, which are also looked up at constants and parameters.
fn of_columns() -> Tape {
    let columns = [vec![0.0, 1.0, 2.0], vec![3.0, -5.0, 7.0, 0.5]].map(Column::from);
    let apply = |op, slot, a, b| Line::Apply { op, slot, a, b };
    let number = |slot, value| Line::Constant { slot, value };
    let mut lines = vec![number(0, 0.0), number(1, 1.0)];
    for (k, group) in [0, 1, 2].into_iter().enumerate() {
        lines.extend([
            input(2, group, 0),
            apply(Op::Search, 3, 2, 0),
            apply(Op::Entry, 3, 3, 1),
            apply(Op::Mul, 3, 3, 2),
            output(k, 3),
        ]);
    }
    Tape::with_columns(&[1, 1, 1], 3, &lines, Box::from(columns)).expect("a valid program")
}

#[test]
fn numbers_of_a_column_are_looked_up_alone_and_side_by_side() {
    let looked_up = |x: f64| match x {
        x if x < 0.0 => 3.0 * x,
        x if x < 1.0 => -5.0 * x,
        x if x < 2.0 => 7.0 * x,
        x if x >= 2.0 => 0.5 * x,
        _ => f64::NAN,
    };
    let (tape, param) = (of_columns(), 1.5);
    let at = [-1e300, -0.1, -0.0, 0.0, 0.999, 1.0, 1.5, 2.0, 9.0, f64::NAN];
    let mut one = tape.bind(&[param]);
    assert_eq!(tape.len(), 6, "what depends on parameters alone runs once");
    let mirrored: Vec<f64> = at.iter().map(|x| -x).collect();
    let rows = tape.map(&[param], &[&at, &mirrored], at.len());
    let mut points = tape.at_points(&one, at.len(), |x| x).expect("a short one");
    points.argument(0).copy_from_slice(&at);
    points.argument(1).copy_from_slice(&mirrored);
    tape.run_points(&mut points);
    for (k, (x, y)) in at.into_iter().zip(mirrored).enumerate() {
        let wanted = [looked_up(x), looked_up(y), looked_up(param)];
        assert!(all_same(tape.eval(&mut one, [&[x], &[y]]), &wanted), "{x}");
        assert!(all_same(&rows[3 * k..][..3], &wanted), "{x} in lanes");
        let found = [0, 1, 2].map(|place| points.value(place)[k]);
        assert!(all_same(&found, &wanted), "{x} beside others");
    }
}
