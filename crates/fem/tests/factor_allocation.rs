//! Nothing is allocated after set-up: refactorisation, solves, half solves, compliance, correction and conjugate
//! gradients under an allocator that counts violations.

mod factor_bodies;

use std::sync::Arc;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, reset_violation_count, violation_count};
use factor_bodies::{Body, Random};
use nalgebra::{DMatrix, Matrix3};
use palpate_fem::factor::{
    ChangeStatus, Factor, FactorPrecision, FactorStatus, MatrixChange, ReachStatus, ReachWorkspace, SolveWorkspace,
    SymbolicFactor, UpdateStatus,
};
use palpate_fem::pcg::{PcgConfig, PcgStatus, PcgWorkspace, pcg};
use palpate_fem::preconditioner::{BlockJacobi, FactorPreconditioner, WarpedPreconditioner};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn run_paths_allocate_nothing() {
    // large enough that fronts, solves and rows are cut into tasks
    let body = Body::block([12, 12, 11], 1);
    let n = body.free_nodes();
    let symbolic = SymbolicFactor::new(&body.pattern, &body.positions).unwrap().with_room_for_changes(40);
    let symbolic = Arc::new(symbolic);
    let mut factor = Factor::with_packed_copy(symbolic.clone());
    let mut single = factor.clone().computed_in(FactorPrecision::Single);
    let matrices = [body.system(2), body.system(3)];
    let mut change = MatrixChange::with_capacity(n, 40);
    let mut stiffened = matrices[0].clone();
    stiffened.blocks[body.pattern.find(9, 9).unwrap()] *= 2.0;
    let held: Vec<bool> = (0..n).map(|k| k % 70 == 3).collect();
    let free = vec![false; n];
    let mut indefinite = body.system(4);
    indefinite.blocks[0] = -Matrix3::identity();
    let rows = [
        body.contact_rows(10, 5),
        body.scattered_contact_rows(30, 6),
        body.contact_rows(3, 7),
        body.contact_rows(20, 8),
    ];
    let rotations = vec![Matrix3::identity(); n];
    let mut w = DMatrix::zeros(90, 90);
    let mut reach = ReachWorkspace::new(&symbolic, 90);
    let mut nodal = ReachWorkspace::new(&symbolic, 90).keeping_nodes(&symbolic);
    let mut solve = SolveWorkspace::with_columns(&symbolic, 4);
    let mut iteration = PcgWorkspace::new(n);
    let mut jacobi = BlockJacobi::new(n);
    let b = Random(8).vector(3 * n);
    let lambda = Random(9).vector(90);
    let mut x = vec![0.0; 3 * n];
    let mut many = Random(10).vector(3 * n * 4);

    // on one rayon worker, as on the step thread: work that is handed to a pool from outside allocates queue blocks
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let violations = pool.install(|| {
            let mut round = |k: usize| {
                assert_no_alloc(|| {
                    let a = &matrices[k % 2];
                    let statuses = [
                        factor.refactor(&indefinite).status != FactorStatus::Ok,
                        factor.refactor(&matrices[0]).status == FactorStatus::Ok,
                        // which tries double precision after single
                        single.refactor(&indefinite).status != FactorStatus::Ok,
                        single.refactor(&matrices[0]).precision == FactorPrecision::Single,
                        factor.solve(&mut x, &mut solve).is_ok(),
                        factor.solve_columns(&mut many, &mut solve).is_ok(),
                        change.between(&matrices[0], &stiffened, &held) == ChangeStatus::Ok,
                        factor.change(&change) == UpdateStatus::Ok,
                        factor.solve(&mut x, &mut solve).is_ok(),
                        change.between(&matrices[0], &stiffened, &free) == ChangeStatus::Ok,
                        factor.change(&change) == UpdateStatus::Ok,
                    ];
                    let rows = &rows[k % 4];
                    let m = rows.len();
                    let report = factor.compliance_into(rows, 1e-3, w.view_mut((0, 0), (m, m)), &mut reach);
                    let by_nodes = factor.compliance_into(rows, 1e-3, w.view_mut((0, 0), (m, m)), &mut nodal);
                    let corrected = factor.correct(&lambda[..m], &mut x, &mut reach).is_ok()
                        && factor.guess_correction(&lambda[..m], &mut x, &mut nodal).is_ok();
                    let mut warped =
                        WarpedPreconditioner { factor: &factor, rotations: &rotations, workspace: &mut solve };
                    let warped = pcg(a, &b, &mut x, &mut warped, PcgConfig::default(), &mut iteration);
                    x.fill(0.0);
                    let mut plain = FactorPreconditioner { factor: &factor, workspace: &mut solve };
                    let plain = pcg(a, &b, &mut x, &mut plain, PcgConfig::default(), &mut iteration);
                    x.fill(0.0);
                    let replaced = jacobi.update(a);
                    let jacobi = pcg(a, &b, &mut x, &mut jacobi, PcgConfig::default(), &mut iteration);
                    statuses == [true; 11]
                        && report.status == ReachStatus::Ok
                        && by_nodes.status == ReachStatus::Ok
                        && corrected
                        && warped.status == PcgStatus::Converged
                        && plain.status == PcgStatus::Converged
                        && replaced == 0
                        && jacobi.iterations > 10
                })
            };
            assert!((0..4).all(&mut round), "a stage failed while warming up");
            reset_violation_count();
            assert!((0..12).all(round), "a stage failed");
            violation_count()
        });
        assert_eq!(violations, 0, "{threads} threads");
    }

    // the counter does count
    reset_violation_count();
    assert_no_alloc(|| drop(std::hint::black_box(vec![1.0; 100])));
    assert!(violation_count() > 0);
}
