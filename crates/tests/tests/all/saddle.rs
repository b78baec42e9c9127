//! The saddle-point matrix and the projection of systems large enough to be solved sparse.

use liouville_base::error::StepError;
use liouville_base::linalg::{Pattern, dependencies, max_norm};
use liouville_problem::{Model, Projection, Saddle, project};
use liouville_tests::{Expr, Functions, Y, Z, dot, input, inputs};

const LINKS: usize = 60;

fn lengths(links: usize) -> Vec<Expr> {
    let y = inputs(Y, 2 * links);
    let end = |k: usize, axis: usize| {
        if k == 0 {
            0.0.into()
        } else {
            y[2 * k - 2 + axis].clone()
        }
    };
    let arm = |k: usize| [0, 1].map(|axis| &y[2 * k + axis] - end(k, axis));
    let length = |k: usize| (dot(&arm(k), &arm(k)) - 1.0) * 0.5;
    (0..links).map(length).collect()
}

/// A chain whose points have the mass `mass`, with v = z or v apart from z.
fn chain(mass: f64, own_velocity: bool) -> Functions {
    let z = inputs(Z, 2 * LINKS);
    let coupled = |k: usize| &z[k] + &z[(k + 2) % z.len()] * 0.1;
    Functions {
        v: own_velocity.then(|| (0..z.len()).map(coupled).collect()),
        p: z.iter().map(|z| z * mass).collect(),
        f: vec![0.0.into(); 2 * LINKS],
        r: None,
        g: lengths(LINKS),
        params: 0,
    }
}

/// Points of a chain that is almost straight.
fn hanging(links: usize) -> Vec<f64> {
    let ends = (1..=links).map(|k| k as f64);
    ends.flat_map(|k| [0.6 * k + 1e-3 * k.sin(), -0.8 * k])
        .collect()
}

fn multiply(pattern: &Pattern, values: &[f64], factor: f64, x: &[f64], out: &mut [f64]) {
    pattern.multiply_add(values, factor, x, out);
}

#[test]
fn a_large_saddle_multiplies_back() {
    for own_velocity in [false, true] {
        for mass in [1e-26, 1e-6, 1.0, 1e12] {
            let mut model = Model::new(chain(mass, own_velocity).build(), &[]);
            let mut saddle = Saddle::new(&model);
            let (y, z) = (hanging(LINKS), vec![0.1; 2 * LINKS]);
            let lam = vec![0.3; LINKS];
            saddle
                .update(&mut model, 0.0, &y, &z, &lam)
                .expect("regular");
            let (force, drift) = (mass * 1.5, -0.5);
            let (mut a, mut b) = (vec![force; 2 * LINKS], vec![drift; LINKS]);
            saddle.solve(&model, &mut a, &mut b);
            let problem = model.problem.clone();
            let at = &problem.patterns;
            let [p_z, _] = model.stage_blocks(0.0, &y, &z);
            let mut first = vec![-force; 2 * LINKS];
            multiply(&at.p_z, p_z, 1.0, &a, &mut first);
            let size = max_norm(&a) * mass;
            multiply(&at.r_lam, saddle.r_lam(), -1.0, &b, &mut first);
            assert!(
                max_norm(&first) < 1e-11 * size,
                "{:e} of {size:e}",
                max_norm(&first)
            );
            let (mut v, mut second) = (vec![0.0; 2 * LINKS], vec![-drift; LINKS]);
            saddle.mass.add_velocity(&a, &mut v);
            multiply(&at.g_y, saddle.g_y(), 1.0, &v, &mut second);
            assert!(max_norm(&second) < 1e-11 * max_norm(&v));
        }
    }
}

/// What a solve takes from (a, b) to (x, μ), the transposed one takes back, whatever the matrix is solved with.
#[test]
fn a_transposed_saddle_is_the_transpose() {
    for (links, own_velocity) in [(LINKS, false), (LINKS, true), (5, false)] {
        let mut functions = chain(3.0, own_velocity);
        let n = 2 * links;
        functions.p.truncate(n);
        functions.f.truncate(n);
        functions.g = lengths(links);
        let mut model = Model::new(functions.build(), &[]);
        let mut saddle = Saddle::new(&model);
        let (y, z, lam) = (hanging(links), vec![0.1; n], vec![0.3; links]);
        let made = saddle.update(&mut model, 0.0, &y, &z, &lam);
        made.expect("regular");
        let noise = |count: usize, phase: f64| -> Vec<f64> {
            (0..count).map(|k| (k as f64 * 1.7 + phase).sin()).collect()
        };
        let (right, left) = (noise(n + links, 0.1), noise(n + links, 0.7));
        let (mut x, mut back) = (right.clone(), left.clone());
        let (a, b) = x.split_at_mut(n);
        saddle.solve(&model, a, b);
        let (a, b) = back.split_at_mut(n);
        saddle.solve_transposed(&model, a, b);
        let paired = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let unit = left.iter().zip(&x).map(|(a, b)| (a * b).abs()).sum::<f64>();
        let apart = (paired(&left, &x) - paired(&back, &right)).abs() / unit;
        assert!(apart < 1e-12, "{apart:e} apart with {links} links");
    }
}

#[test]
fn a_large_saddle_names_constraints_that_depend() {
    let mut functions = chain(1.0, false);
    functions.g[40] = &functions.g[3] * 2.0;
    let mut model = Model::new(functions.build(), &[]);
    let mut saddle = Saddle::new(&model);
    let (y, z, lam) = (hanging(LINKS), vec![0.0; 2 * LINKS], vec![0.0; LINKS]);
    let error = saddle
        .update(&mut model, 0.0, &y, &z, &lam)
        .expect_err("one twice");
    let constraints = vec![3, 40];
    assert_eq!(error, StepError::DependentConstraints { constraints });
}

#[test]
fn dependent_rows_of_a_large_matrix_are_named() {
    // differences of neighbours, and the sum of some of them
    let (rows, cols) = (2000, 2100);
    let mut entries: Vec<_> = (0..rows - 1).flat_map(|k| [(k, k), (k, k + 1)]).collect();
    let mut values = [1.0, -1.0].repeat(rows - 1);
    let extra = [(rows - 1, 500), (rows - 1, 503)];
    entries.extend(extra);
    values.extend([1e9, -1e9]);
    let pattern = Pattern::new(rows, cols, entries.clone()).expect("entries inside");
    assert_eq!(
        dependencies(&pattern, &values),
        Some(vec![500, 501, 502, 1999])
    );
    *values.last_mut().expect("values") *= 1.1;
    assert_eq!(dependencies(&pattern, &values), None);
    values[2 * 77] = 0.0;
    values[2 * 77 + 1] = 0.0;
    assert_eq!(dependencies(&pattern, &values), Some(vec![77]));
}

fn projection(links: usize) -> Projection {
    let (x, n) = (inputs(0, 2 * links), 2 * links);
    let length = |k: usize| {
        let arm = [0, 1].map(|axis| match k {
            0 => x[axis].clone(),
            _ => &x[2 * k + axis] - &x[2 * k - 2 + axis],
        });
        (dot(&arm, &arm) - 1.0) * 0.5
    };
    let c: Vec<Expr> = (0..links).map(length).collect();
    let entries: Vec<_> = (0..links)
        .flat_map(|k| (2 * k.max(1) - 2..2 * k + 2).map(move |i| (k, i)))
        .collect();
    let c_x: Vec<_> = entries.iter().map(|&(k, i)| c[k].d(0, i)).collect();
    let sizes = [n, 1, 0];
    Projection {
        residual: liouville_tests::tape(sizes, &c),
        jacobian: liouville_tests::tape(sizes, &c_x),
        pattern: Pattern::new(links, n, entries).expect("entries inside"),
        metric: liouville_tests::tape(
            sizes,
            &(0..n)
                .map(|k| input(1, 0) * (1.0 + (k % 3) as f64))
                .collect::<Vec<_>>(),
        ),
        metric_pattern: Pattern::diagonal(n),
    }
}

#[test]
fn a_projection_is_the_same_in_any_unit_of_mass() {
    for links in [2, 12, 400] {
        let projection = projection(links);
        let near: Vec<f64> = hanging(links);
        let [light, heavy] = [1e-26, 1e20]
            .map(|mass| project(&projection, &near, &[mass], &[]).expect("a point near"));
        let size = max_norm(&near);
        assert!(
            light
                .iter()
                .zip(&heavy)
                .all(|(a, b)| (a - b).abs() < 1e-12 * size)
        );
        for k in 1..links {
            let length =
                (light[2 * k] - light[2 * k - 2]).hypot(light[2 * k + 1] - light[2 * k - 1]);
            assert!((length - 1.0).abs() < 1e-12 * size, "{length}");
        }
    }
}
