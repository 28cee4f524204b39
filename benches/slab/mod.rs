//! Contacts whose compliance is nearly singular: points on neighbouring faces of a slab under a rigid tool.
//!
//! One point on each face of a patch has more rows than the patch's nodes have degrees of freedom, from 30 points on:
//! Gauss-Seidel then needs hundreds of sweeps and more, where 60 do on the nodes of the liver's skin.
#![allow(dead_code)] // two benches use it, one of them the number of nodes

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use palpate::constraints::frame::ContactFrame;
use palpate::constraints::law::{Coulomb, Law};
use palpate::fem::assembly::{FemWorkspace, assemble};
use palpate::fem::block::{block, evenly};
use palpate::fem::factor::{Factor, FactorStatus, ReachStatus, ReachWorkspace, SymbolicFactor};
use palpate::fem::material::NeoHookean;
use palpate::fem::mesh::TetMesh;
use palpate::fem::model::{FemConfig, FemModel};
use palpate::fem::nodal_rows::NodalRows;
use palpate::solver::problem::ConstraintProblem;

/// Cells along each axis, and the edge (m) of each.
const CELLS: [usize; 3] = [23, 23, 5];
const CELL: f64 = 0.01;

/// How far inner nodes are moved at most, as part of the edge.
const JITTER: f64 = 0.15;

/// Kinds of tissue, each a tenth of a power of ten stiffer than the one before, from 3 kPa on.
const TISSUES: u16 = 11;

/// The inclusion: its number among the regions, Young's modulus (Pa), and radius (m).
const INCLUSION: u16 = TISSUES;
const INCLUSION_YOUNG: f64 = 3e6;
const INCLUSION_RADIUS: f64 = 0.016;

const POISSON: f64 = 0.45;
/// Step (s).
const DT: f64 = 1.0 / 30.0;

/// How far (m) the tool is pressed in, and how far it slides meanwhile.
const DEPTH: f64 = 3e-3;
const SLIDE: f64 = 1e-3;

/// The tool that presses.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Tool {
    /// A plate over the whole patch.
    Flat,
    /// A ball whose undeformed surface leaves the skin at the patch's rim.
    Round,
    /// A tool that the skin has settled on: all faces carry a smooth pressure, and the tool goes on by a tenth.
    Settled,
}

/// The skin under the tool.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skin {
    /// Friction coefficient.
    pub(crate) friction: f64,
    /// Where on its face each point lies hangs on this number.
    pub(crate) seed: u64,
}

impl Default for Skin {
    fn default() -> Self {
        Self { friction: 0.5, seed: 23 }
    }
}

/// Numbers in `[0, 1)`, the same in every run (SplitMix64).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A slab of tissue at rest, and the factor of its system.
pub(crate) struct Slab {
    mesh: TetMesh,
    model: FemModel,
    factor: Factor,
}

impl Slab {
    pub(crate) fn new() -> Self {
        let mut random = Random(11);
        let [x, y, z] = CELLS.map(|cells| evenly(0.0, CELL * cells as f64, cells));
        let mut mesh = block(&x, &y, &z);
        let boundary: Vec<u32> = mesh.node_sets.values().flatten().copied().collect();
        for i in (0..mesh.nodes.len()).filter(|&i| !boundary.contains(&(i as u32))) {
            mesh.nodes[i] += Vector3::from_fn(|_, _| CELL * JITTER * (2.0 * random.unit() - 1.0));
        }
        let centre = Vector3::new(0.5 * CELL * CELLS[0] as f64, 0.5 * CELL * CELLS[1] as f64, 0.03);
        mesh.regions = (mesh.tetrahedra.iter())
            .map(|t| {
                let middle = t.iter().map(|&i| mesh.nodes[i as usize]).sum::<Vector3<f64>>() / 4.0;
                let tissue = (random.unit() * f64::from(TISSUES)) as u16;
                if (middle - centre).norm() < INCLUSION_RADIUS { INCLUSION } else { tissue }
            })
            .collect();
        mesh.region_names = (0..=INCLUSION).map(|region| region.to_string()).collect();
        let young = |region: u16| match region {
            INCLUSION => INCLUSION_YOUNG,
            tissue => 3e3 * 10_f64.powf(f64::from(tissue) / f64::from(TISSUES - 1)),
        };
        let material = |region| NeoHookean { young: young(region), poisson: POISSON }.into();
        let model = FemModel::new(
            &mesh,
            &FemConfig {
                region_materials: (0..=INCLUSION).map(|region| (region.to_string(), material(region))).collect(),
                rayleigh_mass: 0.1,
                rayleigh_stiffness: 0.01,
                fixed: mesh.node_sets["z_min"].clone(),
                ..FemConfig::default()
            },
        )
        .expect("the slab is well formed");
        let mut ws = FemWorkspace::new(&model);
        assemble(&model, &model.rest_state(), DT, &[], &mut ws);
        let positions: Vec<_> = model.node_of_free().iter().map(|&i| mesh.nodes[i as usize]).collect();
        let symbolic = SymbolicFactor::new(model.pattern(), &positions).expect("the slab is connected");
        let mut factor = Factor::new(Arc::new(symbolic));
        assert_eq!(factor.refactor(&ws.system).status, FactorStatus::Ok);
        Self { mesh, model, factor }
    }

    /// Free nodes.
    pub(crate) fn nodes(&self) -> usize {
        self.model.free_nodes()
    }

    /// The faces of the top nearest to a point beside its middle.
    fn faces(&self, count: usize) -> Vec<[u32; 3]> {
        let top = &self.mesh.node_sets["z_max"];
        let mut faces: Vec<[u32; 3]> = (self.mesh.surface().triangles.iter().copied())
            .filter(|face| face.iter().all(|i| top.binary_search(i).is_ok()))
            .collect();
        let centre = self.centre();
        let distance = |face: &[u32; 3]| {
            let middle = face.iter().map(|&i| self.mesh.nodes[i as usize]).sum::<Vector3<f64>>() / 3.0;
            (middle - centre).norm()
        };
        faces.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        faces.truncate(count);
        faces
    }

    fn centre(&self) -> Vector3<f64> {
        Vector3::new(0.47 * CELL * CELLS[0] as f64, 0.52 * CELL * CELLS[1] as f64, CELL * CELLS[2] as f64)
    }

    /// The problem of a tool that presses on one point of each of so many neighbouring faces, and slides.
    pub(crate) fn problem(&self, contacts: usize, tool: Tool, skin: Skin) -> ConstraintProblem {
        let mut random = Random(skin.seed);
        let points: Vec<([u32; 3], [f64; 3], Vector3<f64>)> = (self.faces(contacts).into_iter())
            .map(|face| {
                let weights = [0.2 + random.unit(), 0.2 + random.unit(), 0.2 + random.unit()];
                let weights = weights.map(|w| w / weights.iter().sum::<f64>());
                (face, weights, face.iter().zip(weights).map(|(&i, w)| self.mesh.nodes[i as usize] * w).sum())
            })
            .collect();
        let from_axis = |point: &Vector3<f64>| point - self.centre();
        let rim = points.iter().map(|(_, _, point)| from_axis(point).norm()).fold(0.0, f64::max);
        let radius = (rim * rim + DEPTH * DEPTH) / (2.0 * DEPTH);
        let mut rows = NodalRows::with_capacity(3 * contacts, 3);
        let mut problem = ConstraintProblem::with_capacity(3 * contacts);
        problem.reset(3 * contacts).expect("it was made for as many rows");
        for (k, (face, weights, point)) in points.iter().enumerate() {
            let from_ball = from_axis(point) - Vector3::z() * (radius - DEPTH);
            let (normal, gap) = match tool {
                Tool::Flat | Tool::Settled => (-Vector3::z(), -DEPTH),
                Tool::Round => (from_ball.normalize(), from_ball.norm() - radius),
            };
            // The tool has moved along the skin: by as much, and the other way, the skin has slid on it.
            let slide = Vector3::new(-0.8, -0.6, 0.0) * SLIDE;
            for (c, direction) in ContactFrame::new(normal).directions().into_iter().enumerate() {
                let free = face.map(|i| self.model.free_of_node()[i as usize]);
                rows.push_row(free.into_iter().zip(weights.map(|w| direction * w)));
                problem.delta_free_mut()[3 * k + c] = if c == 0 { gap } else { direction.dot(&slide) };
            }
            problem.push_block(Law::Coulomb(Coulomb { friction: skin.friction }));
        }
        let mut w = DMatrix::zeros(rows.len(), rows.len());
        let mut reach = ReachWorkspace::new(self.factor.symbolic(), rows.len());
        assert_eq!(self.factor.compliance_into(&rows, DT * DT, &mut w, &mut reach).status, ReachStatus::Ok);
        problem.compliance_mut().copy_from(&w);
        if matches!(tool, Tool::Settled) {
            // Hertz's pressure; without its forces the skin would spring back by up to the depth.
            let pressure = DVector::from_fn(rows.len(), |r, _| match r % 3 {
                0 => (1.0 - 0.99 * (from_axis(&points[r / 3].2).norm() / rim).powi(2)).sqrt(),
                _ => 0.0,
            });
            let spring = &w * pressure;
            let scale = DEPTH / spring.amax();
            for (gap, spring) in problem.delta_free_mut().iter_mut().zip(spring.iter()) {
                *gap = 0.1 * *gap - scale * spring;
            }
        }
        problem
    }
}
