//! Nearly singular compliances: more contacts than the nodes beneath them have degrees of freedom.

use crate::half_space;
use nalgebra::{DMatrix, DVector};
use palpate_constraints::law::Coulomb;
use palpate_solver::problem::ConstraintProblem;
use palpate_solver::report::SolveReport;
use palpate_solver::residual;
use palpate_solver::solver::Solver;

const DEPTH: f64 = 2e-3;

/// `contacts` points between the `nodes` of a half-space, each held by the three nearest, under a flat tool that slides. A
/// `settled` skin carries a smooth pressure already, and the tool goes on by a tenth.
fn between_nodes(nodes: usize, contacts: usize, settled: bool) -> ConstraintProblem {
    let nodal = half_space::pressed_sphere(nodes, 0.5, DEPTH, 0.0);
    let (places, points) = (half_space::points(nodes), half_space::points(contacts));
    let mut weights = DMatrix::zeros(3 * contacts, 3 * nodes);
    for (a, point) in points.iter().enumerate() {
        let distance = |b: usize| (places[b][0] - point[0]).hypot(places[b][1] - point[1]) + 1e-4;
        let mut nearest: Vec<usize> = (0..nodes).collect();
        nearest.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let sum: f64 = nearest[..3].iter().map(|b| 1.0 / distance(*b)).sum();
        for &b in &nearest[..3] {
            (0..3).for_each(|c| weights[(3 * a + c, 3 * b + c)] = 1.0 / (distance(b) * sum));
        }
    }
    let w = &weights * nodal.compliance() * weights.transpose();
    let slide = [-DEPTH, 8e-4, 6e-4];
    let mut free = DVector::from_fn(3 * contacts, |i, _| slide[i % 3]);
    if settled {
        // Vanishes at the rim, so that the outermost contacts are on the verge of opening.
        let pressure = DVector::from_fn(3 * contacts, |i, _| match i % 3 {
            0 => (1.0 - 0.99 * (points[i / 3][0].hypot(points[i / 3][1]) / 0.01).powi(2)).sqrt(),
            _ => 0.0,
        });
        let spring = &w * pressure;
        free = free * 0.1 - &spring * (DEPTH / spring.amax());
    }
    let law = Coulomb { friction: 0.5 }.into();
    ConstraintProblem::new((&w + w.transpose()) * 0.5, free, (0..contacts).map(|_| law)).unwrap()
}

fn solve(name: &str, problem: &ConstraintProblem, most: u32) -> (DVector<f64>, SolveReport) {
    let solver = Solver::from_name(name).unwrap().limited(1e-8, Some(most));
    let mut lambda = vec![0.0; problem.rows()];
    let report = solver.solve(&problem.view(), &mut lambda, &mut solver.workspace(problem.rows()));
    let judged = residual::evaluate(&problem.view(), &lambda, &mut vec![0.0; problem.rows()]);
    assert!(!report.is_solved() || judged.relative <= 1.01e-8, "{judged:?}");
    (DVector::from_vec(lambda), report)
}

#[test]
fn newton_solves_where_many_forces_give_the_same_gaps() {
    for (nodes, contacts, settled) in [(12, 24, false), (12, 24, true), (20, 60, false), (20, 60, true)] {
        let problem = between_nodes(nodes, contacts, settled);
        let (lambda, report) = solve("semismooth_newton", &problem, 300);
        assert!(report.is_solved(), "{nodes} nodes, {contacts} contacts, settled {settled}: {report:?}");
        // Proximal points stay near their start: no force of the many is one of those that cancel each other in thousands.
        let pressing: f64 = lambda.iter().step_by(3).sum();
        let firm = problem.compliance().view((0, 0), (1, 1))[(0, 0)];
        assert!(pressing < contacts as f64 * DEPTH / firm, "{pressing} N");
        println!(
            "{nodes} nodes, {contacts} contacts, settled {settled}: {} iterations, {pressing:.3} N",
            report.iterations
        );
    }
}

// Same problem in other units: lengths by 1e3, forces by 1e-2.
#[test]
fn the_chain_of_centres_takes_no_notice_of_units() {
    let problem = between_nodes(12, 24, true);
    let (w, free) = (problem.compliance() * 1e5, DVector::from_column_slice(problem.delta_free()) * 1e3);
    let laws = problem.blocks().iter().map(|block| block.law);
    let other = ConstraintProblem::new(w, free, laws).unwrap();
    let ((here, first), (there, second)) =
        (solve("semismooth_newton", &problem, 300), solve("semismooth_newton", &other, 300));
    assert!(first.is_solved() && second.is_solved());
    let gap = problem.compliance() * (here - there * 1e2);
    let size = DVector::from_column_slice(problem.delta_free()).norm();
    assert!(gap.norm() <= 1e-6 * size, "{} of {size}", gap.norm());
}
