//! Sticking: whether a contact has friction left.

use nalgebra::Vector3;

use super::Law;

/// Share of the law's friction up to which a contact sticks: what is nearer to the limit may slide with the next rounding.
const STICKS: f64 = 0.999;

impl Law {
    /// Whether a force that the law admits (N) holds its point along the tangents: with a thousandth more along them it is
    /// admitted still. False where the force is not finite.
    #[must_use]
    pub fn sticks(&self, force: &Vector3<f64>) -> bool {
        let more = Vector3::new(force.x, force.y / STICKS, force.z / STICKS);
        self.project(&more) == more
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Bilateral, Coulomb, FacetedCoulomb, Tresca};
    use super::*;

    #[test]
    fn a_contact_sticks_up_to_a_thousandth_below_its_friction() {
        let cone = Law::from(Coulomb { friction: 0.5 });
        let disc = Law::from(Tresca { limit: 1.0 });
        // Facets whose corners carry all of the friction: along one corner they hold as much as the cone.
        let facets = Law::from(FacetedCoulomb { friction: 0.5, facets: 4 });
        for (law, direction) in [(cone, [0.6, 0.8]), (disc, [-0.8, 0.6]), (facets, [1.0, 0.0])] {
            let at = |share: f64| Vector3::new(2.0, share * direction[0], share * direction[1]);
            assert!(law.sticks(&at(0.0)) && law.sticks(&at(0.998)), "{}", law.name());
            assert!(!law.sticks(&at(0.9995)) && !law.sticks(&at(1.0)), "{}", law.name());
            assert!(!law.sticks(&at(f64::NAN)), "{}", law.name());
        }
        assert!(Law::from(Bilateral { rows: 3 }).sticks(&Vector3::new(-1.0, 5.0, 0.0)), "what is glued slides nowhere");
        assert!(!Law::from(Tresca { limit: 0.0 }).sticks(&Vector3::new(1.0, 1e-9, 0.0)));
    }
}
