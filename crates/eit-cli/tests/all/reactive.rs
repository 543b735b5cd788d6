//! Reactive skins: complex voltages and Jacobian against closed forms and the real model.

use crate::common::*;
use eit_fem::Complex64;

/// Admittance of the skin of [`SMALL`] with a capacitance of equal admittance over that without.
const TURN: Complex64 = Complex64::new(1.0, 1.0);

/// [`SMALL`] with more lines in its first three tables.
fn with(skin: &str, electrodes: &str, protocol: &str) -> String {
    SMALL
        .replace("conductivity_s = 1e-5", &format!("conductivity_s = 1e-5\n{skin}"))
        .replace("count = 8", &format!("count = 8\n{electrodes}"))
        .replace("current_a = 1e-4", &format!("current_a = 1e-4\n{protocol}"))
}

/// [`SMALL`] with a sheet capacitance at a frequency at which `2 pi f c = sigma`, 45 degrees.
fn capacitive(electrodes: &str) -> String {
    let frequency_hz = 1e-5 / (std::f64::consts::TAU * 1e-10);
    with("sheet_capacitance_f = 1e-10", electrodes, &format!("frequency_hz = {frequency_hz:e}"))
}

/// Contacts with the phase of [`capacitive`]: 1e3 ohm metre in parallel with `1 / (2 pi f c) = 1e3`.
const CONTACTS_OF_45_DEGREES: &str = "contact_capacitance_f_per_m = 1e-8";

/// Result of a command that takes a scene and writes a file.
fn made(folder: &Folder, command: &str, content: &str, out: &str) -> String {
    let (scene, out) = (folder.write("scene.toml", content), folder.path(out));
    succeed(format!("{command} {scene} --out {out}"));
    out
}

fn voltages(path: &str) -> Array1<Complex64> {
    ndarray_npy::read_npy(path).unwrap()
}

/// Largest difference over the largest value.
fn differ<'a>(
    found: impl IntoIterator<Item = &'a Complex64>,
    wanted: impl IntoIterator<Item = &'a Complex64>,
) -> f64 {
    let pairs = found.into_iter().zip(wanted).map(|(f, w)| [(f - w).norm(), w.norm()]);
    let [off, size] = pairs.fold([0.0_f64; 2], |[a, b], [c, d]| [a.max(c), b.max(d)]);
    off / size
}

/// `V(t gamma, z / t) = V(gamma, z) / t` and `dV/dgamma` over `t` squared, for every complex `t`: with contacts of the
/// skin's own phase every voltage is the real one over `1 + i`.
#[test]
fn of_one_phase_voltages_and_jacobian_are_the_real_ones_turned() {
    let folder = Folder::new();
    let file = |command: &str, content: &str, out: &str| made(&folder, command, content, out);
    let real = read_array::<Ix1>(file("forward", SMALL, "v.npy"));
    let real_jacobian = read_array::<Ix2>(file("jacobian", SMALL, "j.npy"));
    let content = capacitive(CONTACTS_OF_45_DEGREES);
    let wanted = real.mapv(|v| v / TURN);
    let error = differ(&voltages(&file("forward", &content, "v.npy")), &wanted);
    let jacobian = file("jacobian", &content, "j.npy");
    let jacobian: Array2<Complex64> = ndarray_npy::read_npy(jacobian).unwrap();
    assert_eq!(jacobian.dim(), (40, real_jacobian.ncols()));
    let slope = differ(&jacobian, &real_jacobian.mapv(|j| j / (TURN * TURN)));
    println!("voltages {error:.1e}, Jacobian {slope:.1e}");
    // condition number about 1e4; the frequency of the scene is rounded to the last digit
    assert!(error < 1e-12 && slope < 1e-12, "{error:e} {slope:e}");
    // contacts without capacitance have another phase, and then so do the voltages
    let mixed = voltages(&file("forward", &capacitive(""), "v.npy"));
    assert!(differ(&mixed, &wanted) > 1e-4);
}

/// On a strip the current is uniform: `V = I (length / (gamma width) + (z_1 + z_2) / width)`, with
/// independent phases of sheet and contacts.
#[test]
fn a_strip_has_its_closed_form() {
    let folder = Folder::new();
    let (length, width, current) = (0.3, 0.1, 1e-4);
    let (sigma, c, frequency_hz) = (1e-5, 3e-10, 8e3);
    let (r, capacitances) = (4e3, [2e-9, 0.0]);
    folder.write("q.csv", "0,1,0,1\n");
    let content = format!(
        "[skin]\nshape = \"rectangle\"\nwidth_m = {length}\nheight_m = {width}\nconductivity_s = \
         {sigma:e}\nsheet_capacitance_f = {c:e}\n[electrodes]\npositions_m = [[-0.15, 0.0], [0.15, \
         0.0]]\nwidth_m = {width}\ncontact_impedance_ohm_m = {r:e}\ncontact_capacitance_f_per_m = \
         {capacitances:?}\n[protocol]\nquadruples_file = \"q.csv\"\ndriven_electrodes = \
         \"keep\"\ncurrent_a = {current:e}\nfrequency_hz = {frequency_hz:e}\n[mesh]\nedge_m = 0.01\n"
    );
    let found = voltages(&made(&folder, "forward", &content, "v.npy"));
    let omega = std::f64::consts::TAU * frequency_hz;
    let gamma = Complex64::new(sigma, omega * c);
    let [one, other] = capacitances.map(|c| Complex64::new(1.0 / r, omega * c).inv());
    let wanted = (length / (gamma * width) + (one + other) / width) * current;
    let error = (found[0] - wanted).norm() / wanted.norm();
    println!("{error:.1e}");
    // linear elements represent a uniform field exactly; condition number about 1e4
    assert!(found.len() == 1 && error < 1e-12, "{found} {wanted}");
}

/// CSV alternates real and imaginary parts; conductivities get the scene's capacitance, admittivities stay.
#[test]
fn files_hold_the_same_numbers() {
    let folder = Folder::new();
    let content = capacitive("");
    let wanted = voltages(&made(&folder, "forward", &content, "v.npy"));
    let row = read_text(made(&folder, "forward", &content, "v.csv"));
    let numbers: Vec<f64> = row.trim().split(',').map(|n| n.parse().unwrap()).collect();
    let parts: Vec<f64> = wanted.iter().flat_map(|v| [v.re, v.im]).collect();
    assert_eq!(numbers, parts);

    let scene = folder.write("scene.toml", &content);
    let [out, file] = folder.paths(["out.npy", "sheet.npy"]);
    let json = answer(format!("forward {scene} --out {out}"));
    assert_eq!(json["complex"], true);
    // conductors and capacitors: no more than three (`eit-fem`, test `admittivity`)
    let growth = number(&json["solve"], "growth");
    assert!((1.0..3.0).contains(&growth), "{growth}");
    let elements = number(&json, "elements") as usize;
    let line = |scene: &str| format!("forward {scene} --conductivity {file} --out {out}");
    folder.write_array("sheet.npy", &Array1::from_elem(elements, 1e-5));
    succeed(line(&scene));
    assert_eq!(voltages(&out), wanted);
    let sheet = |gamma: Complex64| {
        ndarray_npy::write_npy(&file, &Array1::from_elem(elements, gamma)).unwrap();
    };
    sheet(Complex64::new(-1.0, 0.0));
    refuse_each([(line(&scene), "the admittivity of element 0 is -1+0i S")]);
    sheet(1e-5 * TURN);
    succeed(line(&scene));
    // the frequency of the scene is rounded to the last digit; condition number about 1e4
    assert!(differ(&voltages(&out), &wanted) < 1e-12);
    // a skin without capacitance rejects them
    refuse_each([(line(&folder.scene("")), "the scene stores no charge")]);
}

/// Nothing flows through a capacitor at zero frequency, nor through zero capacitance.
#[test]
fn without_capacitance_or_frequency_results_are_the_real_ones_to_the_bit() {
    let folder = Folder::new();
    let bytes = |command, content, out| read(made(&folder, command, content, out));
    let still = [
        with("sheet_capacitance_f = 1e-10", "", "frequency_hz = 0.0"),
        with("sheet_capacitance_f = 0.0", "", "frequency_hz = 1e6"),
        with("", "contact_capacitance_f_per_m = [0, 0, 0, 0, 0, 0, 0, 0]", "frequency_hz = 1e6"),
    ];
    for (command, out) in [("forward", "v.npy"), ("forward", "v.csv"), ("jacobian", "j.npy")] {
        let real = bytes(command, SMALL, out);
        for content in &still {
            assert!(real == bytes(command, content, out), "{command} {out}: {content}");
        }
    }
    let said = succeed(format!("plan {}", folder.write("scene.toml", &still[0])));
    says(&said, "frequency are zero: no current flows through them");
}

#[test]
fn plan_says_whether_arithmetic_is_complex_and_why() {
    let folder = Folder::new();
    let plan = |content: &str| succeed(format!("plan {}", folder.write("scene.toml", content)));
    let stages = "forward, complex…Jacobian, complex…images…pivoting";
    let words = format!("complex arithmetic: capacitances carry current at 1591…{stages}");
    says(&plan(&capacitive("")), words);
    says(&plan(SMALL), "complex arithmetic     the scene has no reactive part");
    let scene = folder.write("scene.toml", &capacitive(CONTACTS_OF_45_DEGREES));
    let json = answer(format!("plan {scene}"));
    assert_eq!(json["complex"], true);
    // a single phase, up to rounding: elimination in real numbers, rotated
    assert!(number(&json, "phase_span_deg") < 1e-9, "{json}");
    assert!((number(&json, "growth") - 1.0).abs() < 1e-9, "{json}");
    let stages = texts(&json["stages"], "stage");
    assert_eq!(stages, ["mesh", "forward, complex", "Jacobian, complex"]);
    assert!(!texts(&json["left_out"], "what").contains(&"complex arithmetic"), "{json}");
}

/// Keys are checked, and commands that know conductivity only refuse.
#[test]
fn keys_are_checked() {
    let folder = Folder::new();
    let scene = folder.write("scene.toml", capacitive(""));
    let [out, mesh] = folder.paths(["out", "skin.msh"]);
    let frames = folder.write_array("frames.npy", &Array2::ones((2, 40)));
    let words = "the scene stores charge at 1591…`eit forward`, `eit jacobian`, `eit plan`";
    refuse_each([
        (format!("simulate {scene} --out {out}"), words),
        (format!("reconstruct {scene} --frames {frames} --reference 0 --out {out}"), words),
        (format!("calibrate {scene} --frames {frames}"), words),
        (format!("plan {scene} --method st-tv"), words),
    ]);
    succeed(format!("mesh {scene} --out {mesh}"));
    let content = capacitive("");
    let (sheet, contacts) = ("sheet_capacitance_f", "count = 8\ncontact_capacitance_f_per_m = ");
    let [negative, infinite] = ["-1.0 #", "inf #"].map(|value| format!("{sheet} = {value}"));
    let [two, nan] = ["[1e-9, 1e-9]", "nan"].map(|value| format!("{contacts}{value}"));
    let cases = [
        ("skin.sheet_capacitance_f is -1", sheet, &negative[..]),
        ("skin.sheet_capacitance_f is inf", sheet, &infinite),
        ("protocol.frequency_hz is NaN", "frequency_hz = ", "frequency_hz = nan #"),
        ("sheet_capacitance_f has no effect without protocol.frequency_hz", "frequency_hz", "#"),
        ("has no effect without skin.sheet_capacitance_f or electrodes.contact_", sheet, "#"),
        ("contact_capacitance_f_per_m has 2 values for 8 electrodes", "count = 8", &two),
        ("contact_capacitance_f_per_m is NaN", "count = 8", &nan),
        ("contact_impedance_ohm_m is 0 at electrode 1", "_ohm_m = 1e3", "_ohm_m = 0.0"),
        ("contact_impedance_ohm_m is inf at electrode 1", "_ohm_m = 1e3", "_ohm_m = inf"),
        ("mesh.elements is \"quadratic\"", "[mesh]", "[mesh]\nelements = \"quadratic\""),
        ("did you mean", "sheet_capacitance_f", "permitivity_f"),
    ];
    refuse_plans(cases.map(|(message, from, to)| {
        assert!(content.contains(from), "{from}");
        (content.replace(from, to), message)
    }));
    // a capacitance without a resistance in parallel is a contact
    let content = capacitive(CONTACTS_OF_45_DEGREES).replace("_ohm_m = 1e3", "_ohm_m = inf");
    succeed(format!("plan {}", folder.write("scene.toml", &content)));
}
