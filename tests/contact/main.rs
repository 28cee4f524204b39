//! Contact against closed forms and other engines, its laws, and what is refused.

#[path = "../block/mod.rs"]
mod block;

mod bad_input;
mod deep_press;
mod direct;
mod direct_bodies;
mod elements;
mod faces_at_rest;
mod fixed_skin;
mod hertz;
mod incline;
mod indentation;
mod law_at_bodies;
mod laws;
mod quasi_static;
mod room;
mod slope;
mod sofa_indentation;
mod solvers;
mod unsolved;
