//! Mistakes in scenes and meshes: each is told before anything runs, with file, line and remedy, and nothing is written.

use crate::program_runs::{Outcome, Place, SCENE};

/// The answer to a scene with a mistake, after the checks that hold for every mistake.
fn refused(scene: &str) -> Outcome {
    refused_with(&Place::with(scene), "")
}

fn refused_with(place: &Place, options: &str) -> Outcome {
    let before = place.files();
    let run = place.run(&format!("run scene.toml --lockstep --steps 2 --csv a.csv --final b.vtu --json {options}"));
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.out.is_empty(), "{}", run.out);
    assert!(!run.err.contains("panicked"), "{}", run.err);
    assert_eq!(place.files(), before, "nothing is written");
    let check = place.run("check scene.toml");
    assert_eq!(check.code, Some(2), "`check` finds what `run` finds: {check:?}");
    run
}

/// [`SCENE`] with one line changed, and the number of that line.
fn changed(from: &str, to: &str) -> (String, usize) {
    assert_eq!(SCENE.matches(from).count(), 1, "{from}");
    let line = SCENE[..SCENE.find(from).unwrap()].matches('\n').count() + 1;
    (SCENE.replace(from, to), line)
}

#[test]
fn a_wrong_value_is_told_with_file_line_and_remedy() {
    // What is changed, to what, and what the message says: the value or name, and the remedy.
    let cases: &[(&str, &str, &[&str])] = &[
        ("density = 1060", "densty = 1060", &["unknown field `densty`", "did you mean `density`?"]),
        ("[hand]", "[solver]\nsweep_order = \"shuffled\"\n[hand]", &["belongs to Gauss-Seidel", "gauss_seidel"]),
        ("[hand]", "[solver]\nrelaxation = 1.5\nkind = \"gauss_seidel\"\n[hand]", &["1.5", "at most 1"]),
        ("density = 1060", "labels = { liver = 255 }", &["label image", "remove it"]),
        ("seconds = 1", "second = 1", &["unknown field `second`", "did you mean `seconds`?"]),
        ("\"neo_hookean\"", "\"neo_hokean\"", &["neo_hokean", "did you mean `neo_hookean`?"]),
        ("at = \"faces\"", "at = \"face\"", &["`face`", "did you mean `faces`?"]),
        ("kind = \"sphere\"", "kind = \"spher\"", &["`spher`", "did you mean `sphere`?"]),
        ("preset = \"arm\"", "preset = \"arn\"", &["`arn`", "did you mean `arm`?"]),
        ("seconds = 1", "seconds = \"long\"", &["string \"long\"", "a number without a unit"]),
        ("seconds = 1", "seconds = 0", &["seconds = 0", "positive"]),
        ("density = 1060", "density = -1060", &["density = -1060 kg/m³", "positive"]),
        ("density = 1060", "density = 0", &["density = 0 kg/m³", "positive"]),
        ("density = 1060", "total_mass = -1", &["total_mass = -1 kg", "positive"]),
        ("poisson = 0.4 }", "poisson = 0.5 }", &["poisson = 0.5", "soft tissue: 0.4 to 0.49"]),
        ("poisson = 0.4 }", "poisson = nan }", &["poisson = NaN", "soft tissue: 0.4 to 0.49"]),
        ("young = 10e3", "young = -10e3", &["young = -10000 Pa", "soft tissue: 1e3 to 1e6"]),
        ("friction = 0.3", "friction = -0.3", &["friction = -0.3", "positive"]),
        ("friction = 0.3", "max_contacts = 0", &["max_contacts = 0", "at least 1"]),
        ("friction = 0.3", "method = \"lagrang\"", &["`lagrang`", "did you mean `lagrange`?"]),
        ("friction = 0.3", "penalty = { multiple = 10 }", &["the method is `compliance`", "method = \"penalty\""]),
        ("radius = 0.01 }", "radius = -0.01 }", &["-0.01"]),
        ("rayleigh_stiffness = 0.005", "rayleigh_stiffness = -1", &["rayleigh_stiffness = -1 s", "positive"]),
        ("young = 10e3", "young = 1e300", &["young = 1e300 Pa", "at most 1e15"]),
        ("cells = [3, 3, 2]", "cells = [3, 0, 2]", &["3 × 0 × 2 cells", "at least 1"]),
        ("max = [0.03, 0.03, 0.03]", "max = [0.03, 0.03, -0.03]", &["min is not below max", "swap"]),
        ("node_set = \"z_min\"", "node_set = \"zmin\"", &["no node set `zmin`", "z_min"]),
        ("node_set = \"z_min\"", "region = \"bone\"", &["no region `bone`", "block"]),
        (
            "{ node_set = \"z_min\" }",
            "{ below = { axis = \"z\", at = -0.5 } }",
            &["holds no node", "z 0.0000..0.0300 m"],
        ),
        ("{ node_set = \"z_min\" }", "{ above = { axis = \"z\", at = -0.5 } }", &["every node is fixed", "fewer"]),
        ("time = 0.4", "time = 0.8", &["entry 2 is at 0.7 s, not after", "increasing times"]),
        ("time = 0.0,", "time = 0.1,", &["gap", "must be at time 0"]),
        ("time = 0.7", "time = nan", &["entry 2", "NaN", "increasing times"]),
        ("[0.0, 0.0, 0.036] }", "[0.0, 0.0, inf] }", &["entry 1", "z is inf", "metres"]),
        ("[0.0, 0.0, 0.036] }", "[0.0, 0.0, 36.0] }", &["entry 1", "m/s", "millimetres"]),
        (
            "[0.0, 0.0, 0.042] }",
            "[0.0, 0.0, 0.015] }",
            &["begins inside the body, at 0.0000, 0.0000, 0.0150 m", "outside the skin"],
        ),
        ("name = \"small\"", "name = \"../small\"", &["`../small`", "letters"]),
        ("gravity = [0, 0, 0]", "gravity = [0, 0]", &["length 2", "three numbers"]),
        ("name = \"small\"", "name = ", &["string"]),
    ];
    for (from, to, words) in cases {
        let (scene, line) = changed(from, to);
        let run = refused(&scene);
        // An entry that is out of order shows against the one before it.
        let lines = [line, line + 1];
        let placed = lines.iter().any(|l| run.err.contains(&format!("scene.toml:{l}:")));
        assert!(placed, "{to}: no place on line {line}: {}", run.err);
        for word in *words {
            assert!(run.err.contains(word), "{to}: no `{word}` in {}", run.err);
        }
    }
}

#[test]
fn a_contact_method_that_cannot_be_is_refused() {
    let (scene, line) = changed("friction = 0.3", "method = \"penalty\"\npenalty = { stiffness = -5 }");
    let run = refused(&scene);
    assert!(run.err.contains("stiffness = -5 N/m") && run.err.contains("positive"), "{}", run.err);
    assert!(run.err.contains(&format!("scene.toml:{}:", line + 1)), "{}", run.err);
    let (scene, line) = changed("friction = 0.3", "method = \"lagrange\"");
    let run = refused(&scene.replace("density = 1060", "density = 1060\nintegrator = \"newton\""));
    assert!(run.err.contains("one linearised step") && run.err.contains("backward_euler"), "{}", run.err);
    assert!(run.err.contains(&format!("scene.toml:{}:", line + 1)), "{}", run.err);
}

#[test]
fn rates_that_make_no_step_are_refused() {
    for (rates, word) in [
        ("step = 0", "step = 0 Hz"),
        ("factor = 0", "factor = 0 Hz"),
        ("tick = -1", "tick = -1 Hz"),
        ("tick = 10", "below the step rate"),
        ("step = inf", "step = inf Hz"),
    ] {
        let run = refused(&format!("{SCENE}\n[rates]\n{rates}\n"));
        let line = SCENE.matches('\n').count() + 3;
        assert!(run.err.contains(word) && run.err.contains(&format!("scene.toml:{line}:")), "{rates}: {}", run.err);
    }
}

#[test]
fn a_scene_without_body_tool_or_path_is_refused() {
    let without = |from: &str, to: &str| {
        let (a, b) = (SCENE.find(from).unwrap(), SCENE.find(to).unwrap());
        refused(&format!("{}{}", &SCENE[..a], &SCENE[b..])).err
    };
    assert!(without("[[body]]", "[[tool]]").contains("body"));
    assert!(without("[[tool]]", "[contact]").contains("tool"));
    let path = &SCENE[SCENE.find("path = [").unwrap()..];
    assert!(refused(&SCENE.replace(path, "")).err.contains("hand script is empty"));
    let two =
        SCENE.replace("[contact]", "[[tool]]\nname = \"b\"\nshape = { kind = \"sphere\", radius = 0.01 }\n[contact]");
    assert!(refused(&two).err.contains("2 tools"));
    let block = "block = { min = [-0.03, -0.03, 0.0], max = [0.03, 0.03, 0.03], cells = [3, 3, 2] }";
    assert!(refused(&SCENE.replace(block, "")).err.contains("no geometry"));
    assert!(
        refused(&SCENE.replace(block, &format!("{block}\nmesh = \"a.vtu\""))).err.contains("more than one geometry")
    );
    assert!(refused(&SCENE.replace(block, &format!("{block}\ncell = 0.01"))).err.contains("`cell` belongs to `image`"));
}

/// [`SCENE`] with a mesh file in place of its block, held below 1 mm.
fn on_mesh(file: &str, more: &str) -> String {
    let a = SCENE.find("block = {").unwrap();
    let b = a + SCENE[a..].find('\n').unwrap();
    let text = format!("{}mesh = \"{file}\"\n{more}{}", &SCENE[..a], &SCENE[b..]);
    text.replace("{ node_set = \"z_min\" }", "{ below = { axis = \"z\", at = 0.001 } }")
}

/// A Gmsh file of one tetrahedron with the corners `nodes`, in the given order.
fn one_element(nodes: [[f64; 3]; 4], element: &str) -> String {
    let lines: Vec<_> = (0..4).map(|i| format!("{} {} {} {}", i + 1, nodes[i][0], nodes[i][1], nodes[i][2])).collect();
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n{}\n$EndNodes\n$Elements\n{element}\n$EndElements\n",
        lines.join("\n")
    )
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.03]];

#[test]
fn an_unusable_mesh_is_told_with_its_own_file_and_line() {
    let flat = [CORNERS[0], CORNERS[1], CORNERS[2], [0.01, 0.01, 0.0]];
    let infinite = [CORNERS[0], CORNERS[1], CORNERS[2], [0.0, 0.0, f64::NAN]];
    let cases: &[(&str, String, &[&str])] = &[
        ("flat.msh", one_element(flat, "1\n1 4 2 1 1 1 2 3 4"), &["flat.msh:13", "tetrahedron", "volume"]),
        ("nan.msh", one_element(infinite, "1\n1 4 2 1 1 1 2 3 4"), &["nan.msh:9", "node 3", "finite number"]),
        (
            "hex.msh",
            one_element(CORNERS, "1\n1 5 2 1 1 1 2 3 4 1 2 3 4"),
            &["hex.msh:13", "hexahedra", "linear tetrahedra"],
        ),
        ("far.msh", one_element(CORNERS, "1\n1 4 2 1 1 1 2 3 9"), &["far.msh:13", "node 9", "correct the number"]),
        ("cut.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0".into(), &["cut.msh:5", "cut off"]),
        ("text.msh", "not a mesh".into(), &["text.msh:1", "expected $MeshFormat"]),
        ("skin.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), &["skin.obj", "palpate mesh make"]),
    ];
    for (file, text, words) in cases {
        let place = Place::with(&on_mesh(file, ""));
        place.write(file, text);
        let run = refused_with(&place, "");
        for word in *words {
            assert!(run.err.contains(word), "{file}: no `{word}` in {}", run.err);
        }
    }
    let missing = refused(&on_mesh("nowhere.msh", ""));
    assert!(missing.err.contains("nowhere.msh") && missing.err.contains("check the path"), "{}", missing.err);
}

#[test]
fn one_inverted_tetrahedron_among_sound_ones_is_told() {
    let place = Place::with(&on_mesh("turned.msh", ""));
    place.write(
        "turned.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 0.03 0 0\n3 0 0.03 0\n4 0 0 0.03\n5 0.03 0.03 0.03\n\
         $EndNodes\n$Elements\n2\n1 4 2 1 1 1 2 3 4\n2 4 2 1 1 2 3 5 4\n$EndElements\n",
    );
    let run = refused_with(&place, "");
    assert!(run.err.contains("turned.msh:15") && run.err.contains("inverted"), "{}", run.err);
    // The mesh itself can be described, and the description says why it is refused.
    let mesh = place.run("mesh turned.msh");
    assert!(mesh.code == Some(5) && mesh.out.contains("refused: "), "{mesh:?}");
    let json: serde_json::Value = serde_json::from_str(&place.run("mesh turned.msh --json").out).unwrap();
    assert!(json["refusal"].as_str().unwrap().contains("inverted"));
}

#[test]
fn a_mesh_in_millimetres_is_told_with_the_scale_that_mends_it() {
    let place = Place::new();
    assert_eq!(place.run("run scene.toml --lockstep --steps 1 --no-trace --final block.vtu").code, Some(0));
    let metres = palpate::fem::format::read(&place.path("block.vtu")).unwrap().mesh;
    palpate::fem::format::write_vtu(place.path("mm.vtu"), &metres.scaled(1000.0).unwrap(), &[]).unwrap();
    // Read as metres, the block swallows the tool: the refusal says what is likely behind it.
    place.write("scene.toml", &on_mesh("mm.vtu", ""));
    let run = refused_with(&place, "");
    assert!(run.err.contains("begins inside the body") && run.err.contains("`scale = 0.001`"), "{}", run.err);
    let mesh = place.run("mesh mm.vtu");
    assert!(mesh.code == Some(0) && mesh.out.contains("warning: the mesh would be"), "{mesh:?}");
    // The offered scale mends it.
    place.write("scene.toml", &on_mesh("mm.vtu", "scale = 0.001\n"));
    let run = place.run("run scene.toml --lockstep --steps 2 --no-trace --json");
    assert!(run.code == Some(0) && !run.err.contains("scale"), "{run:?}");
}

#[test]
fn a_name_that_is_no_scene_is_told_with_the_nearest() {
    let place = Place::new();
    for (name, word) in [
        ("livr", "did you mean `liver`?"),
        ("blocks", "did you mean `block`?"),
        ("zzz", "liver, block"),
        ("none.toml", "none.toml: No such file"),
    ] {
        for command in ["run", "check"] {
            let run = place.run(&format!("{command} {name}"));
            assert!(run.code == Some(2) && run.err.contains(word), "{command} {name}: {run:?}");
        }
    }
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn options_that_make_no_run_are_refused() {
    let place = Place::new();
    for (options, word) in [
        ("--steps 0", "--steps"),
        ("--seconds 0", "positive"),
        ("--seconds -1", "positive"),
        ("--seconds nan", "positive"),
        ("--threads 0", "1 to 1024"),
        ("--scale 0.001", "--mesh"),
        ("--cell 3", "brings its own tetrahedra"),
        ("--cell 3furlongs", "unknown unit"),
        ("--trace a.mcap --no-trace", "cannot be used with"),
        ("--steps 3 --seconds 1", "cannot be used with"),
        ("--fast", "unexpected argument"),
    ] {
        let run = place.run(&format!("run scene.toml --lockstep {options}"));
        assert!(run.code == Some(2) && run.err.contains(word), "{options}: {run:?}");
    }
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn files_that_cannot_be_written_are_found_before_the_run() {
    let place = Place::new();
    for (options, word) in [
        ("--csv nowhere/a.csv", "--csv nowhere/a.csv: cannot be written"),
        ("--final nowhere/a.vtu", "--final nowhere/a.vtu: cannot be written"),
        ("--final scene.toml/a.vtu", "cannot be written"),
        ("--final a.vtk", "only VTU is written"),
        ("--csv scene.toml", "would overwrite an input"),
        ("--trace scene.toml", "would overwrite an input"),
        ("--trace a.mcap --csv a.svg", "are both a.svg"),
        ("--trace a.svg", "are both a.svg"),
        ("--no-trace --csv a.vtu --final ./a.vtu", "are both"),
    ] {
        // A run of this length would not end.
        let run = place.run(&format!("run scene.toml --lockstep --seconds 1e9 {options}"));
        assert!(run.code == Some(2) && run.err.contains(word), "{options}: {run:?}");
    }
    assert_eq!(place.files(), ["scene.toml"]);
    assert_eq!(place.text("scene.toml"), SCENE);
}

#[test]
fn no_command_writes_over_what_it_reads() {
    let place = Place::new();
    assert_eq!(
        place.run("run scene.toml --lockstep --steps 2 --final body.vtu --save-problems problems").code,
        Some(0)
    );
    place.write("again.toml", &SCENE.replace("name = \"small\"", "name = \"again\""));
    let again = place.text("again.toml");
    place.write("again.toml", &format!("{again}\n[device]\nkind = \"replay\"\ntrace = \"again.mcap\"\n"));
    std::fs::rename(place.path("small.mcap"), place.path("again.mcap")).unwrap();
    let mesh = SCENE.lines().filter(|line| !line.starts_with("block")).collect::<Vec<_>>().join("\n");
    place.write("meshed.toml", &mesh.replace("[[body]]", "[[body]]\nmesh = \"body.vtu\""));
    let problem = std::fs::read_dir(place.path("problems")).unwrap().next().unwrap().unwrap().path();
    let problem = format!("problems/{}", problem.file_name().unwrap().display());
    let kept = ["again.mcap", "body.vtu", &problem].map(|file| (place.read(file), file));
    for command in [
        "run again.toml --lockstep --steps 2".to_owned(),
        "run meshed.toml --lockstep --steps 2 --final body.vtu".to_owned(),
        "equilibrium meshed.toml --final body.vtu".to_owned(),
        format!("solve {problem} --out {problem}"),
    ] {
        let run = place.run(&command);
        assert!(run.code == Some(2) && run.err.contains("would overwrite an input"), "{command}: {run:?}");
    }
    for (bytes, file) in kept {
        assert!(place.read(file) == bytes, "{file}");
    }
}

#[test]
fn a_trace_that_cannot_be_written_is_told_at_once_and_the_simulation_goes_on() {
    let place = Place::new();
    let run = place.run("run scene.toml --lockstep --steps 3 --trace nowhere/a.mcap --csv a.csv --json");
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.err.contains("warning: no trace and no picture: nowhere/a.mcap cannot be written"), "{}", run.err);
    let summary: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!((&summary["end"], &summary["steps"]), (&"completed".into(), &3.into()));
    assert!(summary["notes"][0].as_str().unwrap().contains("nowhere/a.mcap"));
    assert_eq!(place.files(), ["a.csv", "scene.toml"]);
}

#[test]
fn a_disk_that_fills_up_during_the_run_is_told_and_the_simulation_goes_on() {
    if !std::path::Path::new("/dev/full").exists() {
        println!("skipped: there is no /dev/full");
        return;
    }
    let place = Place::new();
    let run = place.run("run scene.toml --lockstep --steps 3 --no-trace --csv /dev/full --json");
    assert_eq!(run.code, Some(1), "{run:?}");
    let summary: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!((&summary["end"], &summary["steps"]), (&"completed".into(), &3.into()));
    assert!(summary["notes"].to_string().contains("/dev/full: the table of steps is incomplete"), "{summary}");
}

#[test]
fn a_file_that_is_no_trace_is_told() {
    let place = Place::new();
    let run = place.run("replay scene.toml");
    assert!(run.code == Some(2) && run.err.contains("scene.toml"), "{run:?}");
    let run = place.run("replay nowhere.mcap");
    assert!(run.code == Some(2) && run.err.contains("nowhere.mcap"), "{run:?}");
}

#[test]
fn a_mesh_that_cannot_be_made_is_told_and_nothing_is_written() {
    let place = Place::new();
    place.write("gem.obj", "v 20 0 0\nv -20 0 0\nv 0 20 0\nv 0 -20 0\nv 0 0 20\nf 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\n");
    place.write("image.inr", "no image");
    for (arguments, word) in [
        ("nowhere.stl --cell 4mm --out a.vtu", "nowhere.stl"),
        ("gem.obj --cell 4mm --out a.vtu", "closed"),
        ("gem.obj --cell 4mm --out a.msh", "only VTU"),
        ("gem.obj --cell 4mm --out nowhere/a.vtu", "cannot be written"),
        ("gem.obj --cell 0mm --out a.vtu", "positive"),
        ("gem.obj --cell 4mm --scale -1 --out a.vtu", "positive"),
        ("image.inr --cell 4mm --out a.vtu", "image.inr"),
        ("image.inr --cell 4mm --scale 0.001 --out a.vtu", "own spacing"),
        ("image.inr --cell 4mm --labels liver --out a.vtu", "NAME=LABEL"),
        ("image.inr --cell 4mm --labels liver=0 --out a.vtu", "background"),
        ("image.inr --cell 4mm --labels liver=1,tumour=1 --out a.vtu", "one name"),
        ("gem.obj --cell 4mm --labels liver=1 --out a.vtu", "has no labels"),
    ] {
        let run = place.run(&format!("mesh make {arguments}"));
        assert!(run.code == Some(2) && run.err.contains(word), "{arguments}: {run:?}");
    }
    assert_eq!(place.files(), ["gem.obj", "image.inr", "scene.toml"]);
}
