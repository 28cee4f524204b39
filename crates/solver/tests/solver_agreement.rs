//! All solvers answer one set of problems alike.
#![allow(clippy::print_stdout)]

mod half_space;

#[test]
fn tmp() {
    use palpate_solver::{residual, solver::Solver};
    for (n, depth, tol) in [(10, 2e-3, 1e-8), (30, 2e-3, 1e-8), (30, 8e-3, 1e-8), (60, 2e-3, 1e-8), (60, 8e-3, 1e-8)] {
        let p = half_space::pressed_sphere(n, 0.5, depth, 1.5e-3);
        for name in Solver::NAMES {
            if n > 30 && *name == "lemke" {
                continue;
            }
            let solver = Solver::from_name(name).unwrap().limited(tol, 5000);
            let mut ws = solver.workspace(p.rows());
            let mut lambda = vec![0.0; p.rows()];
            let t = std::time::Instant::now();
            let r = solver.solve(&p.view(), &mut lambda, &mut ws);
            let s = t.elapsed().as_secs_f64() * 1e3;
            let mut scratch = vec![0.0; p.rows()];
            let j = residual::evaluate(&p.view(), &lambda, &mut scratch);
            println!(
                "{n} {depth} {name:<18} {:?} {} {:.1e} {:.1e} {s:.2} ms",
                r.status, r.iterations, r.residual, j.relative
            );
        }
    }
}
