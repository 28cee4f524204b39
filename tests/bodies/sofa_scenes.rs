//! Do the scenes that SOFA's contact times are known for have its nodes, tetrahedra and rows?

use std::path::Path;

use palpate::prelude::*;
use palpate::scene::SceneDescription;
use palpate::step::StepStatus;

fn load(name: &str) -> Scene {
    Scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("examples/scenes/{name}.toml"))).unwrap()
}

/// Nodes, tetrahedra and rows of SOFA's runs.
const SCENES: [(&str, usize, usize, usize); 4] = [
    ("box756_floor", 224, 756, 168),
    ("box5k_ball", 1170, 5040, 153),
    ("box5k_floor", 1170, 5040, 585),
    ("box20k_floor", 4320, 20_976, 1440),
];

#[test]
fn the_scenes_have_sofas_nodes_tetrahedra_and_rows() {
    for (name, nodes, tetrahedra, rows) in SCENES {
        let scene = load(name);
        let SceneDescription { fixed_bodies, rigid_bodies, contact, .. } = scene.description();
        assert_eq!(contact.friction, 0.5, "{name}");
        let most: usize = fixed_bodies.iter().filter_map(|b| b.max_contacts).sum::<usize>()
            + rigid_bodies.iter().filter_map(|b| b.max_contacts).sum::<usize>();
        assert_eq!(3 * most, rows, "{name}");
        let world = scene.build().unwrap();
        assert_eq!((world.mesh().nodes.len(), world.mesh().tetrahedra.len()), (nodes, tetrahedra), "{name}");
        assert!(world.warnings().is_empty(), "{name}: {:?}", world.warnings());
        // The largest takes a second a step.
        if rows > 600 {
            continue;
        }
        let mut simulation = Simulation::new(&world).unwrap();
        let report = (0..3).map(|_| simulation.step(&world.first_pose())).last().unwrap();
        assert_eq!(report.status, StepStatus::Advanced);
        assert_eq!(report.rows.rows, rows, "{name}");
        assert!(report.solve.is_solved(), "{name}: {:?}", report.solve);
    }
}
