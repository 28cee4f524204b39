//! The walk over the fronts: children before parents, independent subtrees side by side.

use std::marker::PhantomData;
use std::ops::Range;

use pulp::bytemuck::cast_slice_mut;

use super::front::{Children, factor_front};
use super::number::Number;
use super::symbolic::SymbolicFactor;
use super::workers::join;
use crate::sparse::SystemMatrix;

/// Why a front could not be factored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// The pivot of this row of `P A Pᵀ` is not positive.
    Pivot(usize),
    /// A value of the matrix is not finite.
    NonFinite,
}

/// What a walk reads, and the numbers it computes with.
#[derive(Clone, Copy)]
struct Walk<'a, T> {
    symbolic: &'a SymbolicFactor,
    a: &'a SystemMatrix,
    number: PhantomData<T>,
}

/// The part of the stored values and of the memory for updates that a subtree owns, and where each begins in the whole.
struct Part<'a, T> {
    values: &'a mut [f64],
    values_at: usize,
    updates: &'a mut [T],
    updates_at: usize,
}

/// Factors `P A Pᵀ` into `values` by arithmetic on numbers `T`, with `updates` as scratch. The same bits for any number of
/// threads.
///
/// # Errors
/// The fault that comes first in the order of elimination.
pub(super) fn factor<T: Number>(
    symbolic: &SymbolicFactor,
    a: &SystemMatrix,
    values: &mut [f64],
    updates: &mut [f64],
) -> Result<(), Fault> {
    let walk = Walk { symbolic, a, number: PhantomData::<T> };
    let updates = cast_slice_mut(updates);
    walk.side_by_side(symbolic.tree().roots(), false, Part { values, values_at: 0, updates, updates_at: 0 })
}

impl<T: Number> Walk<'_, T> {
    /// The subtrees of siblings, which own the begin of `part`'s values. Regions descend where `low`, the end of the
    /// parent's update, is taken.
    fn side_by_side(&self, siblings: &[u32], descending: bool, part: Part<'_, T>) -> Result<(), Fault> {
        let arena = self.symbolic.arena();
        match siblings {
            [] => Ok(()),
            [s] => {
                let s = *s as usize;
                let Range { start, end } = arena.region(s);
                let updates = &mut part.updates[start - part.updates_at..end - part.updates_at];
                self.subtree(s, Part { updates, updates_at: start, ..part })
            }
            _ => {
                let (first, second) = siblings.split_at(siblings.len() / 2);
                let boundary = self.symbolic.tree().value_start(self.symbolic.tree().first(second[0] as usize));
                let (values, more_values) = part.values.split_at_mut(boundary - part.values_at);
                let at = if descending {
                    arena.region(first[first.len() - 1] as usize).start
                } else {
                    arena.region(second[0] as usize).start
                };
                let (low, high) = part.updates.split_at_mut(at - part.updates_at);
                let (low, high) = ((low, part.updates_at), (high, at));
                let (mine, other) = if descending { (high, low) } else { (low, high) };
                let left = Part { values, values_at: part.values_at, updates: mine.0, updates_at: mine.1 };
                let right = Part { values: more_values, values_at: boundary, updates: other.0, updates_at: other.1 };
                let (left, right) = join(
                    || self.side_by_side(first, descending, left),
                    || self.side_by_side(second, descending, right),
                );
                left.and(right)
            }
        }
    }

    /// The subtree of `s`, which owns all of `part`.
    fn subtree(&self, s: usize, mut part: Part<'_, T>) -> Result<(), Fault> {
        let (tree, arena) = (self.symbolic.tree(), self.symbolic.arena());
        if !arena.is_split(s) {
            return (tree.first(s)..=s).try_for_each(|s| self.front(s, &mut part));
        }
        let descending = arena.update(s).start == arena.region(s).start;
        let below = Part { values: &mut *part.values, updates: &mut *part.updates, ..part };
        self.side_by_side(tree.children(s), descending, below)?;
        self.front(s, &mut part)
    }

    /// One front, whose children are done.
    fn front(&self, s: usize, part: &mut Part<'_, T>) -> Result<(), Fault> {
        let (tree, arena) = (self.symbolic.tree(), self.symbolic.arena());
        let values = tree.value_start(s) - part.values_at..tree.value_start(s + 1) - part.values_at;
        let stored = &mut part.values[values];
        // Narrower numbers take the first part of the memory until they are widened in their place.
        let own = &mut cast_slice_mut(&mut *stored)[..];
        let own = &mut own[..tree.value_start(s + 1) - tree.value_start(s)];
        if !self.symbolic.assemble(s, self.a, own) {
            return Err(Fault::NonFinite);
        }
        let Range { start, end } = arena.update(s);
        let (start, end) = (start - part.updates_at, end - part.updates_at);
        let children = tree.children(s);
        let below = children.first().is_some_and(|&c| arena.update(c as usize).start < start + part.updates_at);
        let (update, updates, updates_at) = if below {
            let (others, update) = part.updates.split_at_mut(start);
            (&mut update[..end - start], &*others, part.updates_at)
        } else {
            let (update, others) = part.updates.split_at_mut(end);
            (&mut update[start..], &*others, part.updates_at + end)
        };
        let columns = tree.columns(s);
        factor_front(own, columns.len(), update, Children { list: children, tree, arena, updates, updates_at })
            .map_err(|column| Fault::Pivot(columns.start + column))?;
        T::widen(stored);
        Ok(())
    }
}
