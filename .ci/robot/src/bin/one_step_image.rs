//! Reconstructs one image of one frame, on a skin built in code.
use eit_skin::ndarray::{Axis, stack};
use eit_skin::scene::{ElectrodeSettings, Reference, Scene, SkinSettings};
use eit_skin::{Progress, Skin};
use std::error::Error;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn Error>> {
    let electrodes = ElectrodeSettings::equally_spaced(16, 0.015, 1e3);
    let mut scene = Scene::new(SkinSettings::rectangle(0.2, 0.1, 1e-5), electrodes);
    scene.recording.reference = Some(Reference::Frame(0));
    let (skin, progress) = (Skin::from_scene(scene)?, &mut Progress::silent());
    // an untouched frame and one with a finger, on a different mesh than the image's
    let finer = skin.with_nodes(5000, progress)?;
    let finger = |c: &[f64; 3]| 1.0 + 0.5 * (-0.5 * (c[0] - 0.04).hypot(c[1]).powi(2) / 1e-4).exp();
    let touched: Vec<f64> =
        finer.mesh.surface().centroids().iter().map(|c| 1e-5 * finger(c)).collect();
    let (rest, touched) =
        (finer.model.forward(&finer.background_s())?, finer.model.forward(&touched)?);
    let values = stack(Axis(0), &[rest.view(), touched.view()])?;
    let frames = skin.frames_of_values(&values)?;
    let fitted = Arc::new(skin.linearise(progress)?).fit(frames)?;
    let images = fitted.one_step(progress)?.images(&fitted.frames, progress)?;
    let image = images.frame(1)?;
    let most =
        image.indexed_iter().filter(|(_, v)| v.is_finite()).max_by(|a, b| a.1.total_cmp(b.1));
    let (row, column) = most.ok_or("an image of the skin")?.0;
    let [x, y] = fitted.skin.raster(progress)?.centre_m(row, column);
    println!("largest change at {x:.3}, {y:.3} m; the finger at 0.040, 0.000 m");
    assert!((x - 0.04).hypot(y) < 0.015, "off by more than a finger");
    Ok(())
}
