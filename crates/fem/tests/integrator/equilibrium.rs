//! Static equilibrium: reactions, quadratic convergence, load steps, and the dynamics that end in it.
#![allow(clippy::print_stdout)]

use crate::integrator_setup::{bar_of, body, clamped, distance};
use nalgebra::{Rotation3, Vector3};
use palpate_fem::{
    integrator::{
        backward_euler::newton_step,
        equilibrium::{EquilibriumConfig, EquilibriumError, Loads, Prescribed, equilibrium},
        newton::NewtonConfig,
    },
    material::Material,
    model::{FemConfig, FemModel},
};

const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// Places of the far end, moved by `motion`.
fn driven(model: &FemModel, nodes: &[u32], motion: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<Prescribed> {
    nodes.iter().map(|&node| Prescribed { node, position: motion(model.q_rest()[node as usize]) }).collect()
}

/// Where a node at a place goes.
type Motion = Box<dyn Fn(Vector3<f64>) -> Vector3<f64>>;

#[test]
fn the_reaction_carries_the_weight_and_the_loads() {
    let mesh = bar_of([6, 2, 2]);
    for law in Material::NAMES {
        let (model, _, mut ws) = body(&mesh, &FemConfig { gravity: GRAVITY, ..clamped(&mesh, law) });
        let mut f_ext = vec![Vector3::zeros(); model.nodes()];
        for &node in &mesh.node_sets["x_max"] {
            f_ext[node as usize] = Vector3::new(2e-3, 1e-3, 0.0);
        }
        let mut state = model.rest_state();
        let loads = Loads { f_ext: &f_ext, ..Loads::default() };
        let report = equilibrium(&model, &loads, &EquilibriumConfig::default(), &mut state, &mut ws).unwrap();
        assert!(report.is_converged(), "{law}: {report:?}");
        let weight = GRAVITY * model.mass().iter().sum::<f64>();
        let load: Vector3<f64> = f_ext.iter().sum();
        let error = (report.reaction + weight + load).norm() / weight.norm();
        println!(
            "{law}: {} iterations, {} cuts, reaction {:?} N",
            report.iterations,
            report.cuts,
            report.reaction.as_slice()
        );
        // The residual of all free nodes together: 1e-9 of the forces, times the root of their number.
        assert!(error < 1e-7, "{law}: {error:e}");
        assert!(state.v.iter().all(|v| *v == Vector3::zeros()));
    }
}

#[test]
fn newtons_method_converges_quadratically_to_equilibrium() {
    let mesh = bar_of([6, 2, 2]);
    let (model, _, mut ws) = body(&mesh, &FemConfig { gravity: GRAVITY * 0.3, ..clamped(&mesh, "neo_hookean") });
    let mut residuals = Vec::new();
    for iterations in 1..12 {
        let mut state = model.rest_state();
        let newton = NewtonConfig { iterations, tolerance: 1e-15 };
        let config = EquilibriumConfig { newton, smallest_step: 1.0, ..EquilibriumConfig::default() };
        let report = equilibrium(&model, &Loads::default(), &config, &mut state, &mut ws).unwrap();
        residuals.push(report.newton.relative_residual);
        if report.is_converged() {
            break;
        }
    }
    println!("relative residuals: {residuals:?}");
    let fast = residuals.windows(2).filter(|r| r[0] < 3e-2 && r[1] > 1e-13);
    let orders: Vec<f64> = fast.map(|r| r[1].ln() / r[0].ln()).collect();
    println!("orders {orders:.2?}");
    assert!(orders.len() >= 2 && orders.last().unwrap() > &1.7, "{orders:?}");
    assert!(residuals.last().unwrap() < &1e-12);
}

#[test]
fn the_long_time_limit_of_the_dynamics_is_the_equilibrium() {
    let mesh = bar_of([5, 2, 2]);
    let config = FemConfig { gravity: GRAVITY, rayleigh_mass: 5.0, ..clamped(&mesh, "neo_hookean") };
    let (model, _, mut ws) = body(&mesh, &config);
    let mut resting = model.rest_state();
    let report = equilibrium(&model, &Loads::default(), &EquilibriumConfig::default(), &mut resting, &mut ws).unwrap();
    assert!(report.is_converged());
    let mut swinging = model.rest_state();
    for _ in 0..300 {
        assert!(newton_step(&model, 0.05, &[], &NewtonConfig::default(), &mut swinging, &mut ws).is_converged());
    }
    let sag = distance(&resting, &model.rest_state());
    let difference = distance(&resting, &swinging);
    println!("sag {sag:.4} m; the dynamics end {difference:.1e} m from it");
    // Newton's tolerance of 1e-9 on the forces, through the compliance of a slender bar (its sag per weight).
    assert!(sag > 0.005 && difference < 1e-7 * sag, "{sag} {difference}");
}

#[test]
fn driven_ends_are_followed_through_large_motions() {
    let mesh = bar_of([8, 2, 2]);
    let end = &mesh.node_sets["x_max"];
    for law in Material::NAMES {
        let mut config = clamped(&mesh, law);
        config.fixed.extend(end);
        let (model, _, mut ws) = body(&mesh, &config);
        let motions: [(&str, Motion); 3] = [
            ("pulled by half", Box::new(|x| x + Vector3::new(0.04, 0.0, 0.0))),
            ("crushed by a tenth", Box::new(|x| x - Vector3::new(0.008, 0.0, 0.0))),
            (
                "bent aside",
                Box::new(|x| {
                    let pivot = Vector3::new(0.08, 0.01, 0.01);
                    pivot
                        + Vector3::new(-0.01, 0.0, 0.02)
                        + Rotation3::from_axis_angle(&Vector3::y_axis(), -0.5) * (x - pivot)
                }),
            ),
        ];
        for (name, motion) in motions {
            let prescribed = driven(&model, end, motion);
            let mut state = model.rest_state();
            let loads = Loads { prescribed: &prescribed, ..Loads::default() };
            let report = equilibrium(&model, &loads, &EquilibriumConfig::default(), &mut state, &mut ws).unwrap();
            println!(
                "{law}, {name}: {} load steps, {} halvings, {} iterations, {} filtered, residual {:.1e}",
                report.load_steps, report.halvings, report.iterations, report.filtered, report.newton.relative_residual
            );
            assert!(report.is_converged(), "{law}, {name}: {report:?}");
            for p in &prescribed {
                assert_eq!(state.q[p.node as usize], p.position, "to the bit");
            }
            // No loads: the two ends hold each other.
            let pull = ws.fem.f_int.iter().map(|f| f.norm()).fold(0.0, f64::max);
            assert!(report.reaction.norm() < 1e-7 * pull, "{law}, {name}: {:?} of {pull}", report.reaction);
        }
    }
}

#[test]
fn a_load_too_large_for_one_step_is_halved_and_the_way_to_it_does_not_matter() {
    let mesh = bar_of([8, 2, 2]);
    let end = &mesh.node_sets["x_max"];
    let mut config = FemConfig { gravity: GRAVITY, ..clamped(&mesh, "neo_hookean") };
    config.fixed.extend(end);
    let (model, _, mut ws) = body(&mesh, &config);
    let turn = |angle: f64| {
        let axis = Vector3::new(0.0, 0.01, 0.01);
        driven(&model, end, |x| axis + Rotation3::from_axis_angle(&Vector3::x_axis(), angle) * (x - axis))
    };
    // Few iterations a step, so that steps fail.
    let newton = NewtonConfig { iterations: 4, ..NewtonConfig::default() };
    let hasty = EquilibriumConfig { newton, ..EquilibriumConfig::default() };
    let patient = EquilibriumConfig { first_step: 0.1, ..EquilibriumConfig::default() };
    let prescribed = turn(1.0);
    let loads = Loads { prescribed: &prescribed, ..Loads::default() };
    let (mut a, mut b) = (model.rest_state(), model.rest_state());
    let first = equilibrium(&model, &loads, &hasty, &mut a, &mut ws).unwrap();
    let second = equilibrium(&model, &loads, &patient, &mut b, &mut ws).unwrap();
    println!("{} steps after {} halvings; {} steps", first.load_steps, first.halvings, second.load_steps);
    assert!(first.is_converged() && second.is_converged() && first.halvings > 0);
    // 1e-9 of the forces through the compliance of the bar.
    assert!(distance(&a, &b) < 1e-8, "{:e}", distance(&a, &b));

    // On from there, with the weight already carried: back to the straight bar under its weight.
    let straight = turn(0.0);
    let loads = Loads { prescribed: &straight, carried: 1.0, ..Loads::default() };
    assert!(equilibrium(&model, &loads, &patient, &mut a, &mut ws).unwrap().is_converged());
    let mut c = model.rest_state();
    assert!(equilibrium(&model, &Loads::default(), &patient, &mut c, &mut ws).unwrap().is_converged());
    assert!(distance(&a, &c) < 1e-8, "{:e}", distance(&a, &c));
}

#[test]
fn a_path_that_ends_early_leaves_the_last_equilibrium_and_says_how_far_it_came() {
    let mesh = bar_of([4, 1, 1]);
    let (model, _, mut ws) = body(&mesh, &FemConfig { gravity: GRAVITY * 50.0, ..clamped(&mesh, "neo_hookean") });
    let mut state = model.rest_state();
    let newton = NewtonConfig { iterations: 3, tolerance: 1e-9 };
    let config = EquilibriumConfig { newton, first_step: 1.0, smallest_step: 0.2 };
    let report = equilibrium(&model, &Loads::default(), &config, &mut state, &mut ws).unwrap();
    assert!(!report.is_converged() && report.halvings > 0, "{report:?}");
    assert!(state.q.iter().all(|q| q.iter().all(|x| x.is_finite())));
    if report.load_steps == 0 {
        assert_eq!(state, model.rest_state());
    }
}

#[test]
fn loads_that_do_not_suit_the_model_are_refused() {
    let mesh = bar_of([4, 1, 1]);
    let (model, _, mut ws) = body(&mesh, &clamped(&mesh, "neo_hookean"));
    let mut state = model.rest_state();
    let mut refuse = |f_ext: &[Vector3<f64>], prescribed: &[Prescribed]| {
        let loads = Loads { f_ext, prescribed, carried: 0.0 };
        equilibrium(&model, &loads, &EquilibriumConfig::default(), &mut state, &mut ws).unwrap_err()
    };
    let free = model.node_of_free()[0];
    let fixed = mesh.node_sets["x_min"][0];
    let to = |node, x| [Prescribed { node, position: Vector3::new(x, 0.0, 0.0) }];
    assert_eq!(refuse(&[], &to(free, 0.0)), EquilibriumError::FreeNode { node: free });
    assert_eq!(refuse(&[], &to(999, 0.0)), EquilibriumError::NoNode { node: 999, nodes: model.nodes() });
    assert_eq!(refuse(&[], &to(fixed, f64::NAN)), EquilibriumError::Place { node: fixed });
    assert_eq!(refuse(&[Vector3::zeros()], &[]), EquilibriumError::ForceCount { forces: 1, nodes: model.nodes() });
    let (loose, _, mut ws) = body(&mesh, &FemConfig { fixed: Vec::new(), ..clamped(&mesh, "neo_hookean") });
    let mut state = loose.rest_state();
    let error = equilibrium(&loose, &Loads::default(), &EquilibriumConfig::default(), &mut state, &mut ws).unwrap_err();
    assert_eq!(error, EquilibriumError::Unsupported);
}

#[test]
fn settings_out_of_their_range_are_refused_by_name_before_anything_moves() {
    let mesh = bar_of([2, 1, 1]);
    let (model, _, mut ws) = body(&mesh, &FemConfig { gravity: GRAVITY, ..clamped(&mesh, "neo_hookean") });
    let usual = EquilibriumConfig::default();
    let steps = [f64::NAN, 0.0, -0.1, f64::INFINITY];
    let first = steps.into_iter().chain([1.5]).map(|first_step| EquilibriumConfig { first_step, ..usual });
    let smallest = steps.into_iter().map(|smallest_step| EquilibriumConfig { smallest_step, ..usual });
    let newton = |newton: NewtonConfig| EquilibriumConfig { newton, ..usual };
    let idle = newton(NewtonConfig { iterations: 0, ..usual.newton });
    let loose = [0.0, 1.0, f64::NAN].map(|tolerance| newton(NewtonConfig { tolerance, ..usual.newton }));
    let mut named = |config: &EquilibriumConfig| {
        let mut state = model.rest_state();
        let error = equilibrium(&model, &Loads::default(), config, &mut state, &mut ws).unwrap_err();
        assert!(state == model.rest_state(), "{config:?}");
        error.to_string()
    };
    let messages: Vec<String> = first.chain(smallest).chain([idle]).chain(loose).map(|c| named(&c)).collect();
    println!("{}", messages.join("\n"));
    let expected = [("first_step", 5), ("smallest_step", 4), ("newton.iterations", 1), ("newton.tolerance", 3)];
    let names: Vec<&str> = expected.iter().flat_map(|&(name, count)| vec![name; count]).collect();
    assert!(messages.iter().zip(&names).all(|(message, name)| message.starts_with(name)), "{messages:?}");
    assert_eq!(messages.len(), names.len());
}
