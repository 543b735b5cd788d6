//! Frames to touches: one matrix product, a noise floor, a tracker.

use eit_fem::{ForwardModel, PairProtocol, Protocol};
use eit_inverse::metrics::Cells;
use eit_inverse::touch::{NoiseFloor, Touch, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{
    AdaptiveReference, Difference, DifferenceSettings, HyperparameterChoice, Laplace,
    LaplaceSettings, NoiseTarget, Reconstructor, ReferenceSettings, Workspace,
};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::error::Error;

/// The skin: a disc of 0.1 m, 16 electrodes, 1e-5 siemens per square.
pub const SHEET_S: f64 = 1e-5;

/// Model of the skin with edges of about this length.
pub fn model(edge_m: f64) -> Result<(Mesh, ForwardModel, Protocol), Box<dyn Error>> {
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(edge_m))?;
    let protocol = PairProtocol { current_a: 1e-4, ..Default::default() }.protocol()?;
    let model = ForwardModel::new(&mesh, &protocol, &[1e3; 16])?;
    Ok((mesh, model, protocol))
}

/// What turns frames into touches; learns reference and noise from the first frames.
pub struct TouchSense {
    quadruples: Vec<[u32; 4]>,
    to_pixels: Reconstructor,
    cells: Cells<3>,
    memory: Workspace,
    image: Vec<f64>,
    /// Frames until there are enough.
    quiet: Vec<f64>,
    live: Option<(AdaptiveReference, TouchStream)>,
    touched: bool,
}

impl TouchSense {
    /// Meshes the skin and prepares the reconstruction.
    pub fn new() -> Result<Self, Box<dyn Error>> {
        let (mesh, model, protocol) = model(0.006)?;
        let jacobian = model.jacobian(&vec![SHEET_S; model.elements()])?;
        let prior = Laplace::new(mesh.surface(), &LaplaceSettings::default())?;
        let mut inverse = Difference::new(&jacobian, &prior, DifferenceSettings::default())?;
        let target = NoiseTarget::central(mesh.surface(), &jacobian)?;
        let rule = HyperparameterChoice::NoiseFigure { figure: 1.0, target: &target };
        inverse.choose_hyperparameter(&rule)?;
        let raster = Raster::new(mesh.surface(), 48)?;
        let to_pixels = inverse.on_raster(raster.pixel_from_element())?;
        Ok(Self {
            quadruples: protocol.quadruples().ok_or("a protocol of pairs")?.to_vec(),
            cells: Cells::of_raster_on(&raster, mesh.surface())?,
            memory: to_pixels.workspace(),
            image: vec![0.0; to_pixels.image_len()],
            to_pixels,
            quiet: Vec::new(),
            live: None,
            touched: false,
        })
    }

    /// Measurements of a frame, in its order.
    pub fn quadruples(&self) -> &[[u32; 4]] {
        &self.quadruples
    }

    /// Drive current, ampere.
    pub fn current_a(&self) -> f32 {
        1e-4
    }

    /// Touches of a frame; none while the first `quiet` frames are learnt.
    pub fn feel(
        &mut self,
        frame: &[f64],
        (number, rate_hz): (usize, f64),
        quiet: usize,
    ) -> Result<&[Touch], Box<dyn Error>> {
        if self.live.is_none() {
            self.learn(frame, rate_hz, quiet)?;
            return Ok(&[]);
        }
        let Some((reference, stream)) = &mut self.live else { return Ok(&[]) };
        let time_s = number as f64 / rate_hz;
        reference.push(frame, time_s, self.touched)?;
        let (memory, image) = (&mut self.memory, &mut self.image);
        self.to_pixels.reconstruct_into(frame, reference.reference(), memory, image)?;
        let touches = stream.push(image, time_s)?;
        self.touched = touches.iter().any(|touch| touch.state != TouchState::End);
        Ok(touches)
    }

    /// Keeps a quiet frame; with enough of them, reference, noise and tracker begin.
    fn learn(&mut self, frame: &[f64], rate_hz: f64, quiet: usize) -> Result<(), Box<dyn Error>> {
        self.quiet.extend(frame);
        if self.quiet.len() < quiet * frame.len() {
            return Ok(());
        }
        let frames = Array2::from_shape_vec((quiet, frame.len()), self.quiet.clone())?;
        let settings = ReferenceSettings::default();
        let reference = AdaptiveReference::of_quiet_frames(frames.view(), settings)?;
        let floor = NoiseFloor::of_reconstruction(&self.to_pixels, reference.noise_std_v())?;
        let settings = TouchStreamSettings { frame_rate_hz: rate_hz, ..Default::default() };
        let stream = TouchStream::new(self.cells.clone(), floor, settings)?;
        self.live = Some((reference, stream));
        Ok(())
    }
}
