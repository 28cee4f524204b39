//! `palpate chart`: the files that it writes, and that the numbers in them say what theory says.

use crate::program_runs::Place;

/// A table as rows of (column, value).
fn table(place: &Place, name: &str) -> Vec<Vec<(String, String)>> {
    let mut reader = csv::Reader::from_path(place.path(name)).unwrap();
    let columns: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let row = |r: csv::StringRecord| columns.iter().cloned().zip(r.iter().map(String::from)).collect();
    reader.records().map(|r| row(r.unwrap())).collect()
}

fn text<'a>(row: &'a [(String, String)], column: &str) -> &'a str {
    &row.iter().find(|(c, _)| c == column).unwrap_or_else(|| panic!("no column {column}")).1
}

fn number(row: &[(String, String)], column: &str) -> f64 {
    text(row, column).parse().unwrap_or_else(|_| panic!("{column}: {:?}", text(row, column)))
}

#[test]
fn a_quick_chart_of_tissue_is_a_picture_and_tables_of_what_theory_says() {
    let place = Place::new();
    let run = place.run("chart tissue --quick --out charts");
    assert_eq!(run.code, Some(0), "{run:?}");
    for file in ["tissue.svg", "tissue.csv", "tissue_rod.csv", "tissue_indentation.csv", "tissue_sphere.csv"] {
        assert!(run.out.contains(file) && place.path(&format!("charts/{file}")).is_file(), "{file}: {}", run.out);
    }
    let picture = place.text("charts/tissue.svg");
    for label in
        ["neo_hookean", "beam, quadratic", "sphere, averaged", "Sphere on a block", "time per step [ms]", "MuJoCo"]
    {
        assert!(picture.contains(label), "{label}");
    }

    // Poisson 0.49: linear tetrahedra lock, the others do not.
    let bending = table(&place, "charts/tissue.csv");
    let error = |element: &str| {
        let row = bending.iter().find(|row| text(row, "element") == element).expect("every element is measured");
        assert!(number(row, "step [ms]") > 0.0);
        number(row, "error [%]")
    };
    assert!(error("linear") > 30.0, "{}", error("linear"));
    assert!(error("averaged") < 0.7 * error("linear"), "{} {}", error("averaged"), error("linear"));
    assert!(error("quadratic") < 0.2 * error("linear"), "{} {}", error("quadratic"), error("linear"));

    // The tip sinks as the mesh is refined, towards the measured -116 mm.
    let rods = table(&place, "charts/tissue_rod.csv");
    for element in ["linear", "averaged", "quadratic"] {
        let ours = |row: &&Vec<(String, String)>| text(row, "rod") == "ours" && text(row, "element") == element;
        let tips: Vec<f64> = rods.iter().filter(ours).map(|row| number(row, "tip at rest y [mm]")).collect();
        assert!(tips.len() == 2 && tips[1] < tips[0] && tips[1] > -120.0, "{element}: {tips:?}");
    }

    let pressed = table(&place, "charts/tissue_indentation.csv");
    assert_eq!(pressed.len(), 6, "three elements, two kinds of contact");
    assert!(pressed.iter().all(|row| number(row, "worst [%]").is_finite()), "{pressed:?}");
}

#[test]
fn a_quick_chart_of_solvers_is_a_picture_and_tables_that_agree() {
    let place = Place::new();
    let run = place.run("chart solvers --quick --out charts");
    assert_eq!(run.code, Some(0), "{run:?}");
    let tables =
        ["solvers", "solvers_profile", "solvers_curves", "solvers_residual", "solvers_times", "solvers_methods"];
    for file in tables.map(|name| format!("{name}.csv")).iter().chain([&"solvers.svg".to_string()]) {
        assert!(run.out.contains(file) && place.path(&format!("charts/{file}")).is_file(), "{file}: {}", run.out);
    }
    assert!(run.out.contains("no problem files"), "what was left out is told: {}", run.out);
    let picture = place.text("charts/solvers.svg");
    for label in ["share of problems solved", "natural-map residual", "wedged block", "Lagrange multipliers", "penalty"]
    {
        assert!(picture.contains(label), "{label}");
    }

    // Four problems of tissue, six of rigid bodies, eight solvers, two tolerances; what is called solved meets the tolerance.
    let every = table(&place, "charts/solvers.csv");
    assert_eq!(every.len(), 10 * 8 * 2);
    let solved = |row: &&Vec<(String, String)>| text(row, "status") == "solved";
    assert!(every.iter().filter(solved).all(|row| number(row, "residual") <= 1.001 * number(row, "tolerance")));
    let of = |solver: &str, tolerance: f64| {
        let mine = |row: &&Vec<(String, String)>| {
            text(row, "solver") == solver && number(row, "tolerance") == tolerance && solved(row)
        };
        every.iter().filter(mine).count()
    };
    assert_eq!(of("automatic", 1e-8), 10, "the automatic choice solves all");
    assert_eq!(of("conic_qp", 1e-8), 2, "the stool and the stack are without friction");
    for row in table(&place, "charts/solvers_profile.csv") {
        let (solver, tolerance) = (text(&row, "solver"), number(&row, "tolerance"));
        assert_eq!(number(&row, "solves") as usize, of(solver, tolerance), "{solver}");
        assert_eq!(number(&row, "of"), 10.0);
        // The curve ends at the share that the table counts.
        let curves = table(&place, "charts/solvers_curves.csv");
        let mine = curves.iter().rfind(|p| text(p, "solver") == solver && number(p, "tolerance") == tolerance).unwrap();
        assert!((number(mine, "share of problems solved") - number(&row, "solves") / 10.0).abs() < 1e-12, "{solver}");
    }
    // Residuals against time fall from point to point, and are there for every solver of the three problems.
    let residuals = table(&place, "charts/solvers_residual.csv");
    for problem in ["block, nodes, 30 contacts", "block, faces, 30 contacts", "wedged block"] {
        for solver in palpate::solver::solver::Solver::NAMES {
            let mine = |row: &&Vec<(String, String)>| text(row, "problem") == problem && text(row, "solver") == *solver;
            let points: Vec<_> = residuals.iter().filter(mine).collect();
            assert!(!points.is_empty(), "{problem}, {solver}");
            for pair in points.windows(2) {
                let falls = number(pair[1], "residual") <= number(pair[0], "residual");
                assert!(falls && number(pair[1], "time [ms]") >= number(pair[0], "time [ms]"), "{problem}, {solver}");
            }
        }
    }
    for row in table(&place, "charts/solvers_times.csv") {
        assert!(
            number(&row, "warm to 1e-3, gauss_seidel [µs]") > 0.0 && number(&row, "its residual") < 1e-2,
            "{row:?}"
        );
    }

    // The two exact methods agree with the reference to their tolerance of 1e-4 times the condition of the force; a penalty is
    // wrong by its compliance, a hundredfold stiffness leaves a hundredth of it, more or less.
    let methods = table(&place, "charts/solvers_methods.csv");
    let errors = |name: &str| -> Vec<f64> {
        let rows = methods.iter().filter(|row| text(row, "method") == name);
        rows.map(|row| number(row, "error of the force")).collect()
    };
    assert!(errors("compliance, exact")[0] < 1e-3 && errors("Lagrange multipliers")[0] < 1e-3, "{methods:?}");
    let penalty = errors("penalty");
    let fall = penalty[0] / penalty[1];
    assert!(penalty.len() == 2 && penalty[0] > 0.02 && (20.0..200.0).contains(&fall), "{penalty:?}");
}

#[test]
fn a_chart_refuses_folders_that_are_not_there_and_names_that_it_does_not_know() {
    let place = Place::new();
    let run = place.run("chart tissue --data nowhere --quick");
    assert_eq!(run.code, Some(2));
    assert!(run.err.contains("nowhere") && run.err.contains("--data"), "{run:?}");
    let run = place.run("chart tisue");
    assert_eq!(run.code, Some(2));
    assert!(run.err.contains("tissue"), "the nearest name: {run:?}");
    place.write("file", "");
    let run = place.run("chart tissue --quick --out file/charts");
    assert_eq!(run.code, Some(2), "{run:?}");
    assert_eq!(place.files(), ["file", "scene.toml"], "nothing was written");
}

#[test]
fn a_quick_chart_of_compliance_says_that_error_grows_with_age_and_the_exact_correction_obeys_the_equations() {
    let place = Place::new();
    let run = place.run("chart compliance --quick --out charts");
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(place.text("charts/compliance.svg").contains("precomputed, warped, exact"));
    let rows = table(&place, "charts/compliance.csv");
    // Three motions: the exact method, and with each of two corrections two sources of W at five ages and one at one.
    assert_eq!(rows.len(), 3 * (1 + 2 * (2 * 5 + 1)));
    for row in rows.iter().filter(|row| text(row, "correction") == "exact") {
        // The solves stop at 1e-6 of their right side.
        assert!(number(row, "imbalance [%]") <= 1e-4, "{row:?}");
    }
    let (warped, plain, gathered) = ("async, warped", "async, not warped", "precomputed, warped");
    let of = |motion: &str, source: &str, correction: &str| -> Vec<&Vec<(String, String)>> {
        let of = |row: &&Vec<(String, String)>| {
            [("motion", motion), ("compliance", source), ("correction", correction)]
                .iter()
                .all(|(k, v)| text(row, k) == *v)
        };
        rows.iter().filter(of).collect()
    };
    let errors = |motion: &str, source: &str, correction: &str| -> Vec<f64> {
        of(motion, source, correction).iter().map(|row| number(row, "error of forces [%]")).collect()
    };
    let mut left_alone = 0;
    for motion in ["twisting", "pressed deep"] {
        for source in [warped, plain] {
            let (before, after) = (errors(motion, source, "matching"), errors(motion, source, "exact"));
            // The solver stops at a residual of 1e-6, relative to the forces.
            assert!(before.len() == 5 && before[0] < 1e-2, "a factor of the step itself is exact: {before:?}");
            assert!(before.windows(2).all(|pair| pair[0] < pair[1]), "{motion}, {source}: {before:?}");
            assert!(of(motion, source, "matching").iter().all(|row| text(row, "refined") == "no"));
            for ((row, before), after) in of(motion, source, "exact").iter().zip(&before).zip(&after) {
                match text(row, "refined") {
                    "yes" => assert!(after < before, "{motion}, {source}: refined, {before} -> {after}"),
                    // As a run leaves them where W is right to half a percent along them.
                    _ => {
                        left_alone += u32::from(*before > 0.05);
                        assert!(*before < 2.0 && (after - before).abs() < 1e-2, "{motion}, {source}: {before} {after}");
                    }
                }
            }
        }
        // The precomputed inverse is that of the oldest factor, but for rounding to single precision.
        let (old, precomputed) = (errors(motion, warped, "matching")[4], errors(motion, gathered, "matching")[0]);
        assert!((old - precomputed).abs() < 1e-2, "{motion}: {old} {precomputed}");
    }
    assert!(left_alone > 0, "what a run does not refine is not refined here");
    let (with, without) = (errors("twisting", warped, "matching")[4], errors("twisting", plain, "matching")[4]);
    assert!(with < 0.2 * without, "warping serves a twist: {with} {without}");
}

#[test]
fn a_quick_chart_of_haptics_is_a_picture_and_tables_that_satisfy_the_theory() {
    let place = Place::new();
    let run = place.run("chart haptics --quick --out charts");
    assert_eq!(run.code, Some(0), "{run:?}");
    let files = ["haptics_wall.csv", "haptics_wall_damping.csv", "haptics_couplings.csv", "haptics_force.csv"];
    for file in files.into_iter().chain(["haptics.svg"]) {
        assert!(run.out.contains(file) && place.path(&format!("charts/{file}")).is_file(), "{file}: {}", run.out);
    }
    let picture = place.text("charts/haptics.svg");
    for label in
        ["line b = K T/2", "firm hand", "Stable couplings: block, tissue at 30 Hz", "frozen rows", "45 degrees"]
    {
        assert!(picture.contains(label), "{label}");
    }

    // Colgate and Schenkel's line within 5 %, by motion and by eigenvalues; delay costs two thirds; hands add damping.
    let walls = table(&place, "charts/haptics_wall.csv");
    let of = |curve: &str| -> Vec<f64> {
        let rows = walls.iter().filter(|row| text(row, "curve") == curve);
        rows.map(|row| number(row, "stable up to K [N/m]")).collect()
    };
    let line: Vec<f64> = [0.1, 0.5, 2.0].iter().map(|b| 2.0 * b / 1e-3).collect();
    let close = |edges: &[f64], expected: f64, share: f64| {
        edges.len() == 3 && edges.iter().zip(&line).all(|(edge, line)| (edge / (expected * line) - 1.0).abs() < share)
    };
    assert!(close(&of("ideal device, motion"), 1.0, 0.05), "{walls:?}");
    assert!(close(&of("ideal device, eigenvalues"), 1.0, 0.05), "{walls:?}");
    assert!(close(&of("one tick of delay"), 1.0 / 3.0, 0.05), "{walls:?}");
    let [loose, normal, firm] = ["loose hand", "normal hand", "firm hand"].map(of);
    for k in 0..3 {
        assert!(line[k] < loose[k] && loose[k] < normal[k] && normal[k] < firm[k], "{loose:?} {normal:?} {firm:?}");
    }
    // A damper in the wall keeps it passive only up to a softer spring; stable it is beyond.
    for row in table(&place, "charts/haptics_wall_damping.csv") {
        if text(&row, "curve").starts_with("ideal device") {
            assert!(number(&row, "K/theory") > 0.99, "{row:?}");
        }
    }

    // A force that is held for a step allows softer couplings than a loop at 1 kHz, the softer the slower the tissue.
    let couplings = table(&place, "charts/haptics_couplings.csv");
    let stiffest = |method: &str, rate: f64| {
        let of = |row: &&Vec<(String, String)>| text(row, "method") == method && number(row, "tissue [Hz]") == rate;
        number(couplings.iter().find(of).unwrap(), "stable up to K of the coupling [N/m]")
    };
    for rate in [10.0, 30.0] {
        let held = stiffest("force held for a step", rate);
        assert!(stiffest("local patch", rate) > 4.0 * held.max(25.0), "{couplings:?}");
    }

    // First touch: within 10 % on a patch, straight on and at 45 degrees; a held force misses most of it.
    let force = table(&place, "charts/haptics_force.csv");
    for touch in ["block, touched straight on", "block, touched at 45 degrees"] {
        let error = |method: &str| {
            let of = |row: &&Vec<(String, String)>| {
                text(row, "scene") == touch && text(row, "method") == method && number(row, "tissue [Hz]") == 30.0
            };
            number(force.iter().find(of).unwrap(), "first 100 ms [%]")
        };
        assert!(error("local patch") < 10.0, "{touch}: {force:?}");
        assert!(error("force held for a step") > 2.0 * error("local patch"), "{touch}: {force:?}");
    }
}
