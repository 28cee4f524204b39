//! What the step remembers of two bodies that can touch.

use palpate_collision::contact::ContactSet;
use palpate_collision::solid_contact::SolidContact;
use palpate_constraints::warm_start::WarmStart;

use crate::world::{Change, Near, Pair};

/// What the step remembers of a pair of bodies.
pub(super) struct PairState {
    pub(super) contacts: PairContacts,
    pub(super) warm_start: WarmStart,
}

/// Contacts of the last step.
pub(super) enum PairContacts {
    Tissue(ContactSet),
    Solids(Vec<SolidContact>),
}

impl PairState {
    pub(super) fn new(pair: &Pair) -> Self {
        let most = pair.detection.max_contacts;
        let contacts = match pair.near {
            Near::Soft => PairContacts::Tissue(ContactSet::with_capacity(most)),
            Near::Rigid(_) | Near::Fixed(_) => PairContacts::Solids(Vec::with_capacity(most)),
        };
        Self { contacts, warm_start: WarmStart::with_capacity(most) }
    }

    /// Renumbers the skin's features where an event has changed it.
    pub(super) fn renumber(&mut self, change: &Change) {
        if matches!(self.contacts, PairContacts::Tissue(_)) {
            self.warm_start.renumber(|feature| change.feature(feature));
        }
    }

    pub(super) fn forget(&mut self) {
        self.warm_start.clear();
    }

    /// A contact of the last step, by its number; of tissue its point of the skin.
    pub(super) fn contact(&self, number: usize) -> Option<SolidContact> {
        match &self.contacts {
            PairContacts::Solids(contacts) => contacts.get(number).copied(),
            PairContacts::Tissue(set) => set.contacts.get(number).map(|contact| SolidContact {
                feature: contact.feature,
                normal: contact.normal,
                point: contact.tissue_point,
                gap: contact.gap,
            }),
        }
    }
}
