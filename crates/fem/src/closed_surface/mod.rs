//! Closed triangle surfaces, from STL, OBJ and PLY, and the signed distance to them.

mod obj;
mod ply;
mod stl;
mod tree;

use std::collections::HashMap;
use std::path::Path;

use nalgebra::Vector3;

use crate::stuffing::LevelSet;
use tree::TriangleTree;

/// A closed, consistently oriented triangle surface in metres, outward normals by the right-hand rule.
///
/// It may have several shells: one inside another with reversed orientation is a void.
#[derive(Clone, Debug)]
pub struct ClosedSurface {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    tree: TriangleTree,
}

/// Why a surface was refused.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// The file could not be opened or read.
    #[error("{file}: {source}; check that the path is right and the file readable")]
    Io {
        /// The file as it was named.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The extension names no surface format that is read here.
    #[error("{file}: not a surface that is read here; give an STL, OBJ or PLY file")]
    UnknownFormat {
        /// The file as it was named.
        file: String,
    },
    /// The content breaks its format.
    #[error("{format}: {message}")]
    Malformed {
        /// Name of the format.
        format: &'static str,
        /// What is wrong, where, and the remedy.
        message: String,
    },
    /// Triangles or coordinates that make no surface.
    #[error("surface: {message}")]
    Degenerate {
        /// What is wrong.
        message: String,
    },
    /// Edges that belong to one triangle only, or to more than two.
    #[error(
        "the surface is not closed: {open} of {edges} edges have one triangle, {crowded} more than two; the first is \
         between {first:?} and {second:?} m; fill holes and remove inner sheets (for instance in MeshLab: \
         'Close Holes', 'Repair non Manifold Edges'), then try again"
    )]
    NotClosed {
        /// Edges with a single triangle.
        open: usize,
        /// Edges with more than two triangles.
        crowded: usize,
        /// All edges.
        edges: usize,
        /// One end of the first such edge (m).
        first: [f64; 3],
        /// Its other end (m).
        second: [f64; 3],
    },
    /// Neighbouring triangles that turn opposite ways.
    #[error(
        "the surface is not consistently oriented: at {edges} edges the two triangles turn opposite ways; \
         re-orient all faces coherently (in MeshLab: 'Re-Orient all faces coherently'), then try again"
    )]
    NotOriented {
        /// Edges whose triangles disagree.
        edges: usize,
    },
    /// The same, within a named file.
    #[error("{file}: {source}")]
    InFile {
        /// The file as it was named.
        file: String,
        /// What is wrong in it.
        source: Box<SurfaceError>,
    },
}

/// Triangles over vertices as a file holds them.
pub(crate) struct Soup {
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl ClosedSurface {
    /// Makes a surface of triangles over vertices (m), and checks it: indices in range, finite coordinates, every
    /// edge with two triangles that run through it in opposite directions. Vertices at the same place become one,
    /// triangles that then have fewer than three corners are left out, and a surface that encloses a negative volume
    /// is turned inside out.
    ///
    /// # Errors
    /// [`SurfaceError::Degenerate`] for coordinates, an index or a volume that make no body,
    /// [`SurfaceError::NotClosed`], [`SurfaceError::NotOriented`].
    pub fn new(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, SurfaceError> {
        let degenerate = |message: String| Err(SurfaceError::Degenerate { message });
        if let Some(v) = vertices.iter().position(|x| x.iter().any(|c| !c.is_finite())) {
            return degenerate(format!("vertex {v} has the coordinates {:?}", vertices[v].as_slice()));
        }
        if let Some(t) = triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertices.len())) {
            return degenerate(format!("triangle {t} names vertex {:?} of {}", triangles[t], vertices.len()));
        }
        let (vertices, mut triangles) = merge(&vertices, &triangles);
        if triangles.is_empty() {
            return degenerate("there are no triangles with three different corners".into());
        }
        check_closed(&vertices, &triangles)?;
        if enclosed_volume(&vertices, &triangles) < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let tree = TriangleTree::new(&vertices, &triangles);
        Ok(Self { vertices, triangles, tree })
    }

    /// Reads `.stl`, `.obj` or `.ply`, by the name's ending. The formats hold no unit: coordinates are multiplied by
    /// `scale` (1.0 for files in metres, 1e-3 for millimetres).
    ///
    /// # Errors
    /// [`SurfaceError::Io`], [`SurfaceError::UnknownFormat`], or [`SurfaceError::InFile`] with what is wrong in the
    /// file.
    pub fn from_path(path: impl AsRef<Path>, scale: f64) -> Result<Self, SurfaceError> {
        let path = path.as_ref();
        let file = path.display().to_string();
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let read: fn(&[u8], f64) -> Result<Self, SurfaceError> = match extension.as_str() {
            "stl" => Self::from_stl_bytes,
            "obj" => Self::from_obj_bytes,
            "ply" => Self::from_ply_bytes,
            _ => return Err(SurfaceError::UnknownFormat { file }),
        };
        let bytes = std::fs::read(path).map_err(|source| SurfaceError::Io { file: file.clone(), source })?;
        read(&bytes, scale).map_err(|source| SurfaceError::InFile { file, source: Box::new(source) })
    }

    /// Reads an STL file, text or binary.
    ///
    /// # Errors
    /// [`SurfaceError::Malformed`] with the place of the first mistake, and as [`ClosedSurface::new`].
    pub fn from_stl_bytes(bytes: &[u8], scale: f64) -> Result<Self, SurfaceError> {
        Self::from_soup(stl::read(bytes)?, scale)
    }

    /// Reads a Wavefront OBJ file: `v` and `f`; everything else is passed over.
    ///
    /// # Errors
    /// [`SurfaceError::Malformed`] with the line of the first mistake, and as [`ClosedSurface::new`].
    pub fn from_obj_bytes(bytes: &[u8], scale: f64) -> Result<Self, SurfaceError> {
        Self::from_soup(obj::read(bytes)?, scale)
    }

    /// Reads a PLY file, text or binary of either byte order.
    ///
    /// # Errors
    /// [`SurfaceError::Malformed`] with the place of the first mistake, and as [`ClosedSurface::new`].
    pub fn from_ply_bytes(bytes: &[u8], scale: f64) -> Result<Self, SurfaceError> {
        Self::from_soup(ply::read(bytes)?, scale)
    }

    fn from_soup(soup: Soup, scale: f64) -> Result<Self, SurfaceError> {
        Self::new(soup.vertices.into_iter().map(|x| x * scale).collect(), soup.triangles)
    }

    /// Positions of the vertices (m).
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Three vertices per triangle, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Enclosed volume (m³).
    pub fn volume(&self) -> f64 {
        enclosed_volume(&self.vertices, &self.triangles)
    }

    /// Signed distance (m), positive inside.
    pub fn signed_distance(&self, point: &Vector3<f64>) -> f64 {
        let distance = self.tree.distance(point);
        if self.tree.winding(point) > 0 { distance } else { -distance }
    }
}

impl LevelSet for ClosedSurface {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        self.signed_distance(point)
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        self.tree.bounds()
    }
}

/// Vertices at the same place become one; triangles that lose a corner by it are dropped.
fn merge(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(vertices.len());
    let mut kept = Vec::new();
    let mut number = Vec::with_capacity(vertices.len());
    for x in vertices {
        // Adding +0 makes -0 and 0 the same place.
        let place = [x[0], x[1], x[2]].map(|c| (c + 0.0).to_bits());
        number.push(*first.entry(place).or_insert_with(|| {
            kept.push(*x);
            kept.len() as u32 - 1
        }));
    }
    let triangles = triangles
        .iter()
        .map(|t| t.map(|v| number[v as usize]))
        .filter(|[p, q, r]| p != q && q != r && r != p)
        .collect();
    (kept, triangles)
}

/// Every edge must have two triangles, in opposite directions.
fn check_closed(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Result<(), SurfaceError> {
    // (lower vertex, higher vertex, runs from lower to higher)
    let mut edges: Vec<(u32, u32, bool)> = triangles
        .iter()
        .flat_map(|&[p, q, r]| [(p, q), (q, r), (r, p)])
        .map(|(p, q)| (p.min(q), p.max(q), p < q))
        .collect();
    edges.sort_unstable();
    let (mut open, mut crowded, mut twisted, mut count) = (0, 0, 0, 0);
    let mut first = None;
    for edge in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        count += 1;
        let forward = edge.iter().filter(|e| e.2).count();
        match edge.len() {
            2 if forward == 1 => {}
            2 => twisted += 1,
            n => {
                open += usize::from(n % 2 == 1 && n == 1);
                crowded += usize::from(n > 2);
                first = first.or(Some((edge[0].0, edge[0].1)));
            }
        }
    }
    if let Some((p, q)) = first {
        let at = |v: u32| vertices[v as usize].into();
        return Err(SurfaceError::NotClosed { open, crowded, edges: count, first: at(p), second: at(q) });
    }
    if twisted > 0 {
        return Err(SurfaceError::NotOriented { edges: twisted });
    }
    Ok(())
}

/// Sum of the signed tetrahedra over the first vertex.
fn enclosed_volume(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let apex = vertices.first().copied().unwrap_or_default();
    let six_fold: f64 = triangles
        .iter()
        .map(|t| {
            let [p, q, r] = t.map(|v| vertices[v as usize] - apex);
            p.cross(&q).dot(&r)
        })
        .sum();
    six_fold / 6.0
}
