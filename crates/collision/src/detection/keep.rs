//! Which features become contacts.

use nalgebra::Vector3;

use super::{DetectionConfig, DetectionReport};
use crate::contact::Contact;
use crate::features::{Feature, by_depth, retain_from};

/// Keeps of the features from `start` on, those of one part of the tool, the ones on the side from which it came; `passed`
/// says whether the part's core for a point lies in the body, and is asked only where that decides. Returns how many went.
pub(crate) fn keep_faced(
    features: &mut Vec<Feature>,
    start: usize,
    side: &Vector3<f64>,
    passed: impl Fn(&Vector3<f64>) -> bool,
) -> usize {
    let before = features.len();
    retain_from(features, start, |f| {
        let faces = f.side <= -1.0 || f.skin.dot(side) > f.side;
        faces && (f.side < 0.5 || passed(&f.contact.tissue_point))
    });
    if features[start..].iter().any(|f| f.submerged) {
        retain_from(features, start, |f| f.skin.dot(side) >= 0.0);
    }
    before - features.len()
}

/// The place of a feature in the order of depth: small, where features are large to move.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rank {
    gap: f64,
    feature: u64,
    index: u32,
}

impl Rank {
    fn new((index, feature): (usize, &Feature)) -> Self {
        Self { gap: feature.contact.gap, feature: feature.contact.feature, index: index as u32 }
    }

    /// The features in this order.
    fn order<'a>(ranks: &'a [Self], features: &'a [Feature]) -> impl Iterator<Item = &'a Feature> {
        ranks.iter().filter_map(|rank| features.get(rank.index as usize))
    }
}

/// Merges near-duplicates into the deepest of them, held points apart, and keeps the deepest contacts, ascending by feature.
pub(crate) fn keep_deepest(
    features: &mut Vec<Feature>,
    ranks: &mut Vec<Rank>,
    config: &DetectionConfig,
    contacts: &mut Vec<Contact>,
    report: &mut DetectionReport,
) {
    let kept = keep_deepest_of(features, ranks, config, contacts);
    report.merged += kept.merged;
    report.dropped += kept.dropped;
    report.contacts = contacts.len();
    report.deepest_gap = kept.deepest_gap;
}

/// What became of features that were no contact of their own.
pub(crate) struct Kept {
    pub(crate) merged: usize,
    pub(crate) dropped: usize,
    /// Least gap \[m\]; infinite without contacts.
    pub(crate) deepest_gap: f64,
}

/// As [`keep_deepest`], without the report of a whole detection. `ranks` is scratch.
pub(crate) fn keep_deepest_of(
    features: &mut Vec<Feature>,
    ranks: &mut Vec<Rank>,
    config: &DetectionConfig,
    contacts: &mut Vec<Contact>,
) -> Kept {
    // Triangles that share a vertex or an edge find the same point: one feature, one contact.
    features.sort_unstable_by(|a, b| a.contact.feature.cmp(&b.contact.feature).then(by_depth(a, b)));
    let before = features.len();
    features.dedup_by_key(|f| f.contact.feature);
    let mut kept = Kept { merged: before - features.len(), dropped: 0, deepest_gap: f64::INFINITY };
    let features = features.as_slice();
    ranks.clear();
    ranks.extend(features.iter().enumerate().map(Rank::new));
    // Ties by feature, so that the order never depends on how features were found.
    ranks.sort_unstable_by(|a, b| a.gap.total_cmp(&b.gap).then(a.feature.cmp(&b.feature)));

    let near = config.merge_distance * config.merge_distance;
    let aligned = config.merge_angle.min(std::f64::consts::PI).cos();
    contacts.reserve(config.max_contacts.min(ranks.capacity()));
    for (visited, feature) in Rank::order(ranks, features).enumerate() {
        if contacts.len() == config.max_contacts {
            kept.dropped = ranks.len() - visited;
            break;
        }
        let c = &feature.contact;
        let twin = |other: &Contact| {
            (other.tissue_point - c.tissue_point).norm_squared() <= near
                && other.normal.dot(&c.normal) >= aligned
                && !Rank::order(ranks, features).any(|f| f.held && f.contact.feature == other.feature)
        };
        if !feature.held && contacts.iter().any(twin) {
            kept.merged += 1;
        } else {
            contacts.push(*c);
        }
    }
    kept.deepest_gap = contacts.first().map_or(f64::INFINITY, |c| c.gap);
    contacts.sort_unstable_by_key(|c| c.feature);
    kept
}
