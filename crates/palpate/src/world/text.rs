//! A world in words: what was understood of its scene.

use std::fmt::Write as _;

use palpate_fem::sparse::FIXED;

use super::{Integration, World};
use crate::counted::counted;
use crate::scene::{BodyDescription, ContactMethod, Readable};

impl World {
    /// How contact forces are found at step rate, with the parameters of the method.
    pub fn contact_method(&self) -> String {
        let contact = &self.description().contact;
        let penalty = contact.penalty.unwrap_or_default();
        match (contact.method, penalty.stiffness) {
            (ContactMethod::Penalty, Some(k)) => {
                format!("penalty ({} N/m, damping {} s)", Readable(k), Readable(penalty.damping))
            }
            (ContactMethod::Penalty, None) => {
                format!(
                    "penalty ({} times the body's stiffness, damping {} s)",
                    Readable(penalty.multiple),
                    Readable(penalty.damping)
                )
            }
            (method, _) => method.name().into(),
        }
    }

    /// The body as a run begins, in words.
    fn beginning(&self) -> String {
        let body = &self.description().bodies[0];
        match self.settled() {
            Some(report) if report.is_converged() => "settled before the run".into(),
            Some(report) => format!("settles under {:.1} % of it only", 100.0 * report.reached),
            None if !body.settle => "begins as its mesh".into(),
            None if self.description().gravity == [0.0; 3] => "begins as its mesh, which has no weight".into(),
            None => "begins as its mesh, which nothing holds".into(),
        }
    }

    /// What was understood of the scene, as text for people.
    pub fn understood(&self) -> String {
        let d = self.description();
        let body = &d.bodies[0];
        let q = &self.quality;
        let mut text = String::new();
        let fixed = self.model.free_of_node().iter().filter(|&&free| free == FIXED).count();
        // Writing to a string cannot fail.
        let described = if d.description.is_empty() { "" } else { ": " };
        let _ = writeln!(text, "scene {}{described}{}", d.name, d.description);
        let _ = writeln!(
            text,
            "body {}: {} nodes ({fixed} fixed), {} ({}), {:.1} cm³, {:.3} kg",
            body.name,
            self.mesh.nodes.len(),
            counted(self.mesh.tetrahedra.len(), "tetrahedron", "tetrahedra"),
            body.element.name(),
            q.volume * 1e6,
            self.model.mass().iter().sum::<f64>(),
        );
        for (k, name) in self.mesh.region_names.iter().enumerate() {
            let count = self.mesh.regions.iter().filter(|&&r| usize::from(r) == k).count();
            let _ = writeln!(
                text,
                "  region {name}: {}, {}",
                counted(count, "tetrahedron", "tetrahedra"),
                material_of(body, name)
            );
        }
        let _ = writeln!(text, "  dihedral angles {:.1}° to {:.1}°", q.dihedral[0], q.dihedral[2]);
        let mass = body
            .total_mass
            .map_or(format!("{} kg/m³", Readable(body.density)), |m| format!("{} kg in equal shares", Readable(m)));
        let [x, y, z] = d.gravity.map(Readable);
        let _ = writeln!(
            text,
            "  {mass}; Rayleigh damping {} 1/s by mass, {} s by stiffness; gravity [{x}, {y}, {z}] m/s², {}",
            Readable(body.rayleigh_mass),
            Readable(body.rayleigh_stiffness),
            self.beginning(),
        );
        let on = |on: bool| if on { "on" } else { "off" };
        let _ = writeln!(
            text,
            "  definiteness filter {}, guard {}; conjugate gradients to {:e} in at most {}",
            on(body.definiteness_filter),
            on(body.guard),
            body.tolerance,
            counted(body.max_iterations, "iteration", "iterations"),
        );
        text.push_str(&self.bodies.to_string());
        let _ = writeln!(text, "tool {}: {}", d.tools[0].name, one_line(&d.tools[0].shape));
        let c = &d.contact;
        let _ = writeln!(
            text,
            "contact at {} by {} within {:.1} mm, at most {}; law {}",
            format!("{:?}", c.at).to_lowercase(),
            self.contact_method(),
            c.margin * 1e3,
            counted(c.max_contacts, "contact", "contacts"),
            c.law_in_words()
        );
        for change in &self.changes {
            let _ = writeln!(text, "event at {} s: {}", Readable(change.time()), change.text());
        }
        let s = &d.solver;
        let _ = match c.method {
            ContactMethod::Compliance => writeln!(text, "solver: {}", one_line(s)),
            // A direct approach takes no solver's kind.
            _ => writeln!(
                text,
                "solver: {} to {:e} in at most {}; a tick by Gauss-Seidel to {:e} in at most {}",
                c.method.name(),
                s.tolerance,
                counted(s.max_sweeps, "iteration", "iterations"),
                s.tick_tolerance,
                counted(s.tick_sweeps, "sweep", "sweeps")
            ),
        };
        let _ = writeln!(text, "tick: {}", self.tick_method());
        let _ = writeln!(text, "{}", self.force_path());
        let _ = writeln!(text, "integrator: {}", self.integration);
        let _ = writeln!(
            text,
            "rates: step {} Hz, factor {} Hz, tick {} Hz; compliance {}{}",
            Readable(d.rates.step),
            Readable(d.rates.factor),
            Readable(d.rates.tick),
            match self.integration {
                Integration::BackwardEuler => self.plan.compliance.name(),
                Integration::Newton(_) => "of the step's own matrix",
                Integration::Explicit { .. } => "of the lumped mass, in every substep",
            },
            if self.plan.ladder.is_some() { " and more exact where the accuracy asks for it" } else { "" }
        );
        let _ = writeln!(text, "plan: {}", self.plan);
        let _ = write!(
            text,
            "factor: {:.2} million nonzeros, {:.0} million operations; device {}, hand {}, {} s",
            self.symbolic.nonzeros() as f64 / 1e6,
            self.symbolic.flops() / 1e6,
            d.device.kind,
            d.hand.preset,
            Readable(d.seconds)
        );
        text
    }
}

fn material_of(body: &BodyDescription, region: &str) -> String {
    let tissue = body.regions.get(region).unwrap_or(&body.material);
    let mut text = one_line(&tissue.law);
    for (k, term) in tissue.viscosity.iter().enumerate() {
        let lead = if k == 0 { "; of the shear modulus relax" } else { "," };
        // Writing to a string cannot fail.
        let _ = write!(text, "{lead} {:.1} % in {} s", 100.0 * term.modulus, Readable(term.time));
    }
    text
}

/// A value as a scene file would say it, on one line.
fn one_line(value: &impl serde::Serialize) -> String {
    toml::to_string(value).unwrap_or_default().trim_end().replace('\n', ", ")
}
