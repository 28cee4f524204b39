//! Orders of convergence by a manufactured solution, and volumetric locking: shown, and removed.

#![allow(clippy::print_stdout)] // orders that were measured

use crate::element_study::{AVERAGED, Choice, Errors, LINEAR, QUADRATIC, manufactured, panel};

/// Order between two meshes.
fn order(coarse: f64, fine: f64, ratio: f64) -> f64 {
    (coarse / fine).ln() / ratio.ln()
}

fn two_meshes(choice: Choice, [coarse, fine]: [usize; 2], poisson: f64) -> (Errors, [f64; 3]) {
    let (a, b) = (manufactured(choice, coarse, poisson).0, manufactured(choice, fine, poisson).0);
    let ratio = fine as f64 / coarse as f64;
    let orders = [
        order(a.displacement, b.displacement, ratio),
        order(a.energy, b.energy, ratio),
        order(a.gradient, b.gradient, ratio),
    ];
    println!("{choice:?} {poisson}: {b:?}, orders of u, energy, gradient {orders:.2?}");
    (b, orders)
}

/// One wavelength along each edge of the cube: with 10 to 15 cells (5 to 8 of twice the nodes) the orders are still up to a
/// third short of 2 and 1 (3 and 2), and approach them from below.
#[test]
fn errors_fall_with_the_orders_of_the_interpolation() {
    for (choice, cells, least) in
        [(LINEAR, [10, 15], [1.65, 0.8]), (QUADRATIC, [5, 8], [2.7, 1.6]), (AVERAGED, [10, 15], [1.65, 0.8])]
    {
        let (_, orders) = two_meshes(choice, cells, 0.3);
        assert!(orders[0] > least[0] && orders[0] < least[0] + 0.5, "{choice:?}: displacement {orders:?}");
        assert!(orders[1] > least[1] && orders[1] < least[1] + 0.5, "{choice:?}: energy {orders:?}");
    }
}

/// The exact answer has no divergence and does not depend on Poisson's ratio, and so should its error.
#[test]
fn averaged_elements_do_not_lock_and_linear_ones_do() {
    let compressible = manufactured(AVERAGED, 8, 0.3).0;
    for poisson in [0.49, 0.499, 0.4999] {
        let averaged = manufactured(AVERAGED, 8, poisson).0;
        assert!(averaged.displacement < 1.1 * compressible.displacement, "{poisson}: {averaged:?}");
        assert!(averaged.gradient < 1.05 * compressible.gradient, "{poisson}: {averaged:?}");
        let linear = manufactured(LINEAR, 8, poisson).0;
        // Locked: most of the displacement is missing.
        assert!(linear.displacement > 0.6, "{poisson}: {linear:?}");
        assert!(linear.pressure > 5.0 * averaged.pressure, "{poisson}: {linear:?} {averaged:?}");
    }
    // Orders hold near incompressibility, for displacements and their gradient. (The energy norm weighs the divergence
    // within each element, which averaging leaves free, by the bulk modulus.)
    let (_, orders) = two_meshes(AVERAGED, [8, 12], 0.499);
    assert!(orders[0] > 1.6 && orders[2] > 0.85, "{orders:?}");
}

#[test]
fn quadratic_elements_lock_little_and_only_on_coarse_meshes() {
    let (compressible, _) = manufactured(QUADRATIC, 6, 0.3);
    for (poisson, most) in [(0.49, 4.0), (0.499, 8.0)] {
        let quadratic = manufactured(QUADRATIC, 6, poisson).0;
        let linear = manufactured(LINEAR, 12, poisson).0;
        assert!(quadratic.displacement < most * compressible.displacement, "{poisson}: {quadratic:?}");
        // At equal unknowns.
        assert!(quadratic.displacement < 0.3 * linear.displacement, "{poisson}: {quadratic:?} {linear:?}");
    }
}

/// A thick panel in bending and shear. The reference is that of the finest quadratic mesh of the study, which lies below the
/// limit by less than 1 % at 0.3.
#[test]
fn a_panel_in_bending_gives_way_as_it_should() {
    let reference = panel(QUADRATIC, 3, 0.3).0;
    let at = |choice, size, poisson| panel(choice, size, poisson).0 / reference;
    // Ten-node elements of size 1 have the unknowns of four-node ones of size 2.
    let (linear, quadratic, averaged) = (at(LINEAR, 2, 0.3), at(QUADRATIC, 1, 0.3), at(AVERAGED, 2, 0.3));
    assert!((0.95..1.0).contains(&quadratic), "{quadratic}");
    assert!(linear < 0.75 && averaged > 1.05 * linear, "{linear} {averaged}");
    // Nearly incompressible: linear elements lose three quarters, averaged ones keep what they had at 0.3.
    for poisson in [0.49, 0.499] {
        let stiff = at(AVERAGED, 4, poisson) / at(AVERAGED, 4, 0.3);
        assert!((0.98..1.0).contains(&stiff), "{poisson}: {stiff}");
    }
    assert!(at(LINEAR, 4, 0.499) < 0.35);
    // The pressure is smooth where that of linear elements jumps by more than its size from element to element.
    let (smooth, rough) = (panel(AVERAGED, 4, 0.499).1, panel(LINEAR, 4, 0.499).1);
    assert!(smooth < 0.3 && rough > 1.0, "{smooth} {rough}");
}
