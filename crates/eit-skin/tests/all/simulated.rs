//! A simulated recording, and its touches and images in one call.

use eit_skin::eit_fem::fabric::{Contact, Touch as ScriptTouch};
use eit_skin::frames::{FramesInput, ReferenceInput};
use eit_skin::live::SkinState;
use eit_skin::ndarray::{Array2, Axis};
use eit_skin::scene::Reference;
use eit_skin::simulate::{SimulateSettings, SimulatedRecording, simulator};
use eit_skin::{ImageSolver, Progress, Scene, Skin};

#[test]
fn simulated_frames_are_reconstructed_with_their_own_reference() {
    let scene = Scene::load("paper-disc").unwrap();
    let mut settings = SimulateSettings {
        script: "one-finger".to_owned(),
        seed: 1,
        frames: Some(30),
        nodes: Some(1500),
        threads: Some(1),
    };
    let progress = &mut Progress::silent();
    let made = SimulatedRecording::run(&scene, &settings, progress).unwrap();
    let skin = made.described(Skin::from_scene(scene.clone()).unwrap());
    assert_eq!(skin.settings.recording.reference, Some(Reference::Text("0..20".to_owned())));
    let values = FramesInput::Values(made.simulation.frames_v.view());
    let frames = skin.frames(values, ReferenceInput::Settings).unwrap();
    // the quiet frames themselves are the same reference
    let quiet = made.simulation.frames_v.slice_axis(Axis(0), (..20).into());
    let given = skin.frames(values, ReferenceInput::Values(quiet)).unwrap();
    assert_eq!((&frames.reference, frames.values.nrows()), (&given.reference, 30));

    let done = skin.reconstruct(frames, Some("gauss-newton"), progress).unwrap();
    assert!(matches!(done.images.solver, ImageSolver::GaussNewton { sequence: None, .. }));
    assert_eq!(done.images.values.shape(), [30, 64, 64]);
    let touches = done.touches.unwrap();
    assert_eq!((touches.count(), touches.state(25)), (1, SkinState::Sound));
    let row = &touches.rows[0];
    assert_eq!(touches.in_recording(row), (row.frame as u64, row.time_s));

    // a skin that is stepped with the fingers of the script makes the same frames
    let mut stepped = simulator(&scene, settings.seed, settings.nodes, false).unwrap();
    for (frame, wanted) in made.simulation.frames_v.rows().into_iter().enumerate() {
        let contact = |touch: ScriptTouch| {
            let ScriptTouch { finger, tip, position_m, force_n, radius_m, .. } = touch;
            Contact { finger, tip, position_m, force_n, radius_m }
        };
        let contacts: Vec<_> = made.script.touches(frame).into_iter().map(contact).collect();
        let values_v = &stepped.step(&contacts, 1.0 / made.script.frame_rate_hz).unwrap().values_v;
        assert_eq!(*values_v, wanted.to_vec());
    }
    simulator(&scene, 3, None, true).unwrap().step(&[], 0.05).unwrap();

    // errors name arguments, not options of a command line
    settings.script = "dance".to_owned();
    let method = eit_skin::method::choose(&skin.settings, Some("best"), None);
    for (error, name, text) in [
        (SimulatedRecording::run(&scene, &settings, progress).unwrap_err(), "script", "dance: no"),
        (skin.read_frames(&[], None).unwrap_err(), "frames", "no frames: give their files, or set"),
        (method.unwrap_err().within("a.toml"), "method", "\"best\": the methods are"),
    ] {
        let (argument, problem) = error.as_argument().unwrap();
        assert!(argument == name && problem.starts_with(text), "{error}");
        assert!(error.to_string().ends_with(&format!("{name}: {problem}")), "{error}");
    }
    assert_eq!(eit_skin::SkinError::input("x").as_argument(), None);
    let error = skin.frames_of_values(&Array2::zeros((3, 5))).unwrap_err().to_string();
    assert!(error.contains("5 values, but the protocol has 208"), "{error}");
}
