//! Frames to touches: one matrix product, a noise floor, a tracker.

use eit_fem::{ForwardModel, PairProtocol, Protocol};
use eit_hw::driver::Eits1;
use eit_hw::{Frame, HwError};
use eit_inverse::metrics::Cells;
use eit_inverse::touch::{NoiseFloor, Touch, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{
    AdaptiveReference, FrameStatus, HyperparameterChoice, Laplace, LaplaceSettings, NoiseTarget,
    OneStepGaussNewton, OneStepSettings, Reconstructor, ReferenceSettings, Workspace,
};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::error::Error;
use std::time::{Duration, Instant};

/// The skin: a disc of 0.1 m, 16 electrodes, 1e-5 siemens per square.
pub const SHEET_S: f64 = 1e-5;
/// Frames a second that the instrument is asked for.
pub const FRAME_HZ: f64 = 50.0;
/// Frames before anybody touches: reference and noise.
pub const QUIET: usize = 30;
/// Touches of a frame older than this say nothing of the present.
const STALE: Duration = Duration::from_millis(100);

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
    /// Measurements of a frame that are flagged.
    bad: Vec<usize>,
    touched: bool,
    felt: Option<Instant>,
}

impl TouchSense {
    /// Meshes the skin and prepares the reconstruction.
    pub fn new() -> Result<Self, Box<dyn Error>> {
        let (mesh, model, protocol) = model(0.006)?;
        let jacobian = model.jacobian(&vec![SHEET_S; model.elements()])?;
        let prior = Laplace::new(mesh.surface(), &LaplaceSettings::default())?;
        let mut inverse = OneStepGaussNewton::new(&jacobian, &prior, OneStepSettings::default())?;
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
            bad: Vec::new(),
            touched: false,
            felt: None,
        })
    }

    /// The instrument, asked for these measurements.
    pub fn driver(&self) -> Result<Eits1, HwError> {
        let current_a = 1e-4;
        Eits1::new(&self.quadruples, FRAME_HZ as f32, current_a, 0.0)
    }

    /// Contacts and gains may have changed: reference and noise are learnt anew.
    pub fn forget(&mut self) {
        self.quiet.clear();
        (self.live, self.touched) = (None, false);
    }

    /// Touches of the last frame; `None` while the first frames are learnt, and where it is too old.
    pub fn touches(&self) -> Option<&[Touch]> {
        let is_fresh = self.felt.is_some_and(|felt| felt.elapsed() < STALE);
        self.live.as_ref().filter(|_| is_fresh).map(|(_, stream)| stream.touches())
    }

    /// Takes a frame, and gives its memory back.
    pub fn feel(&mut self, frame: Frame) -> Result<Frame, Box<dyn Error>> {
        let flagged = frame.quality.iter().enumerate().filter(|(_, quality)| !quality.is_good());
        self.bad.clear();
        self.bad.extend(flagged.map(|(measurement, _)| measurement));
        let Some((reference, stream)) = &mut self.live else {
            self.learn(&frame)?;
            return Ok(frame);
        };
        let time_s = frame.sequence as f64 / FRAME_HZ;
        if self.bad.is_empty() {
            reference.push(&frame.values, time_s, self.touched)?;
        }
        let status = self.to_pixels.reconstruct_masked_into(
            &frame.values,
            reference.reference(),
            &self.bad,
            &mut self.memory,
            &mut self.image,
        )?;
        let touches = match status {
            FrameStatus::Computed => stream.push(&self.image, time_s)?,
            FrameStatus::Unchanged => stream.push_unchanged(time_s)?,
        };
        self.touched = touches.iter().any(|touch| touch.state != TouchState::End);
        self.felt = Some(Instant::now());
        Ok(frame)
    }

    /// Keeps a quiet frame; with enough of them, reference, noise and tracker begin.
    fn learn(&mut self, frame: &Frame) -> Result<(), Box<dyn Error>> {
        if !self.bad.is_empty() {
            return Ok(());
        }
        self.quiet.extend(&frame.values);
        if self.quiet.len() < QUIET * frame.values.len() {
            return Ok(());
        }
        let frames = Array2::from_shape_vec((QUIET, frame.values.len()), self.quiet.clone())?;
        let settings = ReferenceSettings::default();
        let reference = AdaptiveReference::of_quiet_frames(frames.view(), settings)?;
        let floor = NoiseFloor::of_reconstruction(&self.to_pixels, reference.noise_std_v())?;
        let settings = TouchStreamSettings { frame_rate_hz: FRAME_HZ, ..Default::default() };
        let stream = TouchStream::new(self.cells.clone(), floor, settings)?;
        self.live = Some((reference, stream));
        Ok(())
    }
}
