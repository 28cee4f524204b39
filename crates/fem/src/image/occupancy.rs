//! The smooth field of a label image: its occupancy, averaged over a coarser grid and blurred.
//!
//! Occupancy is 1 where the label is not 0. Its exact average over cubic grid cells is blurred with a Gaussian of
//! standard deviation σ, which removes the staircase of the voxels. The organ is `{occupancy > iso}`, where `iso` is
//! chosen so that this set has the volume of the labels: a blurred field cut at 1/2 loses volume wherever the
//! surface is convex. Voids that the outside cannot reach are filled. The value is `(occupancy - iso) σ √(2π)`:
//! across a flat face a blurred step has the slope 1/(σ √(2π)), so that near the surface values are distances (m).

use nalgebra::Vector3;

use super::LabelImage;
use crate::stuffing::LevelSet;

/// Most cells of the smoothed grid; beyond it the grid is made coarser.
const MAX_GRID_CELLS: f64 = (1u64 << 25) as f64;
/// The kernel is cut at this many standard deviations.
const KERNEL_REACH: f64 = 3.0;

/// Level set of all labelled voxels, sampled trilinearly.
#[derive(Clone, Debug)]
pub struct SmoothedOccupancy {
    dims: [usize; 3],
    /// Edge of a grid cell (m).
    spacing: f64,
    /// Outer corner of the grid (m).
    origin: Vector3<f64>,
    /// One value per grid cell, at its centre, x fastest.
    occupancy: Vec<f32>,
    iso: f32,
    /// Metres per unit of occupancy.
    slope: f64,
    bounds: [Vector3<f64>; 2],
    volume: f64,
    filled_volume: f64,
}

impl SmoothedOccupancy {
    /// Field of `image` on a grid of edge about `spacing` (m), blurred with standard deviation `sigma` (m)
    /// (both positive). `None` if the image holds background only.
    pub fn new(image: &LabelImage, spacing: f64, sigma: f64) -> Option<Self> {
        let (low, high) = occupied_voxels(image)?;
        let lower = Vector3::from_fn(|a, _| image.origin[a] + low[a] as f64 * image.spacing[a]);
        let upper = Vector3::from_fn(|a, _| image.origin[a] + (high[a] + 1) as f64 * image.spacing[a]);

        let extent = (upper - lower).add_scalar(2.0 * KERNEL_REACH * sigma);
        let spacing = spacing.max((extent.iter().product::<f64>() / MAX_GRID_CELLS).cbrt());
        // Two empty cells beyond the kernel's reach let the outside flow around the organ.
        let dims = [0, 1, 2].map(|a| (extent[a] / spacing).ceil() as usize + 4);
        let origin = Vector3::from_fn(|a, _| 0.5 * (lower[a] + upper[a] - dims[a] as f64 * spacing));

        let mut occupancy = box_average(image, (low, high), dims, spacing, &origin);
        let filled_volume = fill_voids(&mut occupancy, dims) * spacing.powi(3);
        blur(&mut occupancy, dims, sigma / spacing);
        let volume = image.labels.iter().filter(|&&label| label != 0).count() as f64 * image.voxel_volume();
        let iso = iso_of_volume(&occupancy, (volume + filled_volume) / spacing.powi(3));
        // The average over a grid cell adds the variance of a box to that of the kernel.
        let width = (sigma * sigma + spacing * spacing / 12.0).sqrt();
        Some(Self {
            dims,
            spacing,
            origin,
            occupancy,
            iso,
            slope: width * (2.0 * std::f64::consts::PI).sqrt(),
            bounds: [lower, upper],
            volume,
            filled_volume,
        })
    }

    /// Volume of all labelled voxels (m³).
    pub fn label_volume(&self) -> f64 {
        self.volume
    }

    /// Volume of the voids that were filled (m³).
    pub fn filled_volume(&self) -> f64 {
        self.filled_volume
    }
}

impl LevelSet for SmoothedOccupancy {
    fn value(&self, point: &Vector3<f64>) -> f64 {
        let mut base = [0usize; 3];
        let mut part = [0.0; 3];
        for a in 0..3 {
            let x = (point[a] - self.origin[a]) / self.spacing - 0.5;
            if !(x >= 0.0 && x < (self.dims[a] - 1) as f64) {
                return -f64::from(self.iso) * self.slope;
            }
            base[a] = x as usize;
            part[a] = x - base[a] as f64;
        }
        let [nx, ny, _] = self.dims;
        let at = |i: usize, j: usize, k: usize| {
            f64::from(self.occupancy[base[0] + i + nx * (base[1] + j + ny * (base[2] + k))])
        };
        let along_x = |j, k| at(0, j, k) * (1.0 - part[0]) + at(1, j, k) * part[0];
        let along_y = |k| along_x(0, k) * (1.0 - part[1]) + along_x(1, k) * part[1];
        (along_y(0) * (1.0 - part[2]) + along_y(1) * part[2] - f64::from(self.iso)) * self.slope
    }

    fn bounds(&self) -> [Vector3<f64>; 2] {
        self.bounds
    }
}

/// First and last voxel that is not background, along each axis.
fn occupied_voxels(image: &LabelImage) -> Option<([usize; 3], [usize; 3])> {
    let [nx, ny, _] = image.dims;
    let mut low = [usize::MAX; 3];
    let mut high = [0; 3];
    for (row, labels) in image.labels.chunks_exact(nx).enumerate() {
        let Some(first) = labels.iter().position(|&l| l != 0) else { continue };
        let last = labels.iter().rposition(|&l| l != 0).unwrap_or(first);
        for (a, (from, to)) in [(first, last), (row % ny, row % ny), (row / ny, row / ny)].into_iter().enumerate() {
            low[a] = low[a].min(from);
            high[a] = high[a].max(to);
        }
    }
    (low[0] != usize::MAX).then_some((low, high))
}

/// Share of every grid cell that labelled voxels fill, exact.
fn box_average(
    image: &LabelImage,
    (low, high): ([usize; 3], [usize; 3]),
    dims: [usize; 3],
    spacing: f64,
    origin: &Vector3<f64>,
) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    let mut occupancy = vec![0.0f32; nx * ny * nz];
    let mut slice = vec![0.0f64; nx * ny];
    let mut line = vec![0.0f64; nx];
    // Voxel range [low, high] of an axis in units of grid cells.
    let voxel_in_cells = |a: usize, i: usize| {
        let start = (image.origin[a] + i as f64 * image.spacing[a] - origin[a]) / spacing;
        (start, start + image.spacing[a] / spacing)
    };
    for k in low[2]..=high[2] {
        slice.fill(0.0);
        for j in low[1]..=high[1] {
            let row = (k * image.dims[1] + j) * image.dims[0];
            let labels = &image.labels[row + low[0]..=row + high[0]];
            line.fill(0.0);
            let mut any = false;
            let mut start = None;
            // Runs of labelled voxels, each spread over the cells that it covers.
            for (i, &label) in labels.iter().chain(&[0]).enumerate() {
                match (label != 0, start) {
                    (true, None) => start = Some(i),
                    (false, Some(from)) => {
                        any = true;
                        let (x0, _) = voxel_in_cells(0, low[0] + from);
                        let (x1, _) = voxel_in_cells(0, low[0] + i);
                        spread(x0, x1, |cell, share| line[cell] += share);
                        start = None;
                    }
                    _ => {}
                }
            }
            if any {
                let (y0, y1) = voxel_in_cells(1, j);
                spread(y0, y1, |cell, share| {
                    for (sum, x) in slice[cell * nx..(cell + 1) * nx].iter_mut().zip(&line) {
                        *sum += share * x;
                    }
                });
            }
        }
        let (z0, z1) = voxel_in_cells(2, k);
        spread(z0, z1, |cell, share| {
            for (sum, x) in occupancy[cell * nx * ny..(cell + 1) * nx * ny].iter_mut().zip(&slice) {
                *sum += (share * x) as f32;
            }
        });
    }
    occupancy
}

/// Calls `add(cell, length)` for each unit cell that the interval overlaps.
fn spread(from: f64, to: f64, mut add: impl FnMut(usize, f64)) {
    for cell in from.floor() as usize..to.ceil() as usize {
        let overlap = to.min(cell as f64 + 1.0) - from.max(cell as f64);
        if overlap > 0.0 {
            add(cell, overlap);
        }
    }
}

/// Separable Gaussian of standard deviation `sigma` cells; background outside.
fn blur(values: &mut [f32], dims: [usize; 3], sigma: f64) {
    let reach = (KERNEL_REACH * sigma).ceil() as usize;
    if reach == 0 {
        return;
    }
    let mut kernel: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32).collect();
    let total = 2.0 * kernel.iter().sum::<f32>() - kernel[0];
    kernel.iter_mut().for_each(|w| *w /= total);

    let [nx, ny, nz] = dims;
    // A "line" is one x-row (stride 1) or one whole row of neighbours (y, z): the inner loop runs along x each time.
    let mut line = vec![0.0f32; nx + 2 * reach];
    for row in values.chunks_exact_mut(nx) {
        line[reach..reach + nx].copy_from_slice(row);
        for (i, out) in row.iter_mut().enumerate() {
            let mut sum = kernel[0] * line[i + reach];
            for (d, w) in kernel.iter().enumerate().skip(1) {
                sum += w * (line[i + reach - d] + line[i + reach + d]);
            }
            *out = sum;
        }
    }
    let mut plane = vec![0.0f32; nx * ny];
    for slab in values.chunks_exact_mut(nx * ny) {
        plane.copy_from_slice(slab);
        blur_rows(&plane, slab, nx, &kernel);
    }
    let mut plane = vec![0.0f32; nx * nz];
    let mut blurred = vec![0.0f32; nx * nz];
    for j in 0..ny {
        for k in 0..nz {
            let at = nx * (j + ny * k);
            plane[nx * k..nx * (k + 1)].copy_from_slice(&values[at..at + nx]);
        }
        blur_rows(&plane, &mut blurred, nx, &kernel);
        for k in 0..nz {
            let at = nx * (j + ny * k);
            values[at..at + nx].copy_from_slice(&blurred[nx * k..nx * (k + 1)]);
        }
    }
}

/// Blurs across the rows of a plane: row r of the result is the weighted sum of its neighbouring rows.
fn blur_rows(plane: &[f32], out: &mut [f32], nx: usize, kernel: &[f32]) {
    let rows = plane.len() / nx;
    for (r, target) in out.chunks_exact_mut(nx).enumerate() {
        target.fill(0.0);
        let first = r.saturating_sub(kernel.len() - 1);
        let last = (r + kernel.len() - 1).min(rows - 1);
        for s in first..=last {
            let w = kernel[r.abs_diff(s)];
            for (t, x) in target.iter_mut().zip(&plane[nx * s..nx * (s + 1)]) {
                *t += w * x;
            }
        }
    }
}

/// The value that `cells` grid cells exceed, kept within [0.2, 0.7] so that the surface stays within the blur.
fn iso_of_volume(occupancy: &[f32], cells: f64) -> f32 {
    let mut sorted = occupancy.to_vec();
    let rank = (cells.round() as usize).clamp(1, sorted.len() - 1);
    let (_, iso, _) = sorted.select_nth_unstable_by(rank, |a, b| b.total_cmp(a));
    iso.clamp(0.2, 0.7)
}

/// Fills what the outside cannot reach through cells that are less than half full, together with the partly filled
/// cells around it; returns the occupancy that was missing there.
fn fill_voids(occupancy: &mut [f32], dims: [usize; 3]) -> f64 {
    let mut outside = vec![false; occupancy.len()];
    // The two outermost layers are empty by construction, so that the first cell is outside.
    let mut stack = vec![0usize];
    outside[0] = true;
    while let Some(cell) = stack.pop() {
        for_each_neighbour(cell, dims, |other| {
            if !outside[other] && occupancy[other] < 0.5 {
                outside[other] = true;
                stack.push(other);
            }
        });
    }
    let voids: Vec<usize> = (0..occupancy.len()).filter(|&c| !outside[c] && occupancy[c] < 0.5).collect();
    let mut missing = 0.0;
    let mut fill = |cell: usize| {
        missing += f64::from(1.0 - occupancy[cell]);
        occupancy[cell] = 1.0;
    };
    for cell in voids {
        fill(cell);
        for_each_neighbour(cell, dims, |other| {
            if !outside[other] {
                fill(other);
            }
        });
    }
    missing
}

/// The up to six cells that share a face with a cell.
fn for_each_neighbour(cell: usize, [nx, ny, nz]: [usize; 3], mut visit: impl FnMut(usize)) {
    let (i, j, k) = (cell % nx, cell / nx % ny, cell / (nx * ny));
    for (at, size, stride) in [(i, nx, 1), (j, ny, nx), (k, nz, nx * ny)] {
        if at > 0 {
            visit(cell - stride);
        }
        if at + 1 < size {
            visit(cell + stride);
        }
    }
}
