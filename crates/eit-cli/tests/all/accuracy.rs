//! Scenes that state the required accuracy of their voltages: choice of mesh and of arithmetic.

use crate::common::{Folder, SMALL, answer, read_array, refuse, succeed};
use eit_fem::{ForwardModel, PairProtocol};
use ndarray::Array1;
use serde_json::Value;

/// [`SMALL`] with other lines under `[mesh]`.
fn meshed(lines: &str) -> String {
    SMALL.replace("edge_m = 0.012", lines)
}

/// The estimate is below the requirement, and so is the true error (against the series; the allowance of a
/// half is that of eit-fem's `mesh_choice`); more accuracy needs more unknowns.
#[test]
fn the_mesh_is_chosen_for_the_required_accuracy() {
    let folder = Folder::new();
    let mut unknowns = 0;
    for required in [1e-2, 1e-3, 1e-4] {
        let scene =
            folder.write("scene.toml", &meshed(&format!("required_accuracy = {required:e}")));
        let plan = answer(format!("plan {scene}"));
        let choice = &plan["voltage_error"]["choice"];
        assert_eq!(choice["required"].as_f64().unwrap(), required);
        assert!(choice["estimated_error"].as_f64().unwrap() <= required, "{choice}");
        let error = plan["expected_voltage_error"].as_f64().unwrap();
        assert!(error < 1.5 * required, "{error:e} for {required:e}");
        let out = folder.path("v.npy");
        let forward = answer(format!("forward {scene} --out {out}"));
        let found = forward["solve"]["unknowns"].as_u64().unwrap();
        assert!(found > unknowns, "{found} for {required:e}, {unknowns} before");
        unknowns = found;
    }
    // the mesh command shows the same mesh
    let scene = folder.path("scene.toml");
    let mesh = answer(format!("mesh {scene} --out {}", folder.path("m.msh")));
    assert_eq!(mesh["elements"], "quadratic");
    let plan = succeed(format!("plan {scene}"));
    let (nodes, triangles) = (&mesh["nodes"], &mesh["triangles"]);
    assert!(plan.contains(&format!("{nodes} nodes, {triangles} triangles")), "{plan}");
    assert!(plan.contains("mesh chosen for the required accuracy: quadratic elements"), "{plan}");
}

/// Noise in volts; both numbers are printed, with and without a choice.
#[test]
fn the_mesh_is_chosen_below_the_noise() {
    let folder = Folder::new();
    let noise =
        |volts: f64, lines: &str| format!("{}\n[noise]\nadditive_v = {volts:e}\n", meshed(lines));
    // the largest voltage of this skin is about 4 V
    let scene = folder.write("scene.toml", &noise(1e-3, "required_accuracy = \"noise\""));
    let plan = answer(format!("plan {scene}"));
    let error = &plan["voltage_error"];
    let (of_mesh, of_noise) =
        (error["of_mesh"].as_f64().unwrap(), error["noise"].as_f64().unwrap());
    assert!(of_mesh < 1.5 * of_noise, "{error}");
    // the largest voltage differs between meshes by less than their error
    let ratio = error["choice"]["required"].as_f64().unwrap() / of_noise;
    assert!((ratio - 1.0).abs() < 1e-2, "{error}");
    let output = succeed(format!("plan {scene}"));
    assert!(
        output.contains("mesh chosen for the noise") && output.contains("noise of the instrument:")
    );
    let scene = folder.write("scene.toml", &noise(1e-6, "edge_m = 0.012"));
    let output = succeed(format!("plan {scene}"));
    assert!(output.contains("times less than the error of the mesh"), "{output}");
    let scene = folder.write("scene.toml", SMALL);
    assert!(succeed(format!("plan {scene}")).contains("noise of the instrument: not stated"));
}

/// For the mesh of a file, only the kind of elements can be chosen.
#[test]
fn elements_are_chosen_on_the_mesh_of_a_file() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", SMALL);
    let mesh = folder.path("skin.msh");
    succeed(format!("mesh {scene} --out {mesh}"));
    let of_file = |lines: &str| {
        let content = meshed(lines)
            .replace("shape = \"disc\"", "shape = \"mesh\"\nfile = \"skin.msh\"")
            .replace("radius_m = 0.1\n", "")
            .replace("count = 8\nwidth_m = 0.02\n", "");
        folder.write("scene.toml", &content)
    };
    let elements = |required: f64| {
        let file = of_file(&format!("required_accuracy = {required:e}"));
        let out = folder.path("m.vtu");
        answer(format!("mesh {file} --out {out}"))["elements"].clone()
    };
    assert_eq!(elements(0.5), "linear");
    assert_eq!(elements(1e-5), "quadratic");
    let scene = of_file("required_accuracy = 1e-5\nelements = \"linear\"");
    let out = folder.path("v.npy");
    let output = refuse(format!("forward {scene} --out {out}"));
    assert!(output.contains("linear elements on this mesh have an error of"), "{output}");
}

/// Stiff contacts: digits are preserved without asking for it. Compares the command's voltages with the
/// library's solve in twice the precision; a mesh file preserves all bits.
#[test]
fn stiff_contacts_cost_no_digits() {
    let folder = Folder::new();
    let impedance = "[1e-3, 1e6, 1e3, 1e-3, 1e6, 1e3, 1e-3, 1e6]";
    let scene =
        folder.write("scene.toml", &SMALL.replace("ohm_m = 1e3", &format!("ohm_m = {impedance}")));
    let (out, mesh) = (folder.path("v.npy"), folder.path("m.msh"));
    let forward = answer(format!("forward {scene} --out {out}"));
    assert_eq!(forward["solve"]["path"], "electrodes-eliminated");
    assert_eq!(forward["warning"], Value::Null);
    let bound = forward["solve"]["error_bound"].as_f64().unwrap();
    assert!(bound < 1e-9, "{forward}");
    succeed(format!("mesh {scene} --out {mesh}"));
    let (mesh, _) = eit_mesh::read_mesh(&mesh, 1.0).unwrap();
    let protocol = PairProtocol { electrodes: 8, current_a: 1e-4, ..Default::default() };
    let protocol = protocol.protocol().unwrap();
    let values = [1e-3, 1e6, 1e3, 1e-3, 1e6, 1e3, 1e-3, 1e6];
    let model = ForwardModel::new(&mesh, &protocol, &values).unwrap();
    let mut workspace = model.workspace().unwrap();
    let sigma = vec![1e-5; model.elements()];
    let exact = model.solve_to(&sigma, 1e-14, &mut workspace).unwrap().measurements();
    let largest = |v: &Array1<f64>| v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(largest(&(read_array::<ndarray::Ix1>(&out) - &exact)) <= bound * largest(&exact));
    // an ordinary skin incurs no extra cost
    let scene = folder.write("scene.toml", SMALL);
    assert_eq!(answer(format!("forward {scene} --out {out}"))["solve"]["path"], "nodal-assembly");
}

/// Contacts are fitted on linear elements, so the mesh is chosen for those.
#[test]
fn calibration_takes_linear_elements() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", &meshed("elements = \"quadratic\"\nnodes = 1000"));
    let frames = folder.path("v.csv");
    succeed(format!("forward {scene} --out {frames}"));
    let scene = folder.write("scene.toml", &meshed("required_accuracy = 3e-3"));
    let output = succeed(format!("calibrate {scene} --frames {frames}"));
    assert!(output.contains("conductivity"), "{output}");
    let out = folder.path("m.msh");
    let mesh = answer(format!("mesh {scene} --out {out}"));
    assert_eq!(mesh["elements"], "quadratic", "without calibration");
}

#[test]
fn keys_that_contradict_each_other_are_refused() {
    let folder = Folder::new();
    let plan = |lines: &str| refuse(format!("plan {}", folder.write("scene.toml", &meshed(lines))));
    for (lines, wanted) in [
        ("required_accuracy = 0.0", "required_accuracy is 0: a fraction of the largest voltage"),
        ("required_accuracy = 1.5", "mesh.required_accuracy is 1.5"),
        ("required_accuracy = nan", "mesh.required_accuracy is NaN"),
        ("required_accuracy = \"loud\"", "a fraction of the largest voltage, or \"noise\""),
        ("required_accuracy = \"noise\"", "noise.additive_v is missing"),
        ("required_accuracy = 1e-3\nnodes = 500", "exclude each other"),
        ("required_accuracy = 1e-3\nedge_m = 0.01", "exclude each other"),
        ("required_accuracy = 1e-9\nnode_limit = 800", "no mesh of at most 800 nodes"),
        ("required_accuracy = 1e-18", "at least 9e-16"),
    ] {
        let output = plan(lines);
        assert!(output.contains(wanted), "{lines}: {output}");
    }
}
