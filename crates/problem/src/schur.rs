//! The Schur complement of constraints at several nodes, as sparse as their couplings:
//!
//!     S_il = P_il G_i B R_l,   B = v_z p_z⁻¹,   G_i = g_y at node i,   R_l = r_λ at node l
//!
//! with given weights P; of one node with P = 1 it is that of every index-1 solve.

use super::MemberLanes;
use super::{Mass, Mechanical};
use liouville_base::compiled;
use liouville_base::linalg::{GramPlan, Matrix, NodeGram, Product, Rows, Singular};
use liouville_base::real::Real;
use std::sync::Arc;

/// Where S and its parts are not zero and how S is eliminated, whatever the nodes and weights.
#[derive(Debug)]
pub struct SchurPlan {
    g_y: Rows,
    r_lam: Rows,
    /// B, where v is not z.
    inverse_mass: Option<Arc<Product>>,
    /// B `r_λ`.
    inverse_mass_rt: Arc<Product>,
    gram: Arc<GramPlan>,
}

impl SchurPlan {
    /// `None` where a block of the mass is large, or S is not sparse.
    fn new<R: Real>(problem: &Mechanical, mass: &Mass<R>) -> Option<Self> {
        let g_y = Rows::of(&problem.patterns.g_y, 0);
        let r_lam = Rows::of(&problem.patterns.r_lam, 0);
        let inverse = mass.inverse_pattern()?;
        let v_z = mass.v_z();
        let inverse_mass = v_z.map(|(v_z, _)| Arc::new(Product::new(v_z, &inverse)));
        let left = inverse_mass.as_ref().map_or(&inverse, |b| b.pattern());
        let product = Product::new(left, &r_lam.pattern());
        Some(Self {
            gram: Arc::new(GramPlan::new(&g_y.pattern(), product.pattern())?),
            inverse_mass_rt: Arc::new(product),
            inverse_mass,
            g_y,
            r_lam,
        })
    }
}

/// `g_y` and `r_λ` at the nodes, and S, factored.
#[derive(Clone, Debug)]
pub struct SparseSchur<R = f64> {
    g_y: Rows<R>,
    r_lam: Rows<R>,
    /// B, where v is not z.
    inverse_mass: Option<(Arc<Product>, Vec<R>)>,
    /// B `r_λ` at the nodes.
    inverse_mass_rt: (Arc<Product>, Vec<R>),
    factor: NodeGram<R>,
}

impl<R: Real> SparseSchur<R> {
    /// Memory for the holonomic constraints of this problem and the weights P; `None` where a block of the mass is
    /// large, or S is not sparse.
    #[inline(never)]
    pub fn new(problem: &Mechanical, mass: &Mass<R>, weights: &Matrix) -> Option<Self> {
        let nodes = weights.rows();
        let plan = problem
            .schur_plan
            .get_or_init(|| SchurPlan::new(problem, mass).map(Arc::new));
        let plan = plan.as_ref()?;
        let memory = |product: &Arc<Product>, nodes: usize| {
            let values = vec![R::splat(0.0); nodes * product.pattern().len()];
            (product.clone(), values)
        };
        Some(Self {
            factor: NodeGram::with(plan.gram.clone(), weights)?,
            inverse_mass_rt: memory(&plan.inverse_mass_rt, nodes),
            inverse_mass: plan.inverse_mass.as_ref().map(|product| memory(product, 1)),
            g_y: plan.g_y.at(nodes),
            r_lam: plan.r_lam.at(nodes),
        })
    }

    /// Factors S of the mass as it is factored, and of these values at each node in the order of their patterns.
    ///
    /// # Errors
    /// The first constraint that depends on those eliminated before it.
    #[allow(clippy::inline_always)] // loops over the nodes are unrolled where k is known
    #[inline(always)]
    pub fn factor<'v, const K: usize>(
        &mut self,
        k: usize,
        mass: &Mass<R>,
        g_y: impl Fn(usize) -> &'v [R],
        r_lam: impl Fn(usize) -> &'v [R],
    ) -> Result<(), Singular> {
        self.g_y.set(k, g_y);
        self.r_lam.set(k, r_lam);
        let mut left = mass.inverse_values();
        if let (Some((product, values)), Some((_, v_z))) = (&mut self.inverse_mass, mass.v_z()) {
            product.multiply::<R, 1>(1, v_z, left, values);
            left = values;
        }
        let (product, values) = &mut self.inverse_mass_rt;
        product.multiply::<R, K>(k, left, self.r_lam.values(), values);
        self.factor.factor(self.g_y.values(), values)
    }

    /// Solves `S x = b` in place; vectors stand node by node within a constraint.
    pub fn solve(&mut self, b: &mut [R]) {
        self.factor.solve(b);
    }

    /// Solves `Sᵀ x = b` in place.
    pub fn solve_transposed(&mut self, b: &mut [R]) {
        self.factor.solve_transposed(b);
    }

    /// `g_y` at the nodes it was last factored with.
    pub fn g_y(&self) -> &Rows<R> {
        &self.g_y
    }

    /// `r_λ` at the nodes it was last factored with.
    pub fn r_lam(&self) -> &Rows<R> {
        &self.r_lam
    }
}

compiled!(R in [f64, MemberLanes] { SparseSchur::<R>::new as fn(_, _, _) -> _ });
