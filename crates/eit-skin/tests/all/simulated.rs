//! A simulated recording, and its touches and images in one call.

use eit_skin::eit_fem::fabric::Contact;
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

    settings.script = "dance".to_owned();
    let error = SimulatedRecording::run(&scene, &settings, progress).unwrap_err();
    assert_eq!(error.as_argument().map(|(name, _)| name), Some("script"));
    let few = Array2::zeros((3, 5));
    let error = skin.frames_of_values(&few).unwrap_err().to_string();
    assert!(error.contains("5 values, but the protocol has 208"), "{error}");
}

/// Stepped with the fingers of a script, the frames are those of the recording.
#[test]
fn a_stepped_skin_makes_the_frames_of_the_recording() {
    let scene = Scene::load("paper-disc").unwrap();
    let settings = SimulateSettings {
        script: "one-finger".to_owned(),
        seed: 3,
        frames: Some(30),
        nodes: Some(900),
        threads: None,
    };
    let made = SimulatedRecording::run(&scene, &settings, &mut Progress::silent()).unwrap();
    let mut skin = simulator(&scene, 3, Some(900), false).unwrap();
    for (frame, wanted) in made.simulation.frames_v.rows().into_iter().enumerate() {
        let touches = made.script.touches(frame).into_iter();
        let contacts: Vec<Contact> = touches
            .map(|touch| Contact {
                finger: touch.finger,
                tip: touch.tip,
                position_m: touch.position_m,
                force_n: touch.force_n,
                radius_m: touch.radius_m,
            })
            .collect();
        let stepped = skin.step(&contacts, 1.0 / made.script.frame_rate_hz).unwrap();
        assert_eq!(stepped.values_v, wanted.to_vec());
    }
    simulator(&scene, 3, None, true).unwrap().step(&[], 0.05).unwrap();
}
