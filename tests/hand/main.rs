//! What the hand feels: touch, tools, devices and the hand-over of snapshots.

#[path = "../block/mod.rs"]
mod block;
#[path = "../jaws/mod.rs"]
mod jaws;

mod at_the_wall;
mod device_keys;
mod first_touch;
mod grasp_force;
mod grasper;
mod hand_entries;
mod hand_over;
mod hull;
mod many_corners;
mod rates;
mod tool_at_fixed_bodies;
