//! Systems made without a front end: expressions, their derivatives, and the tapes of a problem. They stand in one file
//! since all tests and benchmarks share them.

// For tests alone: the names are those of the problems, and what fails panics.
#![allow(
    missing_docs,
    clippy::missing_errors_doc,
    clippy::missing_panics_doc,
    clippy::return_self_not_must_use
)]

pub mod meaning;
pub mod properties;
pub mod quantum;
pub mod sensitivity;
pub mod splits;
pub mod walk;
pub mod waves;

use liouville_base::linalg::Pattern;
use liouville_base::tape::{Line, Op, Tape};
use liouville_index2::semi_explicit::{self, SemiExplicit};
use liouville_problem::{
    Mechanical, Nonholonomic, NonholonomicPatterns, Patterns, SecondOrder, SecondOrderPatterns,
    Separable,
};
use std::collections::HashMap;
use std::ops::{Add, Mul, Neg, Sub};
use std::rc::Rc;
use std::sync::{Arc, OnceLock};

/// The input groups of a tape at a stage; a node has λ where a stage has z.
pub const T: usize = 0;
pub const Y: usize = 1;
pub const Z: usize = 2;
pub const LAM: usize = 2;
pub const PARAMS: usize = 3;
/// u or λ in the tapes of a second-order system, ν in those of nonholonomic constraints.
pub const FOURTH: usize = 3;

/// An expression, shared by those it is part of.
#[derive(Clone)]
pub struct Expr(Rc<Node>);

enum Node {
    Constant(f64),
    Input(usize, usize),
    Apply(Op, Expr, Expr),
}

pub fn input(group: usize, element: usize) -> Expr {
    Expr(Rc::new(Node::Input(group, element)))
}

pub fn inputs(group: usize, size: usize) -> Vec<Expr> {
    (0..size).map(|element| input(group, element)).collect()
}

pub fn dot(a: &[Expr], b: &[Expr]) -> Expr {
    a.iter()
        .zip(b)
        .fold(0.0.into(), |sum: Expr, (a, b)| sum + a * b)
}

impl Expr {
    fn apply(op: Op, a: &Expr, b: &Expr) -> Expr {
        Expr(Rc::new(Node::Apply(op, a.clone(), b.clone())))
    }

    pub fn sin(&self) -> Expr {
        Expr::apply(Op::Sin, self, self)
    }

    pub fn cos(&self) -> Expr {
        Expr::apply(Op::Cos, self, self)
    }

    fn is(&self, value: f64) -> bool {
        matches!(*self.0, Node::Constant(x) if x.to_bits() == value.to_bits())
    }

    /// The derivative with respect to one input.
    pub fn d(&self, group: usize, element: usize) -> Expr {
        match &*self.0 {
            Node::Constant(_) => 0.0.into(),
            Node::Input(g, e) => f64::from(u8::from((*g, *e) == (group, element))).into(),
            Node::Apply(op, a, b) => {
                let (da, db) = (a.d(group, element), b.d(group, element));
                match op {
                    Op::Add => da + db,
                    Op::Sub => da - db,
                    Op::Mul => da * b + a * db,
                    Op::Neg => -da,
                    Op::Sin => a.cos() * da,
                    Op::Cos => -(a.sin() * da),
                    other => unreachable!("no test differentiates {}", other.name()),
                }
            }
        }
    }

    /// The same with the inputs of one group taken from another.
    fn moved(&self, from: usize, to: usize) -> Expr {
        match &*self.0 {
            Node::Input(g, e) if *g == from => input(to, *e),
            Node::Constant(_) | Node::Input(..) => self.clone(),
            Node::Apply(op, a, b) => Expr::apply(*op, &a.moved(from, to), &b.moved(from, to)),
        }
    }

    fn depends_on(&self, group: usize) -> bool {
        match &*self.0 {
            Node::Constant(_) => false,
            Node::Input(g, _) => *g == group,
            Node::Apply(_, a, b) => a.depends_on(group) || b.depends_on(group),
        }
    }
}

impl From<f64> for Expr {
    fn from(value: f64) -> Self {
        Expr(Rc::new(Node::Constant(value)))
    }
}

impl From<&Expr> for Expr {
    fn from(value: &Expr) -> Self {
        value.clone()
    }
}

macro_rules! operator {
    ($trait:ident $method:ident |$a:ident, $b:ident| $value:expr) => {
        impl<R: Into<Expr>> $trait<R> for &Expr {
            type Output = Expr;
            fn $method(self, other: R) -> Expr {
                let ($a, $b) = (self, &other.into());
                $value
            }
        }
        impl<R: Into<Expr>> $trait<R> for Expr {
            type Output = Expr;
            fn $method(self, other: R) -> Expr {
                $trait::$method(&self, other)
            }
        }
    };
}

operator! { Add add |a, b|
    if a.is(0.0) { b.clone() }
    else if b.is(0.0) { a.clone() }
    else { Expr::apply(Op::Add, a, b) }
}
operator! { Sub sub |a, b|
    if b.is(0.0) { a.clone() }
    else if a.is(0.0) { -b }
    else { Expr::apply(Op::Sub, a, b) }
}
operator! { Mul mul |a, b|
    if a.is(0.0) || b.is(1.0) { a.clone() }
    else if b.is(0.0) || a.is(1.0) { b.clone() }
    else { Expr::apply(Op::Mul, a, b) }
}

impl Neg for &Expr {
    type Output = Expr;
    fn neg(self) -> Expr {
        if self.is(0.0) {
            self.clone()
        } else {
            Expr::apply(Op::Neg, self, self)
        }
    }
}

impl Neg for Expr {
    type Output = Expr;
    fn neg(self) -> Expr {
        -&self
    }
}

/// Records expressions as a tape, equal ones once.
pub fn tape(sizes: impl AsRef<[usize]>, outputs: &[Expr]) -> Tape {
    let mut recorder = Recorder::default();
    for (element, output) in outputs.iter().enumerate() {
        let slot = recorder.record(output);
        recorder.lines.push(Line::Output { element, slot });
    }
    Tape::new(sizes.as_ref(), outputs.len(), &recorder.lines).expect("a recorded program is valid")
}

#[derive(Default)]
struct Recorder {
    lines: Vec<Line>,
    slots: HashMap<(usize, u64, u64), usize>,
}

impl Recorder {
    fn record(&mut self, expr: &Expr) -> usize {
        let fresh = self.slots.len();
        let (key, line) = match &*expr.0 {
            Node::Constant(value) => {
                let line = Line::Constant {
                    slot: fresh,
                    value: *value,
                };
                ((usize::MAX, value.to_bits(), 0), line)
            }
            Node::Input(group, element) => {
                let line = Line::Input {
                    slot: fresh,
                    group: *group,
                    element: *element,
                };
                ((usize::MAX - 1, *group as u64, *element as u64), line)
            }
            Node::Apply(op, a, b) => {
                let (a, b) = (self.record(a), self.record(b));
                let line = Line::Apply {
                    op: *op,
                    slot: self.slots.len(),
                    a,
                    b,
                };
                ((*op as usize, a as u64, b as u64), line)
            }
        };
        let fresh = self.slots.len();
        *self.slots.entry(key).or_insert_with(|| {
            self.lines.push(line);
            fresh
        })
    }
}

/// The user's functions of a mechanical system; without `v` it is z, without `r` it is −g_yᵀ λ.
#[derive(Clone)]
pub struct Functions {
    pub v: Option<Vec<Expr>>,
    pub p: Vec<Expr>,
    pub f: Vec<Expr>,
    pub r: Option<Vec<Expr>>,
    pub g: Vec<Expr>,
    pub params: usize,
}

impl Functions {
    /// −g_yᵀ λ
    pub fn ideal_reaction(&self) -> Vec<Expr> {
        let lam = inputs(LAM, self.g.len());
        (0..self.p.len())
            .map(|k| {
                let column: Vec<_> = self.g.iter().map(|g| g.d(Y, k)).collect();
                -dot(&column, &lam)
            })
            .collect()
    }

    /// The system, with all derivatives.
    pub fn build(&self) -> Arc<Mechanical> {
        self.nonholonomic(&[], &[])
    }

    /// The system with nonholonomic constraints k and their reactions (t, y, z, ν) → r_n beside its own.
    pub fn nonholonomic(&self, k: &[Expr], rolling: &[Expr]) -> Arc<Mechanical> {
        let (n, m) = (self.p.len(), self.g.len());
        let velocity = self.v.clone().unwrap_or_else(|| inputs(Z, n));
        let own_velocity = self.v.as_deref().unwrap_or(&[]);
        let reaction = self.r.clone().unwrap_or_else(|| self.ideal_reaction());
        let along = |x: &Expr| {
            let slopes: Vec<_> = (0..n).map(|k| x.d(Y, k)).collect();
            x.d(T, 0) + dot(&slopes, &velocity)
        };
        let hidden: Vec<_> = self.g.iter().map(along).collect();
        let drift = self.p.iter().zip(&self.f).map(|(p, f)| f - along(p));
        let acceleration: Vec<_> = drift
            .chain(hidden.iter().map(along))
            .chain(k.iter().map(along))
            .chain(own_velocity.iter().map(along))
            .collect();

        let (p_z, v_z) = (
            jacobian(&self.p, Z, n, n),
            jacobian(own_velocity, Z, own_velocity.len(), n),
        );
        let (p_y, v_y) = (jacobian(&self.p, Y, n, n), jacobian(own_velocity, Y, n, n));
        let (f_y, f_z) = (jacobian(&self.f, Y, n, n), jacobian(&self.f, Z, n, n));
        let (g_y, r_y) = (jacobian(&self.g, Y, m, n), jacobian(&reaction, Y, n, n));
        let r_lam = jacobian(&reaction, LAM, n, m);

        let (stage, node) = ([1, n, n, self.params], [1, n, m, self.params]);
        let record = |sizes, parts: &[&[Expr]]| tape(sizes, &parts.concat());
        let nonlinear = |part: &[Expr]| part.iter().any(|x| x.depends_on(Z));
        let problem = Mechanical {
            n,
            m,
            is_linear: k.is_empty()
                && !(nonlinear(&p_z.1) || nonlinear(&v_z.1) || nonlinear(&r_lam.1)),
            stage: record(stage, &[&self.p, &self.f, own_velocity]),
            stage_blocks: record(stage, &[&p_z.1, &v_z.1]),
            stage_jacobian: record(stage, &[&p_y.1, &f_y.1, &f_z.1, &v_y.1]),
            node: record(node, &[&self.g, &reaction]),
            node_blocks: record(node, &[&g_y.1, &r_lam.1]),
            node_jacobian: record(node, &[&r_y.1]),
            end: record(stage, &[&self.p, &hidden, own_velocity]),
            acceleration: record(stage, &[&acceleration]),
            patterns: Patterns {
                p_z: p_z.0,
                v_z: self.v.as_ref().map(|_| v_z.0),
                p_y: p_y.0,
                f_y: f_y.0,
                f_z: f_z.0,
                v_y: v_y.0,
                g_y: g_y.0,
                r_lam: r_lam.0,
                r_y: r_y.0,
            },
            nonholonomic: nonholonomic([n, m, self.params], k, rolling, &hidden),
            redundant: None,
            schur_plan: OnceLock::new(),
            mass_plan: OnceLock::new(),
            compensated_g: OnceLock::new(),
        };
        Arc::new(problem.checked().expect("tapes and patterns fit together"))
    }
}

/// Nonholonomic constraints, if there are any; their multipliers are the fourth input.
fn nonholonomic(
    [n, m, params]: [usize; 3],
    k: &[Expr],
    reaction: &[Expr],
    hidden: &[Expr],
) -> Option<Box<Nonholonomic>> {
    let l = k.len();
    let blocks = [
        jacobian(k, Y, l, n),
        jacobian(k, Z, l, n),
        jacobian(reaction, Y, n, n),
        jacobian(reaction, Z, n, n),
        jacobian(reaction, FOURTH, n, l),
    ];
    let w_y = jacobian(hidden, Y, m, n);
    let values: Vec<_> = blocks.iter().flat_map(|block| block.1.clone()).collect();
    let [k_y, k_z, r_y, r_z, r_nu] = blocks.map(|block| block.0);
    (l > 0).then(|| {
        Box::new(Nonholonomic {
            l,
            values: tape([1, n, n, l, params], &[k, reaction].concat()),
            blocks: tape([1, n, n, l, params], &values),
            hidden: tape([1, n, n, params], &w_y.1),
            patterns: NonholonomicPatterns {
                k_y,
                k_z,
                r_y,
                r_z,
                r_nu,
                w_y: w_y.0,
            },
        })
    })
}

impl Functions {
    /// The same system in the second-order form; it has no parameters, v = z, and p is linear in z.
    pub fn second_order(&self) -> Arc<SecondOrder> {
        let (n, m) = (self.p.len(), self.g.len());
        assert!(
            self.v.is_none() && self.params == 0,
            "a second-order system"
        );
        let (z, fourth) = (inputs(Z, n), inputs(FOURTH, n));
        let along = |x: &Expr| {
            let slopes: Vec<_> = (0..n).map(|k| x.d(Y, k)).collect();
            x.d(T, 0) + dot(&slopes, &z)
        };
        let row = |k: usize| (0..n).map(move |j| self.p[k].d(Z, j)).collect::<Vec<_>>();
        let times = |x: &[Expr]| (0..n).map(|k| dot(&row(k), x)).collect::<Vec<_>>();
        let residual: Vec<_> = (0..n)
            .zip(times(&fourth))
            .map(|(k, mass)| &self.f[k] - along(&self.p[k]) - mass)
            .collect();
        let reaction = self.r.clone().unwrap_or_else(|| self.ideal_reaction());
        let pull: Vec<_> = times(&z) // the place of z is a's
            .into_iter()
            .zip(&reaction)
            .map(|(mass, r)| mass - r.moved(LAM, FOURTH))
            .collect();
        let hidden: Vec<_> = self.g.iter().map(along).collect();
        let mass = jacobian(&self.p, Z, n, n);
        let (j_y, j_z) = (jacobian(&residual, Y, n, n), jacobian(&residual, Z, n, n));
        let (n_y, w_y) = (jacobian(&pull, Y, n, n), jacobian(&hidden, Y, m, n));
        let (end, node) = ([1, n, n, n, 0], [1, n, n, m, 0]);
        let record = |sizes, parts: &[&[Expr]]| tape(sizes, &parts.concat());
        let problem = SecondOrder {
            mechanical: self.build(),
            residual: record(end, &[&residual, &self.g, &hidden]),
            jacobian: record(end, &[&mass.1, &j_y.1, &j_z.1, &w_y.1]),
            reaction: record(node, &[&pull]),
            reaction_jacobian: record(node, &[&n_y.1]),
            power: None,
            power_of_lam: false,
            patterns: SecondOrderPatterns {
                mass: mass.0,
                j_y: j_y.0,
                j_z: j_z.0,
                w_y: w_y.0,
                n_y: n_y.0,
            },
        };
        Arc::new(problem.checked().expect("tapes and patterns fit together"))
    }
}

impl Functions {
    /// The same system in the separable form; it has no parameters.
    pub fn separable(&self) -> Arc<Separable> {
        let (n, m) = (self.p.len(), self.g.len());
        let gradient = jacobian(&self.g, Y, m, n).1;
        let drift: Vec<_> = self.g.iter().map(|g| g.d(T, 0)).collect();
        let record = |outputs: &[Expr]| tape([1, n, 0], outputs);
        let problem = Separable {
            mechanical: self.build(),
            force: record(&self.f),
            constraint: record(&self.g),
            gradient: record(&[gradient, drift].concat()),
        };
        Arc::new(problem.checked().expect("tapes fit together"))
    }
}

/// The semi-explicit system y' = f, 0 = k of these functions, with all derivatives; it has no parameters.
pub fn semi_explicit(f: &[Expr], k: &[Expr]) -> Arc<SemiExplicit> {
    let (n, l) = (f.len(), k.len());
    let along = |x: &Expr| {
        let slopes: Vec<_> = (0..n).map(|j| x.d(Y, j)).collect();
        x.d(T, 0) + dot(&slopes, f)
    };
    let w: Vec<_> = k.iter().map(along).collect();
    let rates: Vec<_> = w.iter().chain(f).map(along).collect();
    let (f_y, f_z) = (jacobian(f, Y, n, n), jacobian(f, Z, n, l));
    let (k_y, w_z) = (jacobian(k, Y, l, n), jacobian(&w, Z, l, l));
    let (point, place) = ([1, n, l, 0], [1, n, 0]);
    let record = |sizes: &[usize], parts: &[&[Expr]]| tape(sizes, &parts.concat());
    let problem = SemiExplicit {
        n,
        l,
        is_linear: !f_z.1.iter().any(|x| x.depends_on(Z)),
        field: record(&point, &[f]),
        field_jacobian: record(&point, &[&f_y.1, &f_z.1]),
        constraint: record(&place, &[k]),
        constraint_jacobian: record(&place, &[&k_y.1]),
        hidden: record(&point, &[&w, f]),
        hidden_jacobian: record(&point, &[&w_z.1, &f_z.1]),
        rates: record(&point, &[&rates]),
        patterns: semi_explicit::SemiExplicitPatterns {
            f_y: f_y.0,
            f_z: f_z.0,
            k_y: k_y.0,
            w_z: w_z.0,
        },
    };
    Arc::new(problem.checked().expect("tapes and patterns fit together"))
}

/// A turning vector whose first component is prescribed, nonlinear in the unknown: (f, k).
pub fn turning() -> (Vec<Expr>, Vec<Expr>) {
    let (y, z) = (inputs(Y, 3), input(Z, 0));
    let axis = [
        (input(T, 0) * 3.0).sin() * 0.2,
        z.clone(),
        (&z * &z + 1.0) * 0.5,
    ];
    let f = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &axis[i] * &y[j] - &axis[j] * &y[i]);
    (f.to_vec(), vec![&y[0] - (input(T, 0) * 2.0).sin() * 0.25])
}

pub fn jacobian(of: &[Expr], group: usize, rows: usize, cols: usize) -> (Pattern, Vec<Expr>) {
    let (entries, values) = (0..cols)
        .flat_map(|j| (0..of.len()).map(move |i| (i, j)))
        .map(|(i, j)| ((i, j), of[i].d(group, j)))
        .filter(|(_, value)| !value.is(0.0))
        .unzip();
    let pattern = Pattern::new(rows, cols, entries).expect("entries lie inside");
    (pattern, values)
}

/// The planar pendulum in Cartesian coordinates, with parameters (m, l, g).
pub fn pendulum() -> Functions {
    let (y, z) = (inputs(Y, 2), inputs(Z, 2));
    let [m, l, g] = [0, 1, 2].map(|k| input(PARAMS, k));
    Functions {
        v: None,
        p: z.iter().map(|z| &m * z).collect(),
        f: vec![0.0.into(), -(&m * &g)],
        r: None,
        g: vec![(dot(&y, &y) - &l * &l) * 0.5],
        params: 3,
    }
}

/// Parameters of the pendulum released from the horizontal, and its start (1, 0), (0, 0).
pub const PENDULUM: [f64; 3] = [1.0, 1.0, 9.81];
