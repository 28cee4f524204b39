//! The problems on which solvers are compared: contact of soft bodies in bundled scenes, rigid bodies whose compliance is
//! rank-deficient or badly scaled, and the files of an independent project where they are at hand.

use std::path::{Path, PathBuf};

use miette::{Result, miette};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3};
use palpate::collision::detection::ContactKind;
use palpate::collision::shape::ToolShape;
use palpate::constraints::law::{Coulomb, Law, Signorini};
use palpate::prelude::*;
use palpate::scene::SceneDescription;
use palpate::solver::problem::ConstraintProblem;
use palpate::solver::problem_file;
use palpate::step::StepStatus;

use crate::chart::{Settings, Work};

/// A problem with its name.
#[derive(Clone, Debug)]
pub(crate) struct Named {
    /// Where it comes from.
    pub(crate) name: String,
    /// The problem.
    pub(crate) problem: ConstraintProblem,
}

/// Radius (m) of the ball that presses: many contacts carry force at once.
const BALL: f64 = 0.1;

/// Lattice constant (m) of a liver whose skin has enough nodes below the ball: 8,000 in all.
const LIVER_CELL: f64 = 0.0084;

/// Friction of tissue and ball.
const FRICTION: f64 = 0.3;

/// Rows of a file above which a quick chart leaves it out.
const QUICK_ROWS: usize = 60;

/// Contact of soft bodies: nodes of the skin, and points on its faces that lie closer together than the elements are large.
pub(crate) fn tissue(settings: &Settings, work: &Work) -> Result<Vec<Named>> {
    let (cells, sizes): (_, &[usize]) =
        if settings.quick { ([8, 8, 4], &[10, 30]) } else { ([16, 16, 8], &[10, 30, 60, 150]) };
    let mut problems = Vec::new();
    for (at, kind) in [("nodes", ContactKind::Nodes), ("faces", ContactKind::Faces)] {
        if !work.next(&format!("block, contact at {at}")) {
            return Ok(problems);
        }
        let change = |scene: &mut SceneDescription| {
            if let Some(block) = &mut scene.bodies[0].block {
                block.cells = cells;
            }
            scene.hand.path[0].position = [0.0, 0.0, 0.03 + BALL + 1e-3];
            press_by_ball(scene, kind, sizes);
        };
        let way = |k: f64| [2e-3 * (k - 6.0).max(0.0), 0.0, -1e-3 * k.min(6.0)];
        problems.extend(parts(&format!("block, {at}"), &contact("block", None, change, way, 8)?, sizes));
    }
    if !settings.quick && work.next("liver, contact at nodes") {
        let change = |scene: &mut SceneDescription| {
            scene.hand.path.iter_mut().for_each(|key| key.position[1] -= BALL);
            press_by_ball(scene, ContactKind::Nodes, sizes);
        };
        let pressed = contact("liver", Some(LIVER_CELL), change, |k| [0.0, 1.5e-3 * k, 0.0], 27)?;
        problems.extend(parts("liver, nodes", &pressed, sizes));
    }
    Ok(problems)
}

fn press_by_ball(scene: &mut SceneDescription, kind: ContactKind, sizes: &[usize]) {
    if let Ok(ball) = ToolShape::sphere(BALL) {
        scene.tools[0].shape = ball.into();
    }
    (scene.contact.at, scene.contact.friction) = (kind, FRICTION);
    scene.contact.max_contacts = sizes.iter().copied().max().unwrap_or(1);
}

/// The contact problem of a bundled scene, with another lattice constant (m) if given, after so many steps; the tool moves away from its first place by `way`.
fn contact(
    name: &str,
    cell: Option<f64>,
    change: impl FnOnce(&mut SceneDescription),
    way: impl Fn(f64) -> [f64; 3],
    steps: u32,
) -> Result<ConstraintProblem> {
    let mut scene = Scene::bundled(name).map_err(|e| miette!("{e}"))?;
    if let Some(cell) = cell {
        scene.use_cell(cell).map_err(|e| miette!("{e}"))?;
    }
    scene.edit(change).map_err(|e| miette!("{e}"))?;
    let world = scene.build().map_err(|e| miette!("{e}"))?;
    let mut sim = Simulation::new(&world).map_err(|e| miette!("{e}"))?;
    for k in 0..=steps {
        let [x, y, z] = way(f64::from(k));
        let report = sim.step(&(Isometry3::translation(x, y, z) * world.first_pose()));
        if report.status != StepStatus::Advanced {
            return Err(miette!("{name}: step {k} failed"));
        }
    }
    Ok(sim.workspace().problem().clone())
}

/// The contacts that press most, so many of them for each size that there is.
fn parts(name: &str, whole: &ConstraintProblem, sizes: &[usize]) -> Vec<Named> {
    let mut order: Vec<usize> = (0..whole.blocks().len()).collect();
    let gap = |k: usize| whole.delta_free()[whole.blocks()[k].start];
    order.sort_by(|&a, &b| gap(a).total_cmp(&gap(b)));
    let sizes = sizes.iter().filter(|&&size| size <= order.len());
    let named = |&size: &usize| {
        let mut chosen = order[..size].to_vec();
        chosen.sort_unstable();
        part(whole, &chosen).map(|problem| Named { name: format!("{name}, {size} contacts"), problem })
    };
    sizes.filter_map(named).collect()
}

fn part(whole: &ConstraintProblem, chosen: &[usize]) -> Option<ConstraintProblem> {
    let blocks = || chosen.iter().map(|&k| whole.blocks()[k]);
    let rows: Vec<usize> = blocks().flat_map(|b| b.start..b.start + b.law.rows()).collect();
    let w = whole.compliance();
    let compliance = DMatrix::from_fn(rows.len(), rows.len(), |i, j| w[(rows[i], rows[j])]);
    let free = DVector::from_fn(rows.len(), |i, _| whole.delta_free()[rows[i]]);
    ConstraintProblem::new(compliance, free, blocks().map(|b| b.law)).ok()
}

/// Rigid bodies and springs: rank-deficient, wedged, jammed, and six orders of magnitude apart.
pub(crate) fn rigid() -> Vec<Named> {
    let coulomb = |friction| Law::from(Coulomb { friction });
    let masses = [1.0, 1e2, 1e-1, 1e3, 1e-3];
    let all = [
        ("rigid stool", stool()),
        ("wedged block", wedge()),
        ("slender rod, friction 1", rod(1.0)),
        ("stack, masses 1e6 apart", stack(&masses, Signorini.into())),
        ("stack with friction, masses 1e6 apart", stack(&masses, coulomb(0.3))),
        ("springs 1e6 apart", springs(1e6)),
    ];
    all.into_iter().filter_map(|(name, problem)| Some(Named { name: name.into(), problem: problem? })).collect()
}

/// Displacement (m) of a body that falls freely for one step of a millisecond.
const FALL: f64 = 9.81e-6;
const STEP: f64 = 1e-3;

/// Four legs of a stool of unit mass and inertia: rank 3.
fn stool() -> Option<ConstraintProblem> {
    let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    let rows = DMatrix::from_fn(4, 3, |leg, dof| [1.0, corners[leg][1], -corners[leg][0]][dof]);
    let w = &rows * rows.transpose() * (STEP * STEP);
    ConstraintProblem::new(w, DVector::from_element(4, -FALL), [Law::from(Signorini); 4]).ok()
}

/// A block of 1 kg held between two walls by friction: forces of any size balance.
fn wedge() -> Option<ConstraintProblem> {
    let mut rows = DMatrix::zeros(6, 3);
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    rows.fixed_view_mut::<3, 3>(3, 0).copy_from(&Matrix3::from_diagonal(&[-1.0, 1.0, 1.0].into()));
    let w = &rows * rows.transpose() * (STEP * STEP);
    let free = DVector::from_column_slice(&[-2e-5, -FALL, 0.0, 2e-5, -FALL, 0.0]);
    ConstraintProblem::new(w, free, [Law::from(Coulomb { friction: 0.6 }); 2]).ok()
}

/// Painlevé's rod of unit mass at the angle of its smallest critical friction.
fn rod(friction: f64) -> Option<ConstraintProblem> {
    let (sin, cos) = 2.0_f64.atan().sin_cos();
    let (n, nt, t) = (1.0 + 3.0 * cos * cos, -3.0 * sin * cos, 1.0 + 3.0 * sin * sin);
    let w = DMatrix::from_row_slice(3, 3, &[n, nt, 0.0, nt, t, 0.0, 0.0, 0.0, 4.0]) * (STEP * STEP);
    let free = DVector::from_column_slice(&[-FALL, 0.1 * STEP, 0.0]);
    ConstraintProblem::new(w, free, [Law::from(Coulomb { friction })]).ok()
}

/// Blocks of these masses (kg) on one another, pushed sideways.
fn stack(masses: &[f64], law: Law) -> Option<ConstraintProblem> {
    let (n, rows) = (masses.len(), law.rows());
    let h = DMatrix::from_fn(n * rows, 3 * n, |row, dof| {
        let (k, axis, body) = (row / rows, row % rows, dof / 3);
        let sign = f64::from(i8::from(body == k)) - f64::from(i8::from(body + 1 == k));
        if axis == dof % 3 { sign } else { 0.0 }
    });
    let inverse = DVector::from_fn(3 * n, |dof, _| STEP * STEP / masses[dof / 3]);
    let fall = DVector::from_fn(3 * n, |dof, _| [-FALL, 0.1 * FALL, 0.0][dof % 3]);
    let w = &h * DMatrix::from_diagonal(&inverse) * h.transpose();
    ConstraintProblem::new((&w + w.transpose()) * 0.5, &h * fall, vec![law; n]).ok()
}

/// Four contacts of coupled springs whose stiffnesses are up to `ratio` apart.
fn springs(ratio: f64) -> Option<ConstraintProblem> {
    let stiffness = |k: usize| 1e2 * ratio.powf(k as f64 / 11.0);
    let w = DMatrix::from_fn(12, 12, |i, j| {
        let pair = 1.0 / (stiffness(i) * stiffness(j)).sqrt();
        if i == j { pair } else { 0.3 * pair }
    });
    let free = DVector::from_fn(12, |i, _| if i % 3 == 0 { -1e-3 } else { 2e-4 });
    ConstraintProblem::new(w, free, [Law::from(Coulomb { friction: 0.5 }); 4]).ok()
}

/// The problem files beside the folder of reference data, and what a reader should know of them.
pub(crate) fn files(settings: &Settings) -> Result<(Vec<Named>, Option<String>)> {
    let absent = "no problem files: those of an independent project were left out (--data FOLDER, with FOLDER/../lcp)";
    let beside = settings.data.as_deref().map(|data| data.join("..").join("lcp"));
    let Some(folder) = beside.filter(|folder| folder.is_dir()) else { return Ok((Vec::new(), Some(absent.into()))) };
    let mut problems = Vec::new();
    let mut large = 0;
    for kind in ["friction", "lcp"] {
        for path in data_files(&folder.join(kind)) {
            let problem = problem_file::open(&path).map_err(|e| miette!("{}: {e}", path.display()))?;
            if settings.quick && problem.rows() > QUICK_ROWS {
                large += 1;
                continue;
            }
            let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
            problems.push(Named { name, problem });
        }
    }
    Ok((problems, (large > 0).then(|| format!("{large} problem files of more than {QUICK_ROWS} rows were left out"))))
}

fn data_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut files: Vec<_> = entries.filter(|path| path.extension().is_some_and(|e| e == "dat")).collect();
    files.sort();
    files
}
