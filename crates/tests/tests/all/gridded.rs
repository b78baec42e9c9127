//! Planes of fields, by splines and by programs: their flows and adjoints, and what makes no plane.

use liouville_base::real::{Lanes, Scalar};
use liouville_base::simd::InstructionSet;
use liouville_gridded::{
    Basis, Bounds, Fault, Malformed, Memory, Plane, PlaneFlow, Spline, Traced,
};
use liouville_tests::{Expr, input, tape};
use std::sync::Arc;

/// The cubic functions of a periodic axis with cells of width one, by powers of s.
const CUBIC: [f64; 16] = [
    1.0 / 6.0,
    4.0 / 6.0,
    1.0 / 6.0,
    0.0,
    -0.5,
    0.0,
    0.5,
    0.0,
    0.5,
    -1.0,
    0.5,
    0.0,
    -1.0 / 6.0,
    0.5,
    -0.5,
    1.0 / 6.0,
];

fn axis(cells: usize, bounds: Bounds) -> Result<Basis, Malformed> {
    let edges: Vec<f64> = (0..=cells).map(|k| k as f64).collect();
    let origin = edges[..cells].to_vec();
    Basis::new(edges, 3, CUBIC.to_vec(), vec![0; cells], origin, bounds)
}

/// F = Σ sin(3 i + 5 j) B_i(v) B_j(w) on a periodic square of eight cells.
fn plane(bounds: Bounds) -> Plane {
    let coefficient = |k: usize| (3.0 * (k / 11 % 8) as f64 + 5.0 * (k % 11 % 8) as f64).sin();
    let coefficients = (0..121).map(coefficient).collect();
    let axes = [8, 8].map(|cells| axis(cells, bounds).expect("an axis"));
    let spline = Spline::new(Vec::new(), axes, coefficients, [vec![0.1], vec![0.0]]);
    Plane::Spline(Box::new(spline.expect("a plane")))
}

/// F = p sin(v + w) + v w² by programs.
fn traced(p: f64) -> Plane {
    let (v, w) = (input(0, 0), input(0, 1));
    let f = (&v + &w).sin() * input(1, 0) + &v * &w * &w;
    let by = |x: &Expr| [x.d(0, 0), x.d(0, 1)];
    let [f_v, f_w] = by(&f);
    let ([f_vv, f_vw], [_, f_ww]) = (by(&f_v), by(&f_w));
    let by_p = [f_v.d(1, 0), f_w.d(1, 0)];
    let slopes = [f_v.clone(), f_w.clone(), f_vw.clone()];
    let jet: Vec<Expr> = [f_v, f_w, f_vv, f_vw, f_ww]
        .into_iter()
        .chain(by_p)
        .collect();
    let [value, slopes, jet] =
        [&[f][..], &slopes, &jet].map(|outputs| Arc::new(tape([2, 1], outputs)));
    let made = Traced::new(0, value, slopes, jet, vec![p], false);
    Plane::Traced(made.expect("a plane"))
}

fn flow_of<'a>(
    plane: &'a Plane,
    memory: &'a mut Memory<f64>,
    x: &'a mut [f64; 4],
    (is_adjoint, h): (bool, f64),
) -> PlaneFlow<'a, f64> {
    PlaneFlow {
        plane,
        memory,
        x,
        is_adjoint,
        h,
    }
}

fn flow(plane: &Plane, x: [f64; 2], is_adjoint: bool, h: f64) -> Result<[f64; 2], Fault> {
    let mut memory = plane.memory();
    let mut x = [x[0], x[1], 0.0, 0.0];
    let mut made = flow_of(plane, &mut memory, &mut x, (is_adjoint, h));
    let moved = made.run(InstructionSet::default());
    moved.map_err(|(fault, _)| fault)?;
    Ok([x[0], x[1]])
}

#[test]
fn an_adjoint_undoes_its_flow_across_cells_and_periods() {
    let plane = plane(Bounds::Periodic);
    for (h, start) in [(0.3, [0.2, 7.9]), (-0.4, [15.97, -8.01]), (0.7, [3.0, 4.0])] {
        let there = flow(&plane, start, false, h).expect("a flow");
        let back = flow(&plane, there, true, -h).expect("a flow");
        assert!((back[0] - start[0]).abs() < 1e-13 && (back[1] - start[1]).abs() < 1e-13);
        assert!((there[0] - start[0]).hypot(there[1] - start[1]) > 0.05);
    }
}

#[test]
fn a_flow_by_programs_solves_its_equation_and_is_undone() {
    let (plane, p) = (traced(0.7), 0.7);
    for (h, start) in [(0.2, [0.4, -0.9]), (-0.15, [0.0, 1.2]), (0.1, [0.0, 0.0])] {
        let there = flow(&plane, start, false, h).expect("a flow");
        let [v0, w0] = start;
        let [v1, w1] = there;
        // w1 = w0 − h F_v(v0, w1), v1 = v0 + h F_w(v0, w1)
        let slope = p * (v0 + w1).cos();
        assert!((w1 - w0 + h * (slope + w1 * w1)).abs() < 1e-15);
        assert!((v1 - v0 - h * (slope + 2.0 * v0 * w1)).abs() < 1e-15);
        let back = flow(&plane, there, true, -h).expect("a flow");
        assert!((back[0] - v0).abs() < 1e-15 && (back[1] - w0).abs() < 1e-15);
    }
}

#[test]
fn an_equation_without_a_solution_is_no_flow() {
    // w1 = w0 - h (cos w1 p + w1²) has none near 0 for h = -1 and large p
    let fault = flow(&traced(9.0), [0.0, 0.0], false, -1.0);
    assert!(matches!(fault, Err(Fault::NotConverged(_))), "{fault:?}");
    let far = flow(&traced(0.7), [1e200, 1e200], false, 0.1);
    assert!(
        matches!(far, Err(Fault::NotFinite | Fault::NotConverged(_))),
        "{far:?}"
    );
}

#[test]
fn the_derivative_of_a_flow_is_that_of_its_differences_and_has_determinant_one() {
    has_its_derivative(&plane(Bounds::Periodic), 0.6, 1e-3);
    // its fifth derivative by h is 5e7
    has_its_derivative(&traced(0.7), 0.1, 1e-4);
}

fn has_its_derivative(plane: &Plane, h: f64, d: f64) {
    let start = [0.9, 2.4];
    for is_adjoint in [false, true] {
        let (mut memory, mut columns) = (plane.memory(), Vec::new());
        let before = [start[0], start[1], 0.0, 0.0];
        let mut x = before;
        let mut made = flow_of(plane, &mut memory, &mut x, (is_adjoint, h));
        made.run(InstructionSet::default()).expect("a flow");
        let after = [made.x[0], made.x[1]];
        *made.x = before;
        made.derivative(after, &mut columns).expect("a derivative");
        let determinant = columns[0][0] * columns[1][1] - columns[0][1] * columns[1][0];
        assert!((determinant - 1.0).abs() < 1e-14, "{determinant}");
        assert!((columns[0][0] - 1.0).abs() > 1e-2);
        for column in 0..3 {
            let apart = |by: f64| {
                let mut at = [start[0], start[1], h];
                at[column] += by;
                flow(plane, [at[0], at[1]], is_adjoint, at[2]).expect("a flow")
            };
            let ends = [apart(d), apart(-d), apart(2.0 * d), apart(-2.0 * d)];
            for i in 0..2 {
                let slope = |a: [f64; 2], b: [f64; 2]| a[i] - b[i];
                let near = 8.0 * slope(ends[0], ends[1]) - slope(ends[2], ends[3]);
                let error = near / (12.0 * d) - columns[column][i];
                assert!(error.abs() < 1e-9, "{i}, {column}: {error:e}");
            }
        }
    }
}

/// F = Σ sin(3 i + 5 j) B_i(c) B_j(v) B_j(w) with c frozen, and a mean flow that depends on it.
fn in_space() -> Plane {
    let coefficient = |k: usize| (3.0 * (k / 121) as f64 + 5.0 * (k % 11 % 8) as f64).sin();
    let coefficients = (0..6 * 121).map(coefficient).collect();
    let axes = [8, 8].map(|cells| axis(cells, Bounds::Periodic).expect("an axis"));
    let frozen = vec![axis(3, Bounds::Open).expect("an axis")];
    let mean = [vec![0.1, 0.2, 0.4, 0.1, 0.0, 0.3], vec![0.05]];
    let spline = Spline::new(frozen, axes, coefficients, mean);
    Plane::Spline(Box::new(spline.expect("a plane")))
}

#[test]
fn members_in_lock_step_have_the_bits_of_each_alone_wherever_they_have_been() {
    for (plane, part) in [
        (plane(Bounds::Periodic), 1.0),
        (in_space(), 1.0),
        (traced(0.7), 0.2),
    ] {
        let frozen = plane.frozen();
        let start = |member: usize| -> [f64; 4] {
            let own = [0.3 * member as f64, 7.9 - 1.1 * member as f64].map(|x| x * part);
            if frozen == 0 {
                return [own[0], own[1], 0.0, 0.0];
            }
            [0.4 * member as f64, own[0], own[1], 0.0]
        };
        let mut together = [Lanes::<8>::splat(0.0); 4];
        let mut alone: Vec<[f64; 4]> = (0..8).map(start).collect();
        for (k, x) in together.iter_mut().enumerate() {
            *x = Lanes(std::array::from_fn(|member| start(member)[k]));
        }
        let mut memory = plane.memory();
        for step in 0..60 {
            let (is_adjoint, h) = (step % 2 == 1, 0.02 * part * f64::from(1 + step % 3));
            let mut flow = PlaneFlow {
                plane: &plane,
                memory: &mut memory,
                x: &mut together,
                is_adjoint,
                h,
            };
            flow.run(InstructionSet::default()).expect("a flow");
            for (member, x) in alone.iter_mut().enumerate() {
                let mut flow = PlaneFlow {
                    plane: &plane,
                    memory: &mut plane.memory(),
                    x: &mut *x,
                    is_adjoint,
                    h,
                };
                flow.run(InstructionSet::default()).expect("a flow");
                let own = x.map(f64::to_bits);
                let same = together.map(|x| x.0[member].to_bits());
                assert_eq!(own, same, "{member}, {step}");
            }
        }
        let ends = alone.iter().enumerate();
        let moved = ends.map(|(member, x)| (x[frozen] - start(member)[frozen]).abs());
        assert!(moved.fold(0.0, f64::max) > 0.1);
    }
}

#[test]
fn the_first_member_with_a_fault_is_told() {
    let plane = plane(Bounds::Open);
    let mut x = [Lanes::<8>::splat(2.5); 4];
    x[1].0[6] = -1.0;
    x[0].0[3] = 8.5;
    let mut memory = plane.memory();
    let mut flow = PlaneFlow {
        plane: &plane,
        memory: &mut memory,
        x: &mut x,
        is_adjoint: false,
        h: 0.1,
    };
    let machine = InstructionSet::default();
    assert_eq!(flow.run(machine), Err((Fault::Outside(0), 3)));
    flow.x[0].0[3] = 2.5;
    assert_eq!(flow.run(machine), Err((Fault::Outside(1), 6)));
    flow.x[1].0[6] = 2.5;
    flow.run(machine).expect("a flow");
    let after = flow.x[0].0.map(f64::to_bits);
    assert!(after.iter().all(|bits| *bits == after[0]));
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let plane = plane(Bounds::Periodic);
    let ends = InstructionSet::all().into_iter().map(|machine| {
        let mut x = [1.3, 5.6, 0.0, 0.0];
        let mut flow = PlaneFlow {
            plane: &plane,
            memory: &mut plane.memory(),
            x: &mut x,
            is_adjoint: false,
            h: 0.5,
        };
        flow.run(machine).expect("a flow");
        x.map(f64::to_bits)
    });
    let ends: Vec<_> = ends.collect();
    assert!(ends.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn a_coordinate_outside_an_open_axis_is_told_by_its_number() {
    let plane = plane(Bounds::Open);
    assert_eq!(flow(&plane, [8.5, 2.0], false, 0.1), Err(Fault::Outside(0)));
    assert_eq!(flow(&plane, [2.0, -0.5], true, 0.1), Err(Fault::Outside(1)));
    // roundoff of a start in other units is inside
    for (beyond, is_inside) in [(1e-7, true), (1e-5, false), (0.04, false)] {
        for start in [[8.0 + beyond, 2.0], [-beyond, 2.0]] {
            assert_eq!(
                flow(&plane, start, false, 1e-9).is_ok(),
                is_inside,
                "{start:?}"
            );
        }
    }
    assert_eq!(
        flow(&plane, [2.0, f64::NAN], true, 0.1),
        Err(Fault::Outside(1))
    );
}

#[test]
fn what_makes_no_basis_or_plane_is_refused() {
    assert_eq!(axis(2, Bounds::Wall), Err(Malformed::Cells { cells: 2 }));
    let falling = Basis::new(
        vec![0.0, 2.0, 1.0, 3.0],
        3,
        CUBIC.to_vec(),
        vec![0; 3],
        vec![0.0; 3],
        Bounds::Open,
    );
    assert_eq!(falling, Err(Malformed::Edges { index: 2 }));
    let far = Basis::new(
        vec![0.0, 1.0, 2.0, 3.0],
        3,
        CUBIC.to_vec(),
        vec![0, 1, 0],
        vec![0.0; 3],
        Bounds::Open,
    );
    assert_eq!(
        far,
        Err(Malformed::Table {
            cell: 1,
            table: 1,
            tables: 1
        })
    );
    let axes = [3, 3].map(|cells| axis(cells, Bounds::Open).expect("an axis"));
    let short = Spline::new(Vec::new(), axes, vec![0.0; 35], [vec![0.0], vec![0.0]]);
    let wanted = Malformed::Size {
        name: "coefficients",
        found: 35,
        wanted: 36,
    };
    assert_eq!(short, Err(wanted));
}
