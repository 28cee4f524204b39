//! A sound snapshot with all that ticks read, and each of its numbers as what can be overwritten.

use crate::sheet::{Ball, MIDDLE, Sheet, pose};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use palpate_constraints::law::{Coulomb, Law, Signorini, Tresca};
use palpate_haptics::body_contact::{BodyContact, ToolPart};
use palpate_haptics::snapshot::{HapticSnapshot, SnapshotContact};

const RADIUS: f64 = 5e-3;

/// Where the ball dents the sheet by `depth`.
pub(crate) fn over(depth: f64) -> Vector3<f64> {
    Vector3::z() * (RADIUS - depth)
}

pub(crate) fn ball() -> Ball {
    Ball::at_nodes(RADIUS)
}

/// A wall that the tissue meets, or one that the tool meets at its side.
fn wall(feature: u64, tool: Option<ToolPart>) -> BodyContact {
    let (axes, gap) = match tool {
        None => ([Vector3::z(), Vector3::x(), Vector3::y()], 2e-4),
        Some(_) => ([Vector3::x(), Vector3::y(), Vector3::z()], -1e-4),
    };
    let law: Law = Coulomb { friction: 0.3 }.into();
    let (free, still) = (Vector3::x() * gap, Vector3::zeros());
    let frame = Matrix3::from_columns(&axes);
    BodyContact { feature, law, frame, tool, gap, free, drift: still, flow: still, force: still }
}

/// The sheet with friction, viscosity and two walls, seen from the ball that presses it; and a frozen contact of the same
/// tool, for ticks without patches.
pub(crate) fn sound(step: u64) -> HapticSnapshot {
    let (ball, place) = (ball(), over(1e-3));
    let sheet = Sheet { friction: 0.4, coupling: 0.3, ..Sheet::springs(1e-3) };
    let plain = sheet.snapshot(step, &ball, &pose(place));
    let mut snapshot = HapticSnapshot::with_bodies(ball.detection.max_contacts, 40, 4);
    snapshot.clear();
    (snapshot.step, snapshot.dt, snapshot.valid, snapshot.tool_pose) = (step, plain.dt, true, plain.tool_pose);
    let law = Coulomb { friction: 0.4 }.into();
    let (delta_free, lambda) = (&[-1e-3, 0.0, 0.0], &[0.5, 0.0, 0.0]);
    assert!(snapshot.push(&SnapshotContact { law, feature: 9, tool_rows: &rows(), delta_free, lambda }));
    snapshot.compliance_mut().copy_from_slice(&[1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3]);

    let patch = &mut snapshot.patch;
    assert!(patch.skin_mut().copy_from(plain.patch.skin()));
    let part = ToolPart { lever: Vector3::x() * -RADIUS, opens: Vector3::zeros() };
    assert!(patch.bodies.push(wall(1 << 52, None), true) && patch.bodies.push(wall(2 << 52, Some(part)), false));
    patch.q_free_mut().copy_from_slice(plain.patch.q_free());
    patch.force_mut().fill(Vector3::zeros());
    let (n, skin) = (patch.degrees_of_freedom(), plain.patch.degrees_of_freedom());
    let first = n - skin;
    let c = patch.compliance_mut();
    c.fill(0.0);
    for (k, column) in plain.patch.compliance().chunks_exact(skin).enumerate() {
        c[(first + k) * n + first..(first + k + 1) * n].copy_from_slice(column);
    }
    (0..first).for_each(|i| c[i * n + i] = 1e-3);
    let middle = patch.skin().number_of(MIDDLE).expect("it is under the ball");
    let of_wall = patch.compliance_mut();
    (of_wall[first + 3 * middle + 2], of_wall[(first + 3 * middle + 2) * n]) = (2e-4, 2e-4);
    patch.relieve();
    (patch.valid, patch.law, patch.viscosity) = (true, law, 0.02);
    snapshot
}

/// A number of a snapshot, and how it is overwritten.
pub(crate) type Field = (&'static str, fn(&mut HapticSnapshot, f64));

fn first_body(snapshot: &mut HapticSnapshot) -> &mut BodyContact {
    &mut snapshot.patch.bodies.all_mut()[0]
}

fn body_at_tool(snapshot: &mut HapticSnapshot) -> &mut BodyContact {
    &mut snapshot.patch.bodies.all_mut()[1]
}

fn part(snapshot: &mut HapticSnapshot) -> &mut ToolPart {
    body_at_tool(snapshot).tool.as_mut().expect("it touches the tool")
}

fn middle(snapshot: &HapticSnapshot) -> usize {
    snapshot.patch.skin().number_of(MIDDLE).expect("it is under the ball")
}

/// A frozen contact like that of `sound`, with these numbers.
fn frozen(snapshot: &mut HapticSnapshot, rows: [[f64; 6]; 3], law: Law, delta_free: f64, lambda: f64) {
    let patch = snapshot.patch.clone();
    let kept = (snapshot.step, snapshot.dt, snapshot.tool_pose);
    snapshot.clear();
    let contact = SnapshotContact {
        law,
        feature: 9,
        tool_rows: &rows[..law.rows()],
        delta_free: &[delta_free, 0.0, 0.0][..law.rows()],
        lambda: &[lambda, 0.0, 0.0][..law.rows()],
    };
    assert!(snapshot.push(&contact));
    let n = law.rows();
    (0..n * n).for_each(|k| snapshot.compliance_mut()[k] = if k % (n + 1) == 0 { 1e-3 } else { 0.0 });
    (snapshot.step, snapshot.dt, snapshot.tool_pose, snapshot.patch, snapshot.valid) =
        (kept.0, kept.1, kept.2, patch, true);
}

fn rows() -> [[f64; 6]; 3] {
    [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, -RADIUS, 0.0], [0.0, 1.0, 0.0, RADIUS, 0.0, 0.0]]
}

fn quaternion(s: &mut HapticSnapshot, x: f64) {
    s.tool_pose.rotation = UnitQuaternion::new_unchecked(Quaternion::new(1.0, x, 0.0, 0.0));
}

/// What ticks read of any snapshot.
pub(crate) const OF_ALL: &[Field] = &[
    ("tool_pose.translation", |s, x| s.tool_pose.translation.vector.y = x),
    ("tool_pose.rotation", quaternion),
    ("opening", |s, x| s.opening = x),
    ("dt", |s, x| s.dt = x),
];

/// What ticks read of a patch.
pub(crate) const OF_PATCH: &[Field] = &[
    ("q_free under the ball", |s, x| {
        let k = middle(s);
        s.patch.q_free_mut()[k].z = x
    }),
    ("q_free aside", |s, x| s.patch.q_free_mut()[0].x = x),
    ("viscosity", |s, x| s.patch.viscosity = x),
    ("drift under the ball", |s, x| {
        let k = middle(s);
        s.patch.drift_mut()[k].z = x
    }),
    ("drift aside", |s, x| s.patch.drift_mut()[0].y = x),
    ("flow under the ball", |s, x| {
        let k = middle(s);
        s.patch.flow_mut()[k].x = x
    }),
    ("flow aside", |s, x| s.patch.flow_mut()[0].z = x),
    ("force", |s, x| {
        let k = middle(s);
        s.patch.force_mut()[k].z = x
    }),
    ("force before relief", |s, x| {
        let k = middle(s);
        s.patch.force_mut()[k].z = x;
        s.patch.relieve()
    }),
    ("compliance", |s, x| s.patch.compliance_mut().fill(x)),
    ("compliance of the middle", |s, x| {
        let (k, n) = (middle(s), s.patch.degrees_of_freedom());
        s.patch.compliance_mut()[(n + 1) * (3 * (k + 1) + 2)] = x;
    }),
    ("friction", |s, x| s.patch.law = Coulomb { friction: x }.into()),
    ("limit", |s, x| s.patch.law = Tresca { limit: x }.into()),
    ("body frame", |s, x| first_body(s).frame[(2, 0)] = x),
    ("body gap", |s, x| first_body(s).gap = x),
    ("body free", |s, x| first_body(s).free.x = x),
    ("body free along", |s, x| first_body(s).free.y = x),
    ("body drift", |s, x| first_body(s).drift.x = x),
    ("body flow", |s, x| first_body(s).flow.z = x),
    ("body force", |s, x| first_body(s).force.x = x),
    ("body friction", |s, x| first_body(s).law = Coulomb { friction: x }.into()),
    ("frame at the tool", |s, x| body_at_tool(s).frame[(0, 0)] = x),
    ("gap at the tool", |s, x| body_at_tool(s).gap = x),
    ("free at the tool", |s, x| body_at_tool(s).free.x = x),
    ("drift at the tool", |s, x| body_at_tool(s).drift.y = x),
    ("force at the tool", |s, x| body_at_tool(s).force.x = x),
    ("friction at the tool", |s, x| body_at_tool(s).law = Coulomb { friction: x }.into()),
    ("lever", |s, x| part(s).lever.z = x),
    ("opens", |s, x| part(s).opens.x = x),
];

/// What ticks without a patch read.
pub(crate) const OF_ROWS: &[Field] = &[
    ("tool_rows of the normal", |s, x| {
        let mut rows = rows();
        rows[0][2] = x;
        frozen(s, rows, Coulomb { friction: 0.4 }.into(), -1e-3, 0.5);
    }),
    ("tool_rows of a torque", |s, x| {
        let mut rows = rows();
        rows[1][4] = x;
        frozen(s, rows, Coulomb { friction: 0.4 }.into(), -1e-3, 0.5);
    }),
    ("delta_free", |s, x| frozen(s, rows(), Signorini.into(), x, 0.5)),
    ("lambda", |s, x| frozen(s, rows(), Coulomb { friction: 0.4 }.into(), -1e-3, x)),
    ("friction", |s, x| frozen(s, rows(), Coulomb { friction: x }.into(), -1e-3, 0.5)),
    ("limit", |s, x| frozen(s, rows(), Tresca { limit: x }.into(), -1e-3, 0.5)),
    ("compliance", |s, x| s.compliance_mut()[4] = x),
    ("gripper_rows", |s, x| s.gripper_rows_mut()[0] = x),
];
