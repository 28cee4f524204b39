//! The sphere on the mesh that an independent code was run on, with contact at its nodes.
//!
//! Ours holds the skin exactly at the sphere. The other code's note states no stiffness of its contact; what it answers is told
//! by how stiff a spring at each node makes our answers its own, for each law on its own.

use std::path::Path;

use miette::{Result, miette};
use nalgebra::Vector3;
use palpate::fem::element::ElementKind;
use palpate::fem::format;
use palpate::fem::mesh::TetMesh;

use super::indentation::{Case, DEPTHS, SIDE};
use crate::chart::table::{Table, Value};
use crate::chart::{NamedTable, Settings, Work};

/// Forces (N) of the independent code at [`DEPTHS`], by law.
const REFERENCE: [(&str, [f64; 5]); 5] = [
    ("neo_hookean", [0.1286, 0.3953, 1.1920, 2.1538, 3.5440]),
    ("linear", [0.1267, 0.3894, 1.1543, 2.0344, 3.2703]),
    ("st_venant_kirchhoff", [0.1202, 0.3607, 0.9927, 1.6370, 2.5146]),
    ("corotational", [0.1251, 0.3811, 1.1094, 1.9347, 3.1002]),
    ("stable_neo_hookean", [0.1274, 0.3922, 1.1765, 2.1150, 3.4754]),
];

/// Compliances (m/N) of the contact of a node: rigid, and springs of 40, 20 and 10 kN/m.
const COMPLIANCES: [f64; 4] = [0.0, 2.5e-5, 5e-5, 1e-4];

/// Compliance (m/N) of the stiffest contact that a fit tries, and its step.
const STIFFEST: f64 = 1e-7;

/// Half the last digit of the reference's forces (N).
const HALF_DIGIT: f64 = 0.5e-4;

/// The forces by law and contact, and the stiffness that fits each law best; nothing where the folder has no such mesh.
pub(super) fn tables(folder: &Path, settings: &Settings, work: &Work) -> Result<Vec<NamedTable>> {
    let path = folder.join("indentation/block.vtk");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let mesh = placed(&path)?;
    let mut columns = vec!["law".to_string(), "contact".into()];
    columns.extend(DEPTHS.iter().map(|d| format!("{:.0} mm [N]", 1e3 * d)));
    columns.extend(DEPTHS.iter().map(|d| format!("{:.0} mm [%]", 1e3 * d)));
    let mut forces = Table::new(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    let mut fits = Table::new(&[
        "law",
        "fitted stiffness [kN/m]",
        "worst of five depths there [%]",
        "rigid [%]",
        "mean square in half last digits",
    ]);
    let laws = if settings.quick { &REFERENCE[..1] } else { &REFERENCE[..] };
    work.expect(laws.len() * COMPLIANCES.len());
    'laws: for (law, expected) in laws {
        let mut answers = [[0.0; 5]; COMPLIANCES.len()];
        for (answer, compliance) in answers.iter_mut().zip(COMPLIANCES) {
            if !work.next(&format!("sphere on the given mesh: {law}")) {
                break 'laws;
            }
            *answer = press(law, compliance, mesh.clone())?;
            let contact = match compliance {
                0.0 => "rigid".to_string(),
                c => format!("{:.0} kN/m at nodes{}", 1e-3 / c, if c == 5e-5 { ", as the reference" } else { "" }),
            };
            let mut row: Vec<Value> = vec![(*law).into(), contact.into()];
            row.extend(answer.map(|f| Value::Number(f, 4)));
            row.extend(deviations(answer, expected).map(|d| Value::Number(100.0 * d, 2)));
            forces.push(row);
        }
        let fit = Fit::new(&answers, expected);
        let worst = |forces: &[f64; 5]| deviations(forces, expected).iter().fold(0.0_f64, |a, d| a.max(d.abs()));
        fits.push(vec![
            (*law).into(),
            // The stiffest that was tried is none.
            if fit.compliance > STIFFEST { Value::Number(1e-3 / fit.compliance, 2) } else { Value::None },
            Value::Number(100.0 * worst(&fit.forces), 3),
            Value::Number(100.0 * worst(&answers[0]), 3),
            Value::Number(fit.mean_square, 2),
        ]);
    }
    let title = "The same sphere on the mesh of other engines, contact at its nodes: force, and difference to an \
                 independent code on that mesh";
    let of_fits = "The stiffness of a node's contact that fits the independent code best, for each law on its own";
    Ok(vec![
        NamedTable { file: "tissue_same_mesh", title: title.into(), table: forces },
        NamedTable { file: "tissue_same_mesh_fit", title: of_fits.into(), table: fits },
    ])
}

/// The mesh of a file where our scene has its block, with the set of nodes at its base.
fn placed(path: &Path) -> Result<TetMesh> {
    let mut mesh = format::read(path).map_err(|e| miette!("{e}"))?.mesh;
    let low = mesh.nodes.iter().map(|x| x.z).fold(f64::MAX, f64::min);
    let centre = mesh.bounding_box().centre();
    let base = (0..mesh.nodes.len() as u32).filter(|&i| mesh.nodes[i as usize].z < low + 1e-9).collect();
    mesh.node_sets.insert("z_min".into(), base);
    for x in &mut mesh.nodes {
        *x += Vector3::new(0.5 * SIDE - centre.x, 0.5 * SIDE - centre.y, -low);
    }
    Ok(mesh)
}

/// Forces (N) at [`DEPTHS`] with contact of this compliance (m/N) at each node, as a scene asks for it.
fn press(law: &str, compliance: f64, mesh: TetMesh) -> Result<[f64; 5]> {
    let case = Case { element: ElementKind::Linear, at: "nodes", cells: 12, layers: 6, grading: 1.0 };
    let contact = if compliance > 0.0 {
        format!("method = \"penalty\"\npenalty = {{ stiffness = {:e}, damping = 0.0 }}", 1.0 / compliance)
    } else {
        String::new()
    };
    Ok(case.forces(law, &contact, mesh, &DEPTHS)?.0)
}

fn deviations(forces: &[f64; 5], expected: &[f64; 5]) -> [f64; 5] {
    std::array::from_fn(|k| forces[k] / expected[k] - 1.0)
}

/// The compliance at which the forces are nearest to the expected ones, in squares of the expected ones' half last digit.
struct Fit {
    compliance: f64,
    forces: [f64; 5],
    mean_square: f64,
}

impl Fit {
    /// From the forces at [`COMPLIANCES`], between which they are cubic to far below the last digit.
    fn new(answers: &[[f64; 5]; COMPLIANCES.len()], expected: &[f64; 5]) -> Self {
        let at = |compliance: f64| {
            let forces: [f64; 5] = std::array::from_fn(|k| {
                let weight = |i: usize| {
                    let others = (0..COMPLIANCES.len()).filter(|j| *j != i);
                    others.map(|j| (compliance - COMPLIANCES[j]) / (COMPLIANCES[i] - COMPLIANCES[j])).product::<f64>()
                };
                answers.iter().enumerate().map(|(i, answer)| weight(i) * answer[k]).sum()
            });
            let square = |k: usize| ((forces[k] - expected[k]) / HALF_DIGIT).powi(2);
            Self { compliance, forces, mean_square: (0..5).map(square).sum::<f64>() / 5.0 }
        };
        // From 10 MN/m down to 10 kN/m.
        let fits = (1..=1000).map(|step| at(STIFFEST * f64::from(step)));
        fits.reduce(|best, fit| if fit.mean_square < best.mean_square { fit } else { best }).unwrap_or_else(|| at(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_finds_the_compliance_that_made_the_forces() {
        let force = |compliance: f64, k: usize| (k + 1) as f64 / (1.0 + 400.0 * compliance * (1.0 + 50.0 * compliance));
        let answers = COMPLIANCES.map(|c| std::array::from_fn(|k| force(c, k)));
        let expected = std::array::from_fn(|k| force(3e-5, k));
        let fit = Fit::new(&answers, &expected);
        // One step of the search; between the compliances that were computed the forces are cubic to 1e-9.
        assert!((fit.compliance - 3e-5).abs() < 1.1e-7, "{}", fit.compliance);
        assert!(fit.mean_square < 1e-2, "{}", fit.mean_square);
    }

    /// The linear law alone says what `palpate chart tissue` prints for each of four: 20 kN/m at each node.
    #[test]
    fn the_references_contact_yields_by_twenty_kilonewtons_per_metre() {
        let Some(folder) = super::super::reference::folder() else {
            println!("skipped: there are no reference data; PALPATE_SHARED names their folder");
            return;
        };
        let path = folder.join("indentation/block.vtk");
        let mesh = placed(&path).unwrap();
        let (law, expected) = &REFERENCE[1];
        let fit = Fit::new(&COMPLIANCES.map(|c| press(law, c, mesh.clone()).unwrap()), expected);
        let stiffness = 1.0 / fit.compliance;
        println!("{law}: {:.3} kN/m, mean square {:.2} half digits", 1e-3 * stiffness, fit.mean_square);
        // The last digit of the smallest force, 0.04 % of it, is a fifteenth of the yielding's 0.6 %.
        assert!((stiffness / 2e4 - 1.0).abs() < 0.06, "{law}: {stiffness} N/m");
        assert!(fit.mean_square < 1.0, "{law}: {} half digits squared", fit.mean_square);
    }
}
