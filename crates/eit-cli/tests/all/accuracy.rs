//! Scenes that state the required accuracy of their voltages: choice of mesh and of arithmetic.

use crate::common::*;
use eit_fem::{ForwardModel, PairProtocol};

/// The scene of [`SMALL`] with other lines under `[mesh]`.
fn meshed(folder: &Folder, lines: &str) -> String {
    folder.altered("edge_m = 0.012", lines)
}

/// Estimate and true error (by the series; half more as in eit-fem's `mesh_choice`); more accuracy needs more unknowns.
#[test]
fn the_mesh_is_chosen_for_the_required_accuracy() {
    let folder = Folder::new();
    let (mut unknowns, [out, mesh]) = (0.0, folder.paths(["v.npy", "m.msh"]));
    let scene = folder.path("scene.toml");
    for required in [1e-2, 1e-3, 1e-4] {
        meshed(&folder, &format!("required_accuracy = {required:e}"));
        let plan = answer(format!("plan {scene}"));
        let choice = &plan["voltage_error"]["choice"];
        assert_eq!(number(choice, "required"), required);
        assert!(number(choice, "estimated_error") <= required, "{choice}");
        let error = number(&plan, "expected_voltage_error");
        assert!(error < 1.5 * required, "{error:e} for {required:e}");
        let found = number(&answer(format!("forward {scene} --out {out}"))["solve"], "unknowns");
        assert!(found > unknowns, "{found} for {required:e}, {unknowns} before");
        unknowns = found;
    }
    // the mesh command shows the same mesh
    let mesh = answer(format!("mesh {scene} --out {mesh}"));
    assert_eq!(mesh["elements"], "quadratic");
    let plan = succeed(format!("plan {scene}"));
    let size = format!("{} nodes, {} triangles", mesh["nodes"], mesh["triangles"]);
    says(&plan, format!("{size}…mesh chosen for the required accuracy: quadratic elements"));
    // contacts are fitted on linear elements, whose mesh is chosen then
    meshed(&folder, "elements = \"quadratic\"\nnodes = 1000");
    let frames = folder.path("v.csv");
    let forward = answer(format!("forward {scene} --out {frames}"));
    let jacobian = answer(format!("jacobian {scene} --out {out}"));
    assert_eq!(forward["elements"], jacobian["shape"][1]);
    meshed(&folder, "required_accuracy = 3e-3");
    says(&succeed(format!("calibrate {scene} --frames {frames}")), "conductivity");
    let mesh = answer(format!("mesh {scene} --out {}", folder.path("m.msh")));
    assert_eq!(mesh["elements"], "quadratic", "without calibration");
}

/// Noise in volts; both numbers are printed, with and without a choice.
#[test]
fn the_mesh_is_chosen_below_the_noise() {
    let folder = Folder::new();
    let scene = |volts: f64, lines: &str| {
        meshed(&folder, &format!("{lines}\n[noise]\nadditive_v = {volts:e}\n"))
    };
    // the largest voltage of this skin is about 4 V
    let chosen = scene(1e-3, "required_accuracy = \"noise\"");
    let plan = answer(format!("plan {chosen}"));
    let error = &plan["voltage_error"];
    assert!(number(error, "of_mesh") < 1.5 * number(error, "noise"), "{error}");
    // the largest voltage differs between meshes by less than their error
    let ratio = number(&error["choice"], "required") / number(error, "noise");
    assert!((ratio - 1.0).abs() < 1e-2, "{error}");
    let said = succeed(format!("plan {chosen}"));
    says(&said, "mesh chosen for the noise…noise of the instrument:");
    let said = succeed(format!("plan {}", scene(1e-6, "edge_m = 0.012")));
    says(&said, "times less than the error of the mesh");
    says(&succeed(format!("plan {}", folder.scene(""))), "noise of the instrument: not stated");
}

/// For the mesh of a file, only the kind of elements can be chosen.
#[test]
fn elements_are_chosen_on_the_mesh_of_a_file() {
    let (folder, [mesh, out, voltages]) = Folder::with_paths(["skin.msh", "m.vtu", "v.npy"]);
    succeed(format!("mesh {} --out {mesh}", folder.scene("")));
    let of_file = |lines: &str| {
        let content = SMALL
            .replace("edge_m = 0.012", lines)
            .replace("\"disc\"\nradius_m = 0.1", "\"mesh\"\nfile = \"skin.msh\"")
            .replace("count = 8\nwidth_m = 0.02\n", "");
        folder.write("scene.toml", &content)
    };
    for (required, elements) in [(0.5, "linear"), (1e-5, "quadratic")] {
        let scene = of_file(&format!("required_accuracy = {required:e}"));
        assert_eq!(answer(format!("mesh {scene} --out {out}"))["elements"], elements);
    }
    let scene = of_file("required_accuracy = 1e-5\nelements = \"linear\"");
    let said = refuse(format!("forward {scene} --out {voltages}"));
    says(&said, "linear elements on this mesh have an error of");
}

/// The command's voltages against the library's solve in twice the precision; a mesh file preserves all bits.
#[test]
fn stiff_contacts_cost_no_digits() {
    let folder = Folder::new();
    let values = [1e-3, 1e6, 1e3, 1e-3, 1e6, 1e3, 1e-3, 1e6];
    let scene = folder.altered("ohm_m = 1e3", &format!("ohm_m = {values:?}"));
    let [out, mesh] = folder.paths(["v.npy", "m.msh"]);
    let forward = answer(format!("forward {scene} --out {out}"));
    assert_eq!(forward["solve"]["path"], "electrodes-eliminated");
    assert_eq!(forward["warning"], Value::Null);
    let bound = number(&forward["solve"], "error_bound");
    assert!(bound < 1e-9, "{forward}");
    succeed(format!("mesh {scene} --out {mesh}"));
    let (mesh, _) = eit_mesh::read_mesh(&mesh, 1.0).unwrap();
    let protocol = PairProtocol { electrodes: 8, current_a: 1e-4, ..Default::default() };
    let model = ForwardModel::new(&mesh, &protocol.protocol().unwrap(), &values).unwrap();
    let mut workspace = model.workspace().unwrap();
    let sigma = vec![1e-5; model.elements()];
    let exact = model.solve_to(&sigma, 1e-14, &mut workspace).unwrap().measurements();
    assert!(largest(&(read_array::<Ix1>(&out) - &exact)) <= bound * largest(&exact));
    // shunts and ideal current sources are scenes, too
    for limit in ["0.0", "inf"] {
        let scene = folder.altered("ohm_m = 1e3", &format!("ohm_m = {limit}"));
        succeed(format!("plan {scene}"));
        succeed(format!("forward {scene} --out {out}"));
    }
    // an ordinary skin incurs no extra cost
    let scene = folder.scene("");
    assert_eq!(answer(format!("forward {scene} --out {out}"))["solve"]["path"], "nodal-assembly");
}

#[test]
fn keys_that_contradict_each_other_are_refused() {
    let cases = [
        ("required_accuracy = 0.0", "required_accuracy is 0: a fraction of the largest voltage"),
        ("required_accuracy = 1.5", "mesh.required_accuracy is 1.5"),
        ("required_accuracy = nan", "mesh.required_accuracy is NaN"),
        ("required_accuracy = \"loud\"", "a fraction of the largest voltage, or \"noise\""),
        ("required_accuracy = \"noise\"", "noise.additive_v is missing"),
        ("required_accuracy = 1e-3\nnodes = 500", "exclude each other"),
        ("required_accuracy = 1e-3\nedge_m = 0.01", "exclude each other"),
        ("required_accuracy = 1e-9\nnode_limit = 800", "no mesh of at most 800 nodes"),
        ("required_accuracy = 1e-18", "at least 9e-16"),
    ];
    refuse_plans(cases.map(|(lines, wanted)| (altered("edge_m = 0.012", lines), wanted)));
}
