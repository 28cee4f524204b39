//! Which items a pass over a surface has seen.

/// Marks items that a pass has seen, without clearing between passes.
#[derive(Clone, Debug)]
pub(super) struct Visited {
    pass_of: Vec<u32>,
    pass: u32,
}

impl Visited {
    pub(super) fn new(items: usize) -> Self {
        Self { pass_of: vec![0; items], pass: 0 }
    }

    /// Starts a pass over `items` items.
    pub(super) fn begin(&mut self, items: usize) {
        self.pass = self.pass.wrapping_add(1);
        if self.pass == 0 || self.pass_of.len() != items {
            self.pass_of.clear();
            self.pass_of.resize(items, 0);
            self.pass = 1;
        }
    }

    /// Calls `visit` with those of three items that this pass has not seen.
    pub(super) fn first_visits(&mut self, items: [u32; 3], mut visit: impl FnMut(u32)) {
        for item in items {
            if self.pass_of.get_mut(item as usize).is_some_and(|at| std::mem::replace(at, self.pass) != self.pass) {
                visit(item);
            }
        }
    }
}
