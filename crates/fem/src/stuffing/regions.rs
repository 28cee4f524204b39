//! Regions of a mesh from the labels of an image.
//!
//! Every tetrahedron is sampled on a barycentric grid about as fine as the voxels. Regions are then filled in
//! ascending order of their labels' volume: a region takes free tetrahedra by descending share of its label until it
//! has the label's volume, but none with a share below `MIN_SHARE`; the largest region takes the rest. So a branching
//! or small structure keeps its volume where a majority vote would lose it. Every label gets the tetrahedron that
//! holds most of it, unless its volume is less than half a tetrahedron: stray voxels are no region.

use crate::mesh::TetMesh;

use super::quality::volume;
use super::{RegionReport, Stuffing};
use crate::image::LabelImage;

/// Least share of a tetrahedron that must show a label for it to join that region on its own.
const MIN_SHARE: f64 = 0.1;

/// Sets `regions` and `region_names` of a mesh of the whole organ; returns what became of each label.
pub(super) fn assign(mesh: &mut TetMesh, image: &LabelImage, stuffing: &Stuffing) -> Vec<RegionReport> {
    let histogram = image.histogram();
    let mut labels: Vec<u8> = (1..=255u8).filter(|&l| histogram[usize::from(l)] > 0).collect();
    labels.sort_by_key(|&l| (histogram[usize::from(l)], l));
    let order = |label: u8| labels.iter().position(|&l| l == label);

    let volumes: Vec<f64> = mesh.tetrahedra.iter().map(|t| volume(&t.map(|n| mesh.nodes[n as usize]))).collect();
    let mean_volume = volumes.iter().sum::<f64>() / volumes.len().max(1) as f64;
    let shares = shares(mesh, image, &order, labels.len());

    let free = u16::MAX;
    let mut taken = vec![free; mesh.tetrahedra.len()];
    let mut regions = Vec::new();
    for (rank, &label) in labels.iter().enumerate() {
        let label_volume = histogram[usize::from(label)] as f64 * image.voxel_volume();
        let share = |t: usize| f64::from(shares[t * labels.len() + rank]);
        let mut candidates: Vec<usize> = (0..taken.len()).filter(|&t| taken[t] == free).collect();
        let largest = rank + 1 == labels.len();
        if !largest && label_volume < 0.5 * mean_volume {
            candidates.clear();
        }
        if !largest {
            candidates.retain(|&t| share(t) > 0.0);
            candidates.sort_by(|&s, &t| share(t).total_cmp(&share(s)).then(s.cmp(&t)));
        }
        let mut volume = 0.0;
        let mut tetrahedra = 0;
        let mut least_share = 1.0f64;
        for t in candidates {
            // Half of the next tetrahedron beyond the label's volume is the nearest that whole ones come to it.
            let enough = volume + 0.5 * volumes[t] > label_volume || share(t) < MIN_SHARE;
            if !largest && enough && tetrahedra > 0 {
                break;
            }
            taken[t] = rank as u16;
            volume += volumes[t];
            tetrahedra += 1;
            least_share = least_share.min(share(t));
        }
        regions.push(RegionReport {
            label,
            name: stuffing.name_of(label),
            label_volume,
            volume,
            tetrahedra,
            least_share,
        });
    }

    // Regions in the order of the label table and then of the labels; those without a tetrahedron are left out.
    let place = |label: u8| stuffing.labels.iter().position(|(l, _)| *l == label).unwrap_or(usize::MAX);
    let mut named: Vec<usize> = (0..regions.len()).filter(|&r| regions[r].tetrahedra > 0).collect();
    named.sort_by_key(|&r| (place(regions[r].label), regions[r].label));
    let mut number = vec![0u16; regions.len()];
    named.iter().enumerate().for_each(|(n, &r)| number[r] = n as u16);
    mesh.regions = taken.iter().map(|&rank| number[usize::from(rank)]).collect();
    mesh.region_names = named.iter().map(|&r| regions[r].name.clone()).collect();
    regions.sort_by_key(|r| (place(r.label), r.label));
    regions
}

/// Share of each label (by its rank) among the labelled samples of each tetrahedron, row by row.
fn shares(mesh: &TetMesh, image: &LabelImage, order: &impl Fn(u8) -> Option<usize>, ranks: usize) -> Vec<f32> {
    let mut rank_of = [usize::MAX; 256];
    for label in 1..=255u8 {
        rank_of[usize::from(label)] = order(label).unwrap_or(usize::MAX);
    }
    let voxel = image.spacing.iter().copied().fold(f64::INFINITY, f64::min);
    let mut shares = vec![0.0f32; mesh.tetrahedra.len() * ranks];
    for (tetrahedron, row) in mesh.tetrahedra.iter().zip(shares.chunks_exact_mut(ranks.max(1))) {
        let [p, q, r, s] = tetrahedron.map(|n| mesh.nodes[n as usize]);
        let longest = [q - p, r - p, s - p, r - q, s - q, s - r].iter().map(|e| e.norm()).fold(0.0, f64::max);
        let steps = (longest / voxel).ceil().clamp(4.0, 9.0) as usize;
        let mut labelled = 0.0f32;
        for i in 0..steps {
            for j in 0..steps - i {
                for k in 0..steps - i - j {
                    let [a, b, c] = [i, j, k].map(|x| (x as f64 + 0.25) / steps as f64);
                    let point = p + (q - p) * a + (r - p) * b + (s - p) * c;
                    if let Some(share) = row.get_mut(rank_of[usize::from(image.label_at(&point))]) {
                        *share += 1.0;
                        labelled += 1.0;
                    }
                }
            }
        }
        row.iter_mut().for_each(|share| *share /= labelled.max(1.0));
    }
    shares
}
