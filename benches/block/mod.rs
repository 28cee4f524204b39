//! Contacts of the bundled block with a ball that is pressed in and dragged: at nodes of its skin, and at points of its faces
//! that lie closer together than the elements are large. The problems are those of `palpate chart solvers`.
#![allow(dead_code)] // two benches use it, one of them the chart's drag

use nalgebra::{DMatrix, DVector, Isometry3};
use palpate::collision::detection::ContactKind;
use palpate::collision::shape::ToolShape;
use palpate::scene::Scene;
use palpate::simulation::Simulation;
use palpate::solver::problem::ConstraintProblem;
use palpate::step::StepStatus;

/// Cells along each axis.
const CELLS: [usize; 3] = [16, 16, 8];

/// Radius (m) of the ball.
const BALL: f64 = 0.1;

/// Height of the block's skin, and of the ball above it at first (m).
const TOP: f64 = 0.03;
const ABOVE: f64 = 1e-3;

/// Steps, and those of them in which the ball goes down by [`DOWN`] (m).
const STEPS: u32 = 8;
const PRESSING: f64 = 6.0;
const DOWN: f64 = 1e-3;

/// How the ball touches and is dragged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drag {
    /// Where contacts are.
    pub(crate) at: ContactKind,
    /// Friction coefficient.
    pub(crate) friction: f64,
    /// Way along in each of the last steps, m.
    pub(crate) along: f64,
}

impl Drag {
    /// That of the chart.
    pub(crate) fn of_chart(at: ContactKind) -> Self {
        Self { at, friction: 0.3, along: 2e-3 }
    }
}

/// The problems of the contacts that press most, so many of them each.
pub(crate) fn problems<const N: usize>(drag: Drag, sizes: [usize; N]) -> [ConstraintProblem; N] {
    let mut scene = Scene::bundled("block").expect("the scene is bundled");
    scene
        .edit(|scene| {
            scene.bodies[0].block.as_mut().expect("the body is a block").cells = CELLS;
            scene.hand.path[0].position = [0.0, 0.0, TOP + BALL + ABOVE];
            scene.tools[0].shape = ToolShape::sphere(BALL).expect("the radius is positive").into();
            (scene.contact.at, scene.contact.friction) = (drag.at, drag.friction);
            scene.contact.max_contacts = sizes.into_iter().max().unwrap_or(1);
        })
        .expect("the change is valid");
    let world = scene.build().expect("the scene is valid");
    let mut simulation = Simulation::new(&world).expect("the block has a factor");
    for k in (0..=STEPS).map(f64::from) {
        let (along, down) = (drag.along * (k - PRESSING).max(0.0), DOWN * k.min(PRESSING));
        let report = simulation.step(&(Isometry3::translation(along, 0.0, -down) * world.first_pose()));
        assert_eq!(report.status, StepStatus::Advanced, "step {k}");
    }
    let whole = simulation.workspace().problem();
    sizes.map(|size| deepest(whole, size))
}

/// The problem of the contacts that press most.
fn deepest(whole: &ConstraintProblem, contacts: usize) -> ConstraintProblem {
    let mut chosen: Vec<usize> = (0..whole.blocks().len()).collect();
    let gap = |k: usize| whole.delta_free()[whole.blocks()[k].start];
    chosen.sort_by(|&a, &b| gap(a).total_cmp(&gap(b)));
    assert!(contacts <= chosen.len(), "{} of {contacts} contacts", chosen.len());
    chosen.truncate(contacts);
    chosen.sort_unstable();
    let blocks = || chosen.iter().map(|&k| whole.blocks()[k]);
    let rows: Vec<usize> = blocks().flat_map(|block| block.start..block.start + block.law.rows()).collect();
    let (w, free) = (whole.compliance(), whole.delta_free());
    let compliance = DMatrix::from_fn(rows.len(), rows.len(), |i, j| w[(rows[i], rows[j])]);
    let free = DVector::from_fn(rows.len(), |i, _| free[rows[i]]);
    ConstraintProblem::new(compliance, free, blocks().map(|block| block.law)).expect("it is part of one")
}
