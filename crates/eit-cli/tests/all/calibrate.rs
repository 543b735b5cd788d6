//! `eit calibrate`: real tanks of water (printed numbers: `docs/validation/recordings.md`), and a simulated frame.

use crate::common::*;

/// Residuals with one factor for all contacts, with one contact each, and with driven electrodes. Found 2.37, 1.69 and
/// 1.18 % (the scene's guess: 2.38 and 2.44 %); and 14.13, 14.02 and 6.90 % (14.14 and 7.45 %; the last run uses more and
/// larger voltages), of which the rest is model error, which no contact impedance removes.
#[test]
fn water_in_real_tanks() {
    for (name, option, most) in [
        ("uef2017_kit4", "--one-contact", 0.0245),
        ("uef2017_kit4", "", 0.018),
        ("uef2017_kit4", "--use-driven-electrodes", 0.0125),
        ("ktc2023_training", "--one-contact", 0.145),
        ("ktc2023_training", "", 0.142),
        ("ktc2023_training", "--use-driven-electrodes", 0.072),
    ] {
        let Some(_) = fixtures::shared_data(name) else { continue };
        let scene = scene(&format!("{name}.toml"));
        let run = answer(format!("calibrate {scene} {option}"));
        let contacts = numbers(&run, "contact_impedance_ohm_m");
        let std = numbers(&run, "std_of_logarithms");
        let undetermined = run["undetermined_electrodes"].as_array().unwrap().len();
        let [before, after] = ["residual_before", "residual_after"].map(|key| number(&run, key));
        println!(
            "{name} {option}: {} measurements, {} in {} steps, residual {:.2} % -> {:.2} %, conductivity \
             {:.4e} S to {:.2} %, contacts {contacts:.2?} (std of ln z {:.2?}), undetermined {undetermined}",
            run["measurements_used"],
            run["status"],
            run["iterations"],
            100.0 * before,
            100.0 * after,
            number(&run, "conductivity_s"),
            100.0 * std[0],
            &std[1..],
        );
        assert!(run["status"] != "stalled" && after < before && after < most, "{run}");
        assert!(name != "uef2017_kit4" || run["status"] == "converged", "{run}");
        // measurements on driven electrodes determine every contact of a good model
        let is_determined = name == "uef2017_kit4" && option == "--use-driven-electrodes";
        assert!(!is_determined || undetermined == 0, "{run}");
    }
}

/// Through files: the model's own voltages give back the scene's numbers; the output can be pasted into a scene.
#[test]
fn a_simulated_frame_gives_the_scene_back() {
    let folder = Folder::new();
    let truth = succeed("plan paper-disc --print-scene");
    let kept = truth.replace("driven_electrodes = \"drop\"", "driven_electrodes = \"keep\"");
    let path = folder.write("scene.toml", &kept);
    let frame = folder.path("v.csv");
    succeed(format!("forward {path} --out {frame}"));
    let exact = answer(format!("calibrate {path} --frames {frame}"));
    assert!(number(&exact, "residual_before") < 1e-12);
    // a wrong start
    let line = |key: &str| kept.lines().find(|l| l.trim_start().starts_with(key)).unwrap();
    let wrong = kept
        .replace(line("conductivity_s"), "conductivity_s = 7e-5")
        .replace(line("contact_impedance_ohm_m"), "contact_impedance_ohm_m = 300.0");
    let path = folder.write("scene.toml", &wrong);
    let arguments = format!("--frames {frame} --use-driven-electrodes");
    let found = answer(format!("calibrate {path} {arguments}"));
    let same = |a: f64, b: f64| (a / b).ln().abs() < 1e-3;
    assert!(same(number(&found, "conductivity_s"), number(&exact, "conductivity_s")));
    let [contacts, wanted] = [&found, &exact].map(|run| numbers(run, "contact_impedance_ohm_m"));
    assert!(contacts.iter().zip(&wanted).all(|(a, b)| same(*a, *b)), "{contacts:?}");
    assert!(number(&found, "residual_after") < 1e-6);
    let said = succeed(format!("calibrate {path} {arguments}"));
    says(&said, "[electrodes] contact_impedance_ohm_m = [");
}

/// All voltages of adjacent pairs have one sign: those of another conductivity as magnitudes give it back.
#[test]
fn magnitudes_calibrate_like_voltages() {
    let (folder, scene) = Folder::with_scene("");
    let voltages = folder.path("v.csv");
    succeed(format!("forward {scene} --out {voltages}"));
    let sizes = folder.write_array("sizes.npy", &recorded(&voltages, false).mapv(f64::abs));
    let guess = folder.altered("conductivity_s = 1e-5", "conductivity_s = 2e-5");
    let said = succeed(format!("calibrate {guess} --frames {sizes}"));
    says(&said, "the values are magnitudes…conductivity 1.0000e-5 S");
}

/// The option is advised only where it adds measurements.
#[test]
fn driven_electrodes_are_advised_where_they_help() {
    let (folder, [frame]) = Folder::with_paths(["v.csv"]);
    let option = "--use-driven-electrodes";
    for (driven, more, is_advised) in
        [("drop", "", false), ("keep", "", true), ("keep", option, false)]
    {
        let keys = format!("drive = \"adjacent\"\ndriven_electrodes = \"{driven}\"");
        // so much noise that the data determine nothing
        let content = altered("drive = \"adjacent\"", &keys) + "\n[noise]\nadditive_v = 1e3\n";
        let scene = folder.write("scene.toml", &content);
        succeed(format!("forward {scene} --out {frame}"));
        let said = succeed(format!("calibrate {scene} --frames {frame} {more}"));
        says(&said, "contact 1: … ohm m, to a factor of…hardly determine");
        assert_eq!(said.contains(option), is_advised, "{said}");
    }
}
