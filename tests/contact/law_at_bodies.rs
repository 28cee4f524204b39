//! The law of `[contact]` is that of every contact: of tissue on fixed bodies too, where it has a force in closed form.

#![allow(clippy::print_stdout)] // measured numbers

use crate::slope;
use std::f64::consts::FRAC_PI_4;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use palpate::prelude::*;
use palpate::scene::{ContactLawKind, FixedBodyDescription, SceneDescription, SceneError, SolidShape};
use palpate::solver::report::SolveStatus;

use crate::slope::{DT, G, leaning};

const LIMIT: f64 = 0.03;

/// The block of the slope on a fixed plane, its tool far away.
fn on_plane(angle: f64, heading: f64, change: impl FnOnce(&mut SceneDescription)) -> Result<World, SceneError> {
    let mut scene = slope::world(leaning(angle, heading), "").scene().clone();
    scene.edit(|scene| {
        scene.hand.path[0].position = [0.0, 0.0, 5.0];
        scene.fixed_bodies.push(FixedBodyDescription {
            name: "plane".into(),
            shape: SolidShape::Plane { normal: [0.0, 0.0, 1.0] },
            position: [0.0; 3],
            rotation: [0.0; 3],
            friction: None,
            max_contacts: None,
        });
        change(scene);
    })?;
    scene.build()
}

/// Acceleration (m/s²) over twenty steps once the block's elastic motion has died out, and the contacts that bear it.
fn slide(world: &World) -> (Vector3<f64>, usize) {
    let mut sim = Simulation::new(world).unwrap();
    let mass: f64 = world.model().mass().iter().sum();
    let far = Isometry3::translation(0.0, 0.0, 5.0);
    let velocity = |sim: &Simulation<'_>| {
        let v = sim.state().fem.v.iter().zip(world.model().mass());
        v.map(|(v, m)| v * *m).sum::<Vector3<f64>>() / mass
    };
    let mut steps = |n: u32| {
        for _ in 0..n {
            assert_eq!(sim.step(&far).solve.status, SolveStatus::Solved);
        }
        (velocity(&sim), sim.workspace().pair_force(0).unwrap().active)
    };
    let (from, _) = steps(40);
    let (to, active) = steps(20);
    ((to - from) / (20.0 * DT), active)
}

#[test]
fn tissue_slides_on_a_fixed_plane_by_the_law_of_the_scene() {
    let (angle, friction) = (0.6f64, 0.5);
    let world = |heading: f64, law: ContactLawKind, facets: Option<usize>, limit: Option<f64>| {
        let friction = if limit.is_none() && law != ContactLawKind::Signorini { friction } else { 0.0 };
        on_plane(angle, heading, |scene| {
            let c = &mut scene.contact;
            (c.law, c.facets, c.limit, c.friction) = (law, facets, limit, friction);
        })
        .unwrap()
    };
    let mass: f64 = world(0.0, ContactLawKind::Signorini, None, None).model().mass().iter().sum();
    let cone = |share: f64| G * (angle.sin() - share * friction * angle.cos());
    for (heading, law, facets, limit, expected) in [
        (0.3, ContactLawKind::Signorini, None, None, G * angle.sin()),
        (0.3, ContactLawKind::Coulomb, None, None, cone(1.0)),
        // Frames of a vertical normal have their tangents along the axes: a corner, and the middle of a side.
        (0.0, ContactLawKind::FacetedCoulomb, Some(4), None, cone(1.0)),
        (FRAC_PI_4, ContactLawKind::FacetedCoulomb, Some(4), None, cone(FRAC_PI_4.cos())),
        (0.3, ContactLawKind::Tresca, None, Some(LIMIT), G * angle.sin() - 16.0 * LIMIT / mass),
    ] {
        let (a, active) = slide(&world(heading, law, facets, limit));
        let down = Vector3::new(heading.cos(), heading.sin(), 0.0);
        println!("{law:?} towards {heading:.2}: a = {:.6} of {expected:.6} m/s², {active} contacts", a.dot(&down));
        assert_eq!(active, 16);
        // What is left of elastic motion, as on the tool as a floor.
        assert!((a - down * expected).norm() < 1e-5 * G, "{law:?}: {a:?}");
    }
}

#[test]
fn a_law_that_bodies_cannot_have_is_refused_with_key_value_and_remedy() {
    let refused = |change: fn(&mut SceneDescription)| {
        let Err(SceneError::Invalid(error)) = on_plane(0.0, 0.0, change) else { panic!("accepted") };
        println!("{error}");
        let place = error.text[error.span.clone()].to_string();
        (error.to_string(), place, error.remedy.unwrap_or_default())
    };
    let (said, place, remedy) = refused(|scene| {
        (scene.contact.law, scene.contact.limit) = (ContactLawKind::Threshold, Some(1.0));
    });
    assert!(said.contains("fall through") && place == "\"threshold\"" && remedy.contains("another law"), "{said}");
    let (said, place, remedy) = refused(|scene| {
        (scene.contact.law, scene.fixed_bodies[0].friction) = (ContactLawKind::Signorini, Some(0.25));
    });
    assert!(said.contains("friction = 0.25 has no effect") && said.contains("`signorini`"), "{said}");
    assert!(place == "0.25" && remedy.contains("coulomb"), "{place}: {remedy}");
    let of_rigid = r#"
        [[rigid_body]]
        name = "ball"
        shape = { kind = "sphere", radius = 0.02 }
        mass = 0.1
        position = [0, 0, 0.5]
        friction = 0.5
    "#;
    let text = on_plane(0.0, 0.0, |scene| {
        (scene.contact.law, scene.contact.limit) = (ContactLawKind::Tresca, Some(1.0));
    });
    let text = text.unwrap().scene().text().to_owned() + of_rigid;
    let said = Scene::from_toml(&text, Path::new("")).unwrap_err().to_string();
    assert!(said.contains("friction = 0.5 has no effect: the law is `tresca`"), "{said}");
}
