//! The factorisation, its orderings, solves and updates.

#[path = "../factor_bodies/mod.rs"]
mod factor_bodies;

mod change;
mod directions;
mod multifrontal;
mod ordering;
mod pattern;
mod pcg;
mod prepared;
mod reach;
mod single;
mod solve;
