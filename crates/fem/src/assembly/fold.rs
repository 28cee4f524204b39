//! Folded elements, and what opens them again.
//!
//! A law is evaluated at four points within a quadratic tetrahedron. Its corners and edges may pass through it between
//! them, and a body can rest so: every point uninverted, all forces balanced. What holds such folds open is a barrier at
//! the ten nodes, where the volume ratio `J` (extrapolated from the points, as `F` varies linearly) falls below
//! [`OPEN_BELOW`]:
//! ```text
//! E = Σ_nodes V/10 k/2 (OPEN_BELOW - J)²,    k = λ + 2 μ of the element's law at small strain        J
//! ```
//! It is continuous with its force and nothing at all above, so an element that is not about to fold keeps its bits. Where
//! it acts, the answer is not that of the law, and the report counts it. Evaluating folded elements as eight linear
//! ones instead was tried: the energy jumps where an element changes over, and bodies swing between the two for ever.
//!
//! A linear element has one `F` and no such folds, but a body may rest with some of them inside out: a law that is continued
//! through `J = 0` has minima there between stretched neighbours, and St Venant-Kirchhoff does not tell a body from its mirror
//! image. Over linear and averaged elements the same barrier acts at their one point with all of their volume; as its
//! neighbours may be many times stiffer than `k`, whoever asks for it may raise `k` ([`Folds::stiffen`]).

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use crate::{
    element::{
        ElementKind, ElementMatrices, QuadraticTetrahedron, Tetrahedron, UNIT, UPPER,
        quadratic::{QuadraticMatrices, upper_index},
    },
    lanes::Real,
    material::{
        Lame, Law, MaterialError,
        hyperelastic::{Hyperelastic, Response, VolumeFactor},
    },
    model::FemModel,
    sparse::FIXED,
};

/// Volume ratio at a node below which a quadratic element is held open, or a linear one that is asked to be. Half of that
/// below which laws are continued ([`EXTENSION_BELOW`](crate::material::neo_hookean::EXTENSION_BELOW)): tissue as far as
/// any law knows it never meets it.
pub const OPEN_BELOW: f64 = 0.1;

/// Volume ratio, of a quadratic element at a node, below which an element is watched: it may come under [`OPEN_BELOW`]
/// within a step.
const WATCHED_BELOW: f64 = 0.5;

/// Nodes of an element, each of which stands for as much of its volume.
const NODES: f64 = 10.0;

/// The barrier as a law of the volume ratio alone.
#[derive(Clone, Copy, Debug)]
struct Barrier {
    /// `k` (Pa).
    modulus: f64,
}

impl Hyperelastic for Barrier {
    const MIXED: bool = false;
    const CURVED: bool = false;
    const CONTINUED: bool = false;

    fn validate(&self) -> Result<(), MaterialError> {
        Ok(())
    }

    fn small_strain(&self) -> Lame {
        Lame { mu: 0.0, lambda: 0.0 }
    }

    fn relaxed(&self, _share: f64) -> Self {
        *self
    }

    #[inline(always)]
    fn response<T: Real>(&self, _: T, _: T, J: T) -> Response<T> {
        let d = J - OPEN_BELOW;
        let second = J.constant(self.modulus);
        Response::volume(&VolumeFactor { value: d * d * (0.5 * self.modulus), first: d * self.modulus, second })
    }
}

/// What was found among the elements of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoldReport {
    /// Elements with a volume ratio below [`OPEN_BELOW`], of quadratic ones at one of their nodes: folded, or about to be.
    pub folded: u32,
    /// Smallest volume ratio of any element, of quadratic ones at a node; infinity where it was not looked for.
    pub min_jacobian: f64,
    /// Tetrahedron of the mesh of that volume ratio; `u32::MAX` where it was not looked for.
    pub tetrahedron: u32,
}

impl FoldReport {
    /// Not looked for, or nothing found.
    pub const NONE: Self = Self { folded: 0, min_jacobian: f64::INFINITY, tetrahedron: u32::MAX };
}

/// The elements that the barrier watches over: none until [`Folds::find`] is called. Scratch of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Folds {
    /// In ascending order.
    watched: Vec<u32>,
    /// Factor of `k`.
    stiffness: f64,
}

impl Folds {
    pub(super) fn new(model: &FemModel) -> Self {
        Self { watched: Vec::with_capacity(model.elements().len()), stiffness: 1.0 }
    }

    /// Watches over nothing: the body is as its law alone has it.
    pub fn clear(&mut self) {
        self.watched.clear();
        self.stiffness = 1.0;
    }

    /// Makes the barrier `factor` times as stiff, until [`Folds::find`] is called again.
    pub fn stiffen(&mut self, factor: f64) {
        self.stiffness = factor;
    }

    /// Watches over the same elements as another; both are of one body.
    pub fn copy_from(&mut self, other: &Self) {
        self.watched.clear();
        self.watched.extend_from_slice(&other.watched);
        self.stiffness = other.stiffness;
    }

    /// Looks through the elements with node positions `q` (m). Allocates nothing.
    pub fn find(&mut self, model: &FemModel, q: &[Vector3<f64>]) -> FoldReport {
        self.clear();
        let mut report = FoldReport::NONE;
        let mut look = |e: u32, tetrahedron: u32, least: f64| {
            if least < WATCHED_BELOW {
                self.watched.push(e);
            }
            report.folded += u32::from(least < OPEN_BELOW);
            if least < report.min_jacobian {
                (report.min_jacobian, report.tetrahedron) = (least, tetrahedron);
            }
        };
        if model.element_kind() == ElementKind::Quadratic {
            for ((e, element), &tetrahedron) in (0..).zip(model.quadratic_elements()).zip(model.mesh_tetrahedron()) {
                let ratios = element.nodal_gradients(q).map(|F| F.determinant());
                look(e, tetrahedron, ratios.into_iter().fold(f64::INFINITY, f64::min));
            }
        } else {
            for ((e, element), &tetrahedron) in (0..).zip(model.elements()).zip(model.mesh_tetrahedron()) {
                look(e, tetrahedron, element.deformation_gradient(q).determinant());
            }
        }
        report
    }

    /// Energy of the barrier (J).
    pub fn energy(&self, model: &FemModel, q: &[Vector3<f64>]) -> f64 {
        let of_element = |(barrier, element): (Barrier, &QuadraticTetrahedron)| {
            let low = element.nodal_gradients(q).into_iter().filter(|F| F.determinant() < OPEN_BELOW);
            element.volume() / NODES * low.map(|F| barrier.energy_density(&F)).sum::<f64>()
        };
        let of_linear = |(barrier, element): (Barrier, &Tetrahedron)| {
            let F = element.deformation_gradient(q);
            if F.determinant() < OPEN_BELOW { element.volume * barrier.energy_density(&F) } else { 0.0 }
        };
        self.barriers(model, model.quadratic_elements()).map(of_element).sum::<f64>()
            + self.barriers(model, linear(model)).map(of_linear).sum::<f64>()
    }

    /// Adds the forces of the barrier, and its blocks to an `upper` that is not empty.
    pub(super) fn add(
        &self,
        model: &FemModel,
        q: &[Vector3<f64>],
        filter: bool,
        upper: &mut [Matrix3<f64>],
        f_int: &mut [Vector3<f64>],
    ) {
        let mut answer = ElementMatrices::ZERO;
        for (barrier, element) in self.barriers(model, linear(model)) {
            let edges = element.edges(q);
            if (edges * element.inverse_rest_edges).determinant() < OPEN_BELOW {
                barrier.element(element, &edges, filter, &mut answer);
                for (a, &node) in element.nodes.iter().enumerate() {
                    f_int[node as usize] += answer.force(a);
                }
                let blocks = UPPER.into_iter().enumerate().map(|(k, pair)| (pair, answer.upper(k)));
                scatter(model, &element.nodes, blocks, upper);
            }
        }
        for (barrier, element) in self.barriers(model, model.quadratic_elements()) {
            let mut sum: Option<QuadraticMatrices> = None;
            for (i, F) in element.nodal_gradients(q).iter().enumerate().filter(|(_, F)| F.determinant() < OPEN_BELOW) {
                barrier.element(&UNIT, F, filter, &mut answer);
                let sum = sum.get_or_insert(QuadraticMatrices::ZERO);
                element.add_at_node(i, element.volume() / NODES, &answer, sum);
            }
            if let Some(mut sum) = sum {
                sum.complete();
                for (&node, force) in element.nodes.iter().zip(&sum.forces) {
                    f_int[node as usize] += force;
                }
                let pairs = (0..10).flat_map(|b| (0..=b).map(move |a| (a, b)));
                let blocks = pairs.map(|(a, b)| ((a, b), sum.blocks[upper_index(a, b)]));
                scatter(model, &element.nodes, blocks, upper);
            }
        }
    }

    /// The watched ones of these elements, each with its barrier.
    fn barriers<'a, E>(&'a self, model: &'a FemModel, elements: &'a [E]) -> impl Iterator<Item = (Barrier, &'a E)> {
        self.watched.iter().filter_map(move |&e| {
            let element = elements.get(e as usize)?;
            let batch = model.batches().partition_point(|batch| batch.elements.end <= e as usize);
            let Lame { mu, lambda } = model.batches().get(batch)?.tissue.material.small_strain();
            Some((Barrier { modulus: self.stiffness * (lambda + 2.0 * mu) }, element))
        })
    }
}

/// The elements of a linear or averaged body; none of a quadratic one, whose corners the model has as well.
fn linear(model: &FemModel) -> &[Tetrahedron] {
    if model.element_kind() == ElementKind::Quadratic { &[] } else { model.elements() }
}

/// Adds the blocks of one element, by pairs of its nodes, to the upper blocks where there are any.
fn scatter<const N: usize>(
    model: &FemModel,
    nodes: &[u32; N],
    blocks: impl Iterator<Item = ((usize, usize), Matrix3<f64>)>,
    upper: &mut [Matrix3<f64>],
) {
    if upper.is_empty() {
        return;
    }
    let free = nodes.map(|node| model.free_of_node()[node as usize]);
    let position = |i: u32, j: u32| model.upper_blocks().position(model.pattern(), i, j).map(|p| p as usize);
    for ((a, b), block) in blocks {
        let (i, j) = (free[a], free[b]);
        if i == FIXED || j == FIXED {
            continue;
        }
        match if i <= j { position(i, j) } else { position(j, i) } {
            Some(p) if i <= j => upper[p] += block,
            Some(p) => upper[p] += block.transpose(),
            None => {}
        }
    }
}
