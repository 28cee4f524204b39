//! Detection allocates nothing after its first call. A test binary of its own, because it replaces the allocator.

mod common;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use common::{box_hull, standard_block, turned};
use nalgebra::Vector3;
use palpate_collision::{ContactKind, ContactSet, DetectionConfig, DetectionWorkspace, ToolShape, detect};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn detection_allocates_nothing_after_the_first_call() {
    let (mut surface, mut positions) = standard_block();
    let tools = [ToolShape::sphere(0.007).unwrap(), ToolShape::capsule(0.01, 0.003).unwrap(), box_hull([0.006; 3])];
    for kind in [ContactKind::Nodes, ContactKind::Faces] {
        for tool in &tools {
            let config = DetectionConfig { kind, ..DetectionConfig::default() };
            let mut ws = DetectionWorkspace::new(&surface);
            let mut set = ContactSet::with_capacity(config.max_contacts);
            let mut most = 0;
            let mut step = |k: u32| {
                let f = f64::from(k) * 0.05;
                // From far above to below the skin and back, turning, over a surface that moves.
                let z = 0.05 + 0.008 + 0.014 * (f * 1.3).cos();
                let pose = turned(Vector3::new(0.05 + 0.02 * f.sin(), 0.05, z), Vector3::new(f, 0.4 * f, 0.0));
                positions[500].z += 1e-5 * f.sin();
                surface.refit(&positions);
                most = most.max(detect(&surface, &positions, tool, &pose, &config, &mut ws, &mut set).contacts);
            };
            step(0);
            let before = violation_count();
            assert_no_alloc(|| (1..500).for_each(&mut step));
            assert_eq!(violation_count() - before, 0);
            assert!(most > 5, "the run was in contact");
        }
    }
    // The counter itself works.
    let before = violation_count();
    assert_no_alloc(|| drop(std::hint::black_box(vec![1u8; 10])));
    assert!(violation_count() > before);
}
