//! Measures of a mesh: counts, volume, angles, shape of the elements, regions.

use std::fmt;

use nalgebra::Vector3;
use serde::Serialize;

use super::check::is_flat;
use super::{BoundingBox, MeshWarning, TetMesh, corners, repeated, signed_volume};

/// Tetrahedra with a smaller radius ratio are called poor. Four corners of a square lifted alternately by 1.2 % of its
/// side, the typical sliver of a Delaunay mesh, have this ratio.
pub const POOR_RADIUS_RATIO: f64 = 0.05;

/// A body on which a hand works is not wider than this (m); a wider one is plainly in other units than metres.
pub const WIDEST_BODY: f64 = 3.0;

/// What can be measured of a mesh, good or bad.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MeshQuality {
    /// Nodes.
    pub nodes: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Sum of the signed volumes (m³).
    pub volume: f64,
    /// Smallest and largest coordinates (m).
    pub bounds: [[f64; 3]; 2],
    /// Boundary triangles.
    pub surface_triangles: usize,
    /// Boundary nodes.
    pub surface_nodes: usize,
    /// Area of the boundary (m²).
    pub surface_area: f64,
    /// How the boundary hangs together.
    pub surface: crate::surface::SurfaceTopology,
    /// Parts that share no node.
    pub parts: usize,
    /// Smallest, median and largest angle between two faces of a tetrahedron (degrees); regular: 70.5.
    pub dihedral: [f64; 3],
    /// Smallest and median of 3 r/R (inscribed over circumscribed radius); 1 is regular, 0 is flat.
    pub radius_ratio: [f64; 2],
    /// The radius ratio that one tetrahedron in twenty falls below.
    pub radius_ratio_p05: f64,
    /// The tetrahedron of the smallest radius ratio.
    pub worst: u32,
    /// Tetrahedra with a radius ratio below [`POOR_RADIUS_RATIO`].
    pub poor: usize,
    /// Shortest and longest edge (m).
    pub edge: [f64; 2],
    /// Tetrahedra of negative volume.
    pub inverted: usize,
    /// Tetrahedra of no volume.
    pub flat: usize,
    /// Tetrahedra whose nodes another one has already.
    pub duplicate: usize,
    /// Nodes without tetrahedra.
    pub unused: usize,
    /// Each region.
    pub regions: Vec<RegionQuality>,
    /// Name and number of nodes of each node set.
    pub node_sets: Vec<(String, usize)>,
}

/// What can be measured of one region.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RegionQuality {
    /// Its name.
    pub name: String,
    /// Its tetrahedra.
    pub tetrahedra: usize,
    /// Its volume (m³).
    pub volume: f64,
}

/// Shape of one tetrahedron.
struct Shape {
    dihedral: [f64; 6],
    radius_ratio: f64,
    edge: [f64; 2],
}

impl MeshQuality {
    /// Measures a mesh, which may be inverted, flat or duplicate in places.
    ///
    /// # Panics
    /// If a tetrahedron uses a node that does not exist.
    pub fn measure(mesh: &TetMesh) -> MeshQuality {
        let surface = mesh.surface();
        let BoundingBox { min, max } = mesh.bounding_box();
        let names = mesh.region_names.iter();
        let mut quality = MeshQuality {
            nodes: mesh.nodes.len(),
            tetrahedra: mesh.tetrahedra.len(),
            bounds: [min.into(), max.into()],
            surface_triangles: surface.triangles.len(),
            surface_nodes: surface.nodes.len(),
            surface_area: surface.area(&mesh.nodes),
            surface: surface.topology(),
            parts: parts(mesh),
            duplicate: repeated(&mesh.tetrahedra).len(),
            unused: mesh.used_nodes().iter().filter(|used| !**used).count(),
            regions: names.map(|name| RegionQuality { name: name.clone(), ..RegionQuality::default() }).collect(),
            node_sets: mesh.node_sets.iter().map(|(name, set)| (name.clone(), set.len())).collect(),
            edge: [f64::INFINITY, 0.0],
            ..MeshQuality::default()
        };
        quality.measure_shapes(mesh);
        quality
    }

    fn measure_shapes(&mut self, mesh: &TetMesh) {
        let mut dihedral = Vec::with_capacity(6 * mesh.tetrahedra.len());
        let mut ratios: Vec<(f64, u32)> = Vec::with_capacity(mesh.tetrahedra.len());
        for (t, &tetrahedron) in mesh.tetrahedra.iter().enumerate() {
            let x = corners(&mesh.nodes, tetrahedron);
            let volume = signed_volume(&x);
            let shape = measure_shape(&x, volume);
            dihedral.extend(shape.dihedral);
            ratios.push((shape.radius_ratio, t as u32));
            self.edge = [self.edge[0].min(shape.edge[0]), self.edge[1].max(shape.edge[1])];
            self.volume += volume;
            if is_flat(&x, volume).0 {
                self.flat += 1;
            } else if volume < 0.0 {
                self.inverted += 1;
            }
            let region = mesh.regions.get(t).and_then(|&region| self.regions.get_mut(region as usize));
            if let Some(region) = region {
                region.tetrahedra += 1;
                region.volume += volume;
            }
        }
        if ratios.is_empty() {
            self.edge = [0.0; 2];
            return;
        }
        dihedral.sort_unstable_by(f64::total_cmp);
        ratios.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let last = ratios.len() - 1;
        self.dihedral = [dihedral[0], dihedral[dihedral.len() / 2], dihedral[dihedral.len() - 1]];
        self.radius_ratio = [ratios[0].0, ratios[last / 2].0];
        self.radius_ratio_p05 = ratios[last / 20].0;
        self.worst = ratios[0].1;
        self.poor = ratios.partition_point(|ratio| ratio.0 < POOR_RADIUS_RATIO);
    }

    /// What a user should know about this mesh although it can be used.
    pub fn warnings(&self) -> Vec<MeshWarning> {
        let mut warnings = Vec::new();
        let diagonal = (Vector3::from(self.bounds[1]) - Vector3::from(self.bounds[0])).norm();
        warnings.extend(MeshWarning::of_width(diagonal));
        if self.poor > 0 {
            let (worst, radius_ratio) = (self.worst, self.radius_ratio[0]);
            warnings.push(MeshWarning::PoorElements { tetrahedra: self.poor, worst, radius_ratio });
        }
        if self.parts > 1 {
            warnings.push(MeshWarning::Disconnected { parts: self.parts });
        }
        warnings
    }
}

/// Edges, dihedral angles and radius ratio 3 r/R, with r = 3 |V| / Σ A and
/// R = |a² (b × c) + b² (c × a) + c² (a × b)| / (12 |V|) for the edges a, b, c from one corner.
fn measure_shape(x: &[Vector3<f64>; 4], volume: f64) -> Shape {
    let [a, b, c] = [x[1] - x[0], x[2] - x[0], x[3] - x[0]];
    let (ab, ac, bc) = ((b - a).norm(), (c - a).norm(), (c - b).norm());
    let edges = [a.norm(), b.norm(), c.norm(), ab, ac, bc];
    // Outward normals times twice the area; opposite corner 3, 2, 1, 0. Their angle is π minus the dihedral one.
    let normals = [b.cross(&a), a.cross(&c), c.cross(&b), (b - a).cross(&(c - a))];
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let dihedral = pairs.map(|(i, j)| {
        let (p, q) = (normals[i], normals[j]);
        // The arc tangent keeps its digits for slivers, where the cosine is close to one.
        180.0 - p.cross(&q).norm().atan2(p.dot(&q)).to_degrees()
    });
    let area = normals.iter().map(|normal| 0.5 * normal.norm()).sum::<f64>();
    let r = 3.0 * volume.abs() / area;
    let centre = b.cross(&c) * a.norm_squared() + c.cross(&a) * b.norm_squared() + a.cross(&b) * c.norm_squared();
    let ratio = 3.0 * r * 12.0 * volume.abs() / centre.norm();
    let fold = |start: f64, f: fn(f64, f64) -> f64| edges.into_iter().fold(start, f);
    Shape {
        dihedral,
        radius_ratio: if ratio.is_finite() { ratio } else { 0.0 },
        edge: [fold(f64::INFINITY, f64::min), fold(0.0, f64::max)],
    }
}

/// Number of parts that share no node, by union of the nodes of each tetrahedron.
fn parts(mesh: &TetMesh) -> usize {
    let mut parent: Vec<u32> = (0..mesh.nodes.len() as u32).collect();
    fn root(parent: &mut [u32], mut node: u32) -> u32 {
        while parent[node as usize] != node {
            let up = parent[parent[node as usize] as usize];
            parent[node as usize] = up;
            node = up;
        }
        node
    }
    for (t, &[first, others @ ..]) in mesh.tetrahedra.iter().enumerate() {
        for node in others.into_iter().chain(mesh.mid_nodes.get(t).copied().into_iter().flatten()) {
            let (p, q) = (root(&mut parent, first), root(&mut parent, node));
            parent[p.max(q) as usize] = p.min(q);
        }
    }
    let used = mesh.used_nodes();
    (0..parent.len()).filter(|&node| used[node] && parent[node] as usize == node).count()
}

impl fmt::Display for MeshQuality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = Vector3::from(self.bounds[1]) - Vector3::from(self.bounds[0]);
        let [least, median, most] = self.dihedral;
        writeln!(f, "nodes            {}", self.nodes)?;
        writeln!(f, "tetrahedra       {}", self.tetrahedra)?;
        writeln!(f, "size             {:.4} x {:.4} x {:.4} m", size.x, size.y, size.z)?;
        writeln!(f, "volume           {:.6e} m³", self.volume)?;
        let closed = if self.surface.closed { "closed" } else { "open" };
        writeln!(
            f,
            "surface          {} triangles, {} nodes, {:.6e} m², {closed}, Euler characteristic {}",
            self.surface_triangles, self.surface_nodes, self.surface_area, self.surface.euler_characteristic
        )?;
        writeln!(f, "parts            {}", self.parts)?;
        writeln!(f, "dihedral angles  {least:.2} to {most:.2} degrees, median {median:.2}")?;
        let [worst, middle] = self.radius_ratio;
        let p05 = self.radius_ratio_p05;
        writeln!(f, "radius ratio     {worst:.4} (tetrahedron {}), 5 % {p05:.4}, median {middle:.4}", self.worst)?;
        writeln!(f, "edges            {:.4e} to {:.4e} m", self.edge[0], self.edge[1])?;
        writeln!(
            f,
            "faults           {} inverted, {} flat, {} duplicate tetrahedra, {} unused nodes",
            self.inverted, self.flat, self.duplicate, self.unused
        )?;
        for region in &self.regions {
            writeln!(f, "region {:?}: {} tetrahedra, {:.6e} m³", region.name, region.tetrahedra, region.volume)?;
        }
        for (name, nodes) in &self.node_sets {
            writeln!(f, "node set {name:?}: {nodes} nodes")?;
        }
        Ok(())
    }
}
