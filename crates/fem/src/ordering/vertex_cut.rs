//! Minimum vertex cut of a band of nodes between two sides, by maximum flow (Dinic 1970; unit capacity per node).

const NONE: u32 = u32::MAX;
const UNBOUNDED: u32 = u32::MAX;

/// Where a node of the band lies with respect to the minimum cut nearest to the first side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    First,
    Cut,
    Second,
}

/// A flow network in which every node of the band is an edge of capacity one from its entry to its exit.
pub(super) struct VertexCut {
    /// Arcs in pairs: arc `a` and its reverse `a ^ 1`.
    head: Vec<u32>,
    capacity: Vec<u32>,
    next: Vec<u32>,
    first_arc: Vec<u32>,
    level: Vec<u32>,
    band: u32,
}

impl VertexCut {
    /// A band of `band` nodes without any edge.
    pub(super) fn new(band: usize) -> Self {
        let vertices = 2 * band + 2;
        let mut network = Self {
            head: Vec::new(),
            capacity: Vec::new(),
            next: Vec::new(),
            first_arc: vec![NONE; vertices],
            level: vec![NONE; vertices],
            band: band as u32,
        };
        for node in 0..band as u32 {
            network.add_arc(2 * node, 2 * node + 1, 1);
        }
        network
    }

    fn source(&self) -> u32 {
        2 * self.band
    }

    fn sink(&self) -> u32 {
        2 * self.band + 1
    }

    fn add_arc(&mut self, from: u32, to: u32, capacity: u32) {
        for (from, to, capacity) in [(from, to, capacity), (to, from, 0)] {
            self.next.push(self.first_arc[from as usize]);
            self.first_arc[from as usize] = self.head.len() as u32;
            self.head.push(to);
            self.capacity.push(capacity);
        }
    }

    /// A directed edge between two nodes of the band; give both directions.
    pub(super) fn join(&mut self, from: u32, to: u32) {
        self.add_arc(2 * from + 1, 2 * to, UNBOUNDED);
    }

    /// The node touches the first side.
    pub(super) fn touch_first(&mut self, node: u32) {
        self.add_arc(self.source(), 2 * node, UNBOUNDED);
    }

    /// The node touches the second side.
    pub(super) fn touch_second(&mut self, node: u32) {
        self.add_arc(2 * node + 1, self.sink(), UNBOUNDED);
    }

    /// The fewest nodes whose removal parts the two sides: the place of every node of the band.
    pub(super) fn solve(mut self) -> Vec<Place> {
        while self.find_levels() {
            let mut arc = self.first_arc.clone();
            while self.augment(&mut arc) {}
        }
        (0..self.band as usize)
            .map(|node| match (self.level[2 * node] != NONE, self.level[2 * node + 1] != NONE) {
                (_, true) => Place::First,
                (true, false) => Place::Cut,
                (false, false) => Place::Second,
            })
            .collect()
    }

    /// Breadth-first levels in the residual network; false once the sink is out of reach.
    fn find_levels(&mut self) -> bool {
        self.level.fill(NONE);
        let source = self.source();
        self.level[source as usize] = 0;
        let mut queue = vec![source];
        let mut place = 0;
        while place < queue.len() {
            let from = queue[place] as usize;
            place += 1;
            let mut arc = self.first_arc[from];
            while arc != NONE {
                let to = self.head[arc as usize] as usize;
                if self.capacity[arc as usize] > 0 && self.level[to] == NONE {
                    self.level[to] = self.level[from] + 1;
                    queue.push(to as u32);
                }
                arc = self.next[arc as usize];
            }
        }
        self.level[self.sink() as usize] != NONE
    }

    /// Sends one unit along a path of ascending levels; `arc` remembers which arcs of each vertex are spent.
    fn augment(&mut self, arc: &mut [u32]) -> bool {
        let mut path: Vec<u32> = Vec::new();
        let mut at = self.source();
        while at != self.sink() {
            let candidate = arc[at as usize];
            if candidate == NONE {
                // a dead end: step back and spend the arc that led here
                let Some(back) = path.pop() else { return false };
                at = self.head[(back ^ 1) as usize];
                arc[at as usize] = self.next[back as usize];
                continue;
            }
            let to = self.head[candidate as usize];
            if self.capacity[candidate as usize] > 0 && self.level[to as usize] == self.level[at as usize] + 1 {
                path.push(candidate);
                at = to;
            } else {
                arc[at as usize] = self.next[candidate as usize];
            }
        }
        for &arc in &path {
            for (arc, forward) in [(arc as usize, true), ((arc ^ 1) as usize, false)] {
                if self.capacity[arc] != UNBOUNDED {
                    self.capacity[arc] = if forward { self.capacity[arc] - 1 } else { self.capacity[arc] + 1 };
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Size of the smallest set of band nodes that parts the sides, by trying all sets.
    fn smallest_cut(band: u32, edges: &[(u32, u32)], first: u32, second: u32) -> u32 {
        let parts = |removed: u32| {
            let mut reached = first & !removed;
            loop {
                let before = reached;
                for &(a, b) in edges {
                    for (from, to) in [(a, b), (b, a)] {
                        if reached >> from & 1 == 1 {
                            reached |= (1 << to) & !removed;
                        }
                    }
                }
                if reached == before {
                    return reached & second & !removed == 0;
                }
            }
        };
        (0..1 << band).filter(|&removed| parts(removed)).map(u32::count_ones).min().unwrap_or(band)
    }

    #[test]
    fn cut_parts_the_sides_and_no_smaller_one_does() {
        let mut seed = 1u64;
        let mut bits = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 40) as u32
        };
        for _ in 0..300 {
            let band = 1 + bits() % 9;
            let edges: Vec<(u32, u32)> = (0..bits() % 16).map(|_| (bits() % band, bits() % band)).collect();
            let (first, second) = (bits() & bits() & ((1 << band) - 1), bits() & bits() & ((1 << band) - 1));
            let mut network = VertexCut::new(band as usize);
            for &(a, b) in &edges {
                network.join(a, b);
                network.join(b, a);
            }
            for node in 0..band {
                if first >> node & 1 == 1 {
                    network.touch_first(node);
                }
                if second >> node & 1 == 1 {
                    network.touch_second(node);
                }
            }
            let places = network.solve();
            let cut = places.iter().filter(|&&place| place == Place::Cut).count() as u32;
            assert_eq!(cut, smallest_cut(band, &edges, first, second));
            for &(a, b) in &edges {
                let ends = (places[a as usize], places[b as usize]);
                assert!(!matches!(ends, (Place::First, Place::Second) | (Place::Second, Place::First)));
            }
            for node in 0..band {
                let place = places[node as usize];
                assert!(first >> node & 1 == 0 || place != Place::Second);
                assert!(second >> node & 1 == 0 || place != Place::First);
            }
        }
    }
}
