//! The inverse of a soft body: its factor, and what was precomputed from it where that serves.

use nalgebra::DMatrixViewMut;
use palpate_fem::factor::{Factor, ReachWorkspace, SolveStatus, SolveWorkspace};
use palpate_fem::nodal_rows::NodalRows;

use crate::compliance::InverseRows;
use crate::surface_inverse::{GatherWorkspace, SurfaceInverse};

/// A factor, and the inverse between the nodes of the skin where one was made from it.
///
/// `W` is gathered where all rows are on that skin and the factor has not changed since; else it comes from half solves.
#[derive(Clone, Copy)]
pub struct PrecomputedInverse<'a> {
    /// The factor.
    pub factor: &'a Factor,
    /// What was made from it.
    pub surface: Option<&'a SurfaceInverse>,
}

impl<'a> From<&'a Factor> for PrecomputedInverse<'a> {
    fn from(factor: &'a Factor) -> Self {
        Self { factor, surface: None }
    }
}

/// Memory for either way.
pub struct PrecomputedWorkspace {
    reach: ReachWorkspace,
    solve: SolveWorkspace,
    gather: Option<GatherWorkspace>,
    /// Whether the latest `W` was gathered, and from which factor.
    gathered: Option<u64>,
}

impl PrecomputedWorkspace {
    /// Memory for half solves with a factor of this topology.
    pub fn new(reach: ReachWorkspace, solve: SolveWorkspace) -> Self {
        Self { reach, solve, gather: None, gathered: None }
    }

    /// Makes room for gathering as many rows from an inverse.
    pub fn make_room_for(&mut self, surface: &SurfaceInverse) {
        self.gather = Some(GatherWorkspace::new(surface, self.reach.max_rows()));
    }

    /// The memory for half solves.
    pub fn reach(&self) -> &ReachWorkspace {
        &self.reach
    }

    /// The same, to change it.
    pub fn reach_mut(&mut self) -> &mut ReachWorkspace {
        &mut self.reach
    }

    /// Solves by the factor's copy in 16 bits that were asked for and done by its stored values, since this was asked last.
    pub fn take_in_full(&mut self) -> u32 {
        self.reach.take_in_full() + self.solve.take_in_full()
    }
}

impl InverseRows for PrecomputedInverse<'_> {
    type Workspace = PrecomputedWorkspace;

    fn compliance_into(
        &self,
        rows: &NodalRows,
        scale: f64,
        mut w: DMatrixViewMut<'_, f64>,
        ws: &mut PrecomputedWorkspace,
    ) -> bool {
        ws.gathered = None;
        let surface = self.surface.filter(|surface| surface.is_of(self.factor));
        if let (Some(surface), Some(gather)) = (surface, &mut ws.gather)
            && surface.gather_into(rows, scale, w.as_view_mut(), gather)
        {
            ws.gathered = Some(self.factor.revision());
            return true;
        }
        InverseRows::compliance_into(self.factor, rows, scale, w, &mut ws.reach)
    }

    /// After gathering by one solve with the factor, else from the half solves.
    fn correct(&self, lambda: &[f64], x: &mut [f64], ws: &mut PrecomputedWorkspace) -> bool {
        match ws.gathered {
            Some(revision) => self.solve(revision, Factor::solve, lambda, x, ws),
            None => InverseRows::correct(self.factor, lambda, x, &mut ws.reach),
        }
    }

    fn guess(&self, lambda: &[f64], x: &mut [f64], ws: &mut PrecomputedWorkspace) -> bool {
        match ws.gathered {
            Some(revision) => self.solve(revision, Factor::precondition, lambda, x, ws),
            None => InverseRows::guess(self.factor, lambda, x, &mut ws.reach),
        }
    }
}

impl PrecomputedInverse<'_> {
    /// `x = A⁻¹ Hᵀ λ` for the rows that were gathered, by one of the factor's solves.
    fn solve(
        &self,
        revision: u64,
        solve: fn(&Factor, &mut [f64], &mut SolveWorkspace) -> SolveStatus,
        lambda: &[f64],
        x: &mut [f64],
        ws: &mut PrecomputedWorkspace,
    ) -> bool {
        let Some(rows) = ws.gather.as_ref().map(GatherWorkspace::rows) else { return false };
        let fits = lambda.len() == rows.len() && x.len() == self.factor.symbolic().degrees_of_freedom();
        if !fits || revision != self.factor.revision() {
            return false;
        }
        x.fill(0.0);
        rows.add_transposed(lambda, x);
        solve(self.factor, x, &mut ws.solve).is_ok()
    }
}
