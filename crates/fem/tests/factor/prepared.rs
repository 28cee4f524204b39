//! Half solves of nodes that whoever makes a factor prepares for whoever uses it.

use std::sync::Arc;

use crate::factor_bodies::Body;
use nalgebra::{DMatrix, Vector3};
use palpate_fem::factor::{Factor, FactorStatus, ReachStatus, ReachWorkspace, SymbolicFactor};
use palpate_fem::nodal_rows::NodalRows;

const NODES: [u32; 30] = {
    let mut nodes = [0; 30];
    let mut k = 0;
    while k < 30 {
        nodes[k] = 11 * k as u32;
        k += 1;
    }
    nodes
};

fn unit_rows(nodes: &[u32]) -> NodalRows {
    let mut rows = NodalRows::with_capacity(3 * nodes.len(), 1);
    nodes.iter().for_each(|&node| (0..3).for_each(|k| rows.push_row([(node, Vector3::ith(k, 1.0))])));
    rows
}

/// Memory of 90 rows, which keeps up to 60 nodes.
fn workspace(symbolic: &SymbolicFactor) -> ReachWorkspace {
    ReachWorkspace::new(symbolic, 90).keeping_nodes(symbolic)
}

fn compliance(factor: &Factor, nodes: &[u32], ws: &mut ReachWorkspace) -> DMatrix<f64> {
    let rows = unit_rows(nodes);
    let mut w = DMatrix::zeros(rows.len(), rows.len());
    assert_eq!(factor.compliance_into(&rows, 1.0, &mut w, ws).status, ReachStatus::Ok);
    w
}

fn factor_of(body: &Body) -> Factor {
    let symbolic = Arc::new(SymbolicFactor::new(&body.pattern, &body.positions).unwrap());
    let mut factor = Factor::new(symbolic);
    assert_eq!(factor.refactor(&body.system(2)).status, FactorStatus::Ok);
    factor
}

#[test]
fn prepared_nodes_give_the_compliance_to_the_bit_and_are_not_solved_for_again() {
    let body = Body::block([8, 7, 6], 1);
    let factor = factor_of(&body);
    let expected = compliance(&factor, &NODES, &mut workspace(factor.symbolic()));
    let mut ws = workspace(factor.symbolic());
    let mut prepared = ws.room_for_prepared().unwrap();
    prepared.prepare(&factor, &NODES);
    assert_eq!((prepared.len(), prepared.is_of(&factor), ws.kept_nodes()), (30, true, 0));
    ws.take_prepared(&factor, &mut prepared);
    assert_eq!((ws.kept_nodes(), prepared.is_empty()), (30, true));
    assert_eq!(compliance(&factor, &NODES, &mut ws), expected, "solved for together as they would have been");
    assert_eq!(compliance(&factor, &NODES[..7], &mut ws), expected.view((0, 0), (21, 21)));
    assert_eq!(ws.kept_nodes(), 30);
    // a node that was not prepared joins them
    let w = compliance(&factor, &[5, 0], &mut ws);
    assert_eq!(ws.kept_nodes(), 31);
    let alone = compliance(&factor, &[5, 0], &mut workspace(factor.symbolic()));
    assert!((&w - &alone).amax() < 1e-13 * alone.amax());
}

#[test]
fn the_latest_two_compliances_tell_which_nodes_to_prepare_and_prepared_ones_do_not_count() {
    let body = Body::block([8, 7, 6], 1);
    let factor = factor_of(&body);
    let mut ws = workspace(factor.symbolic());
    let mut prepared = ws.room_for_prepared().unwrap();
    prepared.prepare(&factor, &NODES);
    ws.take_prepared(&factor, &mut prepared);
    let mut latest = Vec::with_capacity(prepared.capacity());
    ws.latest_nodes(&mut latest);
    assert_eq!(latest, [0_u32; 0], "no compliance has wanted them");
    for nodes in [&NODES[..4], &NODES[2..6], &NODES[20..24], &[7]] {
        compliance(&factor, nodes, &mut ws);
    }
    ws.latest_nodes(&mut latest);
    latest.sort_unstable();
    assert_eq!(latest, [7, 220, 231, 242, 253]);
    let mut few = Vec::with_capacity(3);
    ws.latest_nodes(&mut few);
    assert_eq!(few.len(), 3, "no more than there is room for");
}

#[test]
fn what_was_prepared_with_another_factor_is_left_where_it_is() {
    let body = Body::block([8, 7, 6], 1);
    let mut factor = factor_of(&body);
    let mut ws = workspace(factor.symbolic());
    let mut prepared = ws.room_for_prepared().unwrap();
    prepared.prepare(&factor, &NODES);
    assert_eq!(factor.refactor(&body.system(3)).status, FactorStatus::Ok);
    assert!(!prepared.is_of(&factor));
    ws.take_prepared(&factor, &mut prepared);
    assert_eq!((ws.kept_nodes(), prepared.len()), (0, 30));

    // nodes that are not there are left out, and those beyond the room
    let many: Vec<u32> = (0..200).map(|k| 3 * k).collect();
    prepared.prepare(&factor, &many);
    assert_eq!((prepared.len(), prepared.capacity()), (60, 60));
    prepared.prepare(&factor, &[u32::MAX, 4, 4, body.free_nodes() as u32]);
    assert_eq!((prepared.len(), prepared.is_of(&factor)), (1, true));

    // of no factor
    let invalid = Factor::new(Arc::clone(factor.symbolic()));
    prepared.prepare(&invalid, &NODES);
    assert!(!prepared.is_of(&invalid) && !prepared.is_of(&factor));

    // a workspace that has some of this factor keeps them
    compliance(&factor, &NODES[..5], &mut ws);
    prepared.prepare(&factor, &NODES);
    ws.take_prepared(&factor, &mut prepared);
    assert_eq!((ws.kept_nodes(), prepared.len()), (5, 30));

    // one of another size has no use for it
    let mut other = ReachWorkspace::new(factor.symbolic(), 30).keeping_nodes(factor.symbolic());
    other.take_prepared(&factor, &mut prepared);
    assert_eq!((other.kept_nodes(), prepared.len()), (0, 30));
    assert!(ReachWorkspace::new(factor.symbolic(), 30).room_for_prepared().is_none());
}
