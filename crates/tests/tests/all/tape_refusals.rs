//! A program that cannot be trusted is refused, with the line and the numbers that show it.

use liouville_base::tape::{Column, Line, Op, Tape, TapeError};

fn constant(slot: usize) -> Line {
    Line::Constant { slot, value: 1.0 }
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

fn refusal(inputs: &[usize], outputs: usize, lines: &[Line]) -> TapeError {
    Tape::new(inputs, outputs, lines).expect_err("the program is malformed")
}

#[test]
fn a_slot_beyond_the_lines_is_refused() {
    for slot in [2, 100, usize::MAX] {
        for line in [constant(slot), input(slot, 0, 0), add(slot, 0, 0)] {
            let wanted = TapeError::Slot {
                line: 1,
                slot,
                lines: 2,
            };
            assert_eq!(refusal(&[1], 0, &[constant(0), line]), wanted);
        }
    }
}

#[test]
fn an_unwritten_slot_is_not_read() {
    let unwritten = |slot| TapeError::Unwritten { line: 1, slot };
    assert_eq!(refusal(&[1], 0, &[constant(0), add(1, 1, 0)]), unwritten(1));
    assert_eq!(refusal(&[1], 0, &[constant(0), add(1, 0, 1)]), unwritten(1));
    assert_eq!(refusal(&[1], 1, &[constant(0), output(0, 1)]), unwritten(1));
    // a line does not see what it writes itself, nor slots that do not exist
    assert_eq!(refusal(&[1], 0, &[constant(0), add(0, 0, 9)]), unwritten(9));
    let far = usize::MAX;
    assert_eq!(
        refusal(&[1], 1, &[constant(0), output(0, far)]),
        unwritten(far)
    );
}

#[test]
fn an_input_that_does_not_exist_is_refused() {
    for (group, element) in [(0, 1), (1, 0), (2, 0), (usize::MAX, 0), (0, usize::MAX)] {
        let wanted = TapeError::Input {
            line: 0,
            group,
            element,
        };
        assert_eq!(refusal(&[1, 0], 0, &[input(0, group, element)]), wanted);
    }
    let wanted = TapeError::Input {
        line: 0,
        group: 0,
        element: 0,
    };
    assert_eq!(refusal(&[], 0, &[input(0, 0, 0)]), wanted);
}

#[test]
fn an_output_is_written_once_and_exists() {
    for element in [1, usize::MAX] {
        let wanted = TapeError::Output {
            line: 1,
            element,
            outputs: 1,
        };
        assert_eq!(refusal(&[0], 1, &[constant(0), output(element, 0)]), wanted);
    }
    let lines = [constant(0), output(0, 0), output(0, 0)];
    let wanted = TapeError::Twice {
        line: 2,
        element: 0,
    };
    assert_eq!(refusal(&[0], 1, &lines), wanted);
}

#[test]
fn an_operation_of_a_column_takes_a_constant_that_is_the_number_of_one() {
    let search = |b| Line::Apply {
        op: Op::Search,
        slot: 2,
        a: 0,
        b,
    };
    let number = |value| Line::Constant { slot: 1, value };
    let refused = |value, b| {
        let lines = [input(0, 0, 0), number(value), search(b)];
        let columns: Box<[Column]> = Box::from([Column::from([0.0, 1.0])]);
        Tape::with_columns(&[1], 0, &lines, columns).err()
    };
    let error = TapeError::Column {
        line: 2,
        op: "search",
        columns: 1,
    };
    assert_eq!(refused(0.0, 1), None);
    for (value, b) in [(1.0, 1), (-1.0, 1), (0.5, 1), (f64::NAN, 1), (0.0, 0)] {
        assert_eq!(refused(value, b), Some(error.clone()), "{value} {b}");
    }
}

#[test]
fn every_output_is_written() {
    let lines = [constant(0), output(0, 0), output(2, 0)];
    assert_eq!(refusal(&[0], 3, &lines), TapeError::Missing { element: 1 });
    for outputs in [1, 2, 1 << 20] {
        let refused = refusal(&[0], outputs, &[]);
        assert!(matches!(refused, TapeError::Missing { .. }), "{refused}");
    }
}

#[test]
fn a_program_too_large_for_its_registers_is_refused() {
    for inputs in [&[1 << 31][..], &[usize::MAX], &[usize::MAX, usize::MAX]] {
        assert_eq!(refusal(inputs, 0, &[]), TapeError::TooLarge);
    }
    assert_eq!(refusal(&[1], usize::MAX, &[]), TapeError::TooLarge);
}

#[test]
fn refusals_are_sentences_with_their_numbers() {
    let refused = refusal(&[1], 1, &[constant(0), output(0, 7)]);
    let wanted = "line 1 reads slot 7 before anything was written to it";
    assert_eq!(refused.to_string(), wanted);
}

#[test]
#[should_panic(expected = "registers of another tape")]
fn registers_of_another_tape_are_refused() {
    let small = Tape::new(&[1, 0], 1, &[input(0, 0, 0), output(0, 0)]).expect("a valid program");
    let large = Tape::new(&[2, 0], 1, &[input(0, 0, 1), output(0, 0)]).expect("a valid program");
    large.eval(&mut small.bind(&[]), [&[1.0, 2.0]]);
}

#[test]
#[should_panic(expected = "size of params")]
fn parameters_of_another_size_are_refused() {
    let tape = Tape::new(&[1, 2], 0, &[]).expect("a valid program");
    tape.bind(&[1.0]);
}

#[test]
#[should_panic(expected = "size of an argument")]
fn arguments_of_another_size_are_refused() {
    let tape = Tape::new(&[2, 0], 0, &[]).expect("a valid program");
    tape.eval(&mut tape.bind(&[]), [&[1.0]]);
}

#[test]
#[should_panic(expected = "number of arguments")]
fn another_number_of_arguments_is_refused() {
    let tape = Tape::new(&[0, 0], 0, &[]).expect("a valid program");
    tape.eval(&mut tape.bind::<f64>(&[]), []);
}
