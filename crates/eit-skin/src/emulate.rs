//! Emulates the instrument of a scene: what it measures, and the device that sends it.

mod arrange;
mod hold;

pub use self::hold::Hold;

use self::arrange::arranged;
use crate::error::SkinError;
use crate::limits::rounding_warning;
use crate::progress::Progress;
use crate::scene::{DriverKind, Instrument, ValueKind};
use crate::skin::Skin;
use eit_core::Random;
use eit_fem::{ForwardModel, Protocol};
use eit_hw::codec::eits1::Information;
use eit_hw::emulator::{BoardDevice, Device, Eits1Device, SciospecDevice};
use eit_hw::{Layout, Quadruple, Unit};
use ndarray::Array2;
use std::collections::HashMap;
use std::path::Path;

/// Noise of the untouched skin if the scene states none, relative to the median voltage: 80 dB.
const DEFAULT_NOISE: f64 = 1e-4;
/// Highest frame rate that an emulated EITS-1 instrument accepts.
const MOST_RATE_HZ: f32 = 10_000.0;
/// Name that an emulated EITS-1 instrument reports.
const NAME: &str = "emulated skin";

/// Voltages that the device plays in a loop, [frame, value of the device].
struct Played {
    real: Array2<f64>,
    imaginary: Option<Array2<f64>>,
    noise: f64,
    random: Random,
    /// When each value is measured, from half a frame before the frame's time to half a frame after it.
    shifts: Vec<f64>,
    hold: Option<Hold>,
    /// What the values are.
    kind: ValueKind,
    /// Number of the last frame, and its place in the loop.
    last: (u64, u64),
}

impl Played {
    /// Voltages without noise, all of a frame at once, in their own order.
    fn of(real: Array2<f64>) -> Self {
        Self {
            real,
            imaginary: None,
            noise: 0.0,
            random: Random::new(0),
            shifts: Vec::new(),
            hold: None,
            kind: ValueKind::Voltage,
            last: (0, 0),
        }
    }

    /// Value `index` of frame `number`, between those of the nearest frames of the loop.
    fn at(&mut self, number: u64, index: usize) -> [f64; 2] {
        if self.last.0 != number {
            let frame = self.hold.as_ref().map_or(number, |hold| hold.next(number));
            self.last = (number, frame);
        }
        let rows = self.real.nrows();
        let (row, shift) = ((self.last.1 % rows as u64) as usize, self.shifts[index]);
        let other = if shift < 0.0 { row.saturating_sub(1) } else { (row + 1).min(rows - 1) };
        let between = |parts: &Array2<f64>| {
            let value = parts[[row, index]];
            value + shift.abs() * (parts[[other, index]] - value)
        };
        let noise = if self.noise > 0.0 { self.noise * self.random.normal() } else { 0.0 };
        let real = self.kind.of_voltage(between(&self.real) + noise);
        [real, self.imaginary.as_ref().map_or(0.0, between)]
    }
}

/// When each value is measured, in frames after the frame's time, if the drives of a scan take turns, evenly around it.
fn shifts(quadruples: &[Quadruple], scan_share: f64) -> Vec<f64> {
    let mut drives: Vec<[u32; 2]> = Vec::new();
    let mut number = |&[a, b, ..]: &Quadruple| {
        drives.iter().position(|drive| *drive == [a, b]).unwrap_or_else(|| {
            drives.push([a, b]);
            drives.len() - 1
        })
    };
    let numbers: Vec<usize> = quadruples.iter().map(&mut number).collect();
    let shift = |k: usize| scan_share * ((k as f64 + 0.5) / drives.len() as f64 - 0.5);
    numbers.into_iter().map(shift).collect()
}

/// Frames that an emulated instrument plays in a loop.
#[derive(Debug, Clone, Copy)]
pub enum PlayedFrames<'a> {
    /// The untouched skin as simulated by its own model, with noise.
    Untouched,
    /// A file of frames in the protocol's order.
    File(&'a Path),
    /// Values [frame, measurement], volt, in the protocol's order.
    Values(&'a Array2<f64>),
}

/// What an emulated instrument sends.
#[derive(Debug, Clone, Copy)]
pub struct Content<'a> {
    /// Frames to play in a loop.
    pub frames: PlayedFrames<'a>,
    /// Serial number.
    pub serial: &'a str,
    /// Seed of the noise.
    pub seed: u64,
    /// Time from the first to the last drive of a scan as a share of the time between frames, 0 to 1: values of a drive
    /// lie between those of two frames of a file. 0: all drives at once.
    pub scan_share: f64,
    /// Holds the loop at its first frames.
    pub hold: Option<&'a Hold>,
}

/// Builds the device that the scene's driver talks to.
///
/// # Errors
///
/// A driver that cannot be emulated, frames that cannot be read, and those of the forward solution.
pub fn device(
    skin: &Skin,
    instrument: &Instrument,
    content: &Content<'_>,
    progress: &mut Progress,
) -> Result<Box<dyn Device>, SkinError> {
    let wanted = quadruples(instrument);
    if let DriverKind::Board(board) = &instrument.kind
        && wanted.len() != board.format.measurements()
    {
        let problem = "an emulated board prints potentials of undriven electrodes only: set protocol.driven_electrodes = \"drop\"";
        return Err(SkinError::input(problem).within(&skin.place));
    }
    if !(0.0..=1.0).contains(&content.scan_share) {
        let why = format!("{}: it must be from 0 to 1", content.scan_share);
        return Err(SkinError::argument("scan_share", why));
    }
    let mut played = match content.frames {
        PlayedFrames::File(file) => from_file(skin, instrument, &wanted, file)?,
        PlayedFrames::Values(values) => Played::of(
            arranged(&instrument.quadruples, values, &wanted)
                .map_err(|why| mismatch(skin, instrument, &why))?,
        ),
        PlayedFrames::Untouched => from_model(skin, instrument, &wanted, content.seed, progress)?,
    };
    played.shifts = shifts(&wanted, content.scan_share);
    (played.hold, played.kind) = (content.hold.cloned(), skin.settings.recording.values);
    match &instrument.kind {
        DriverKind::Eits1 => Ok(eits1(instrument, content.serial, played)),
        DriverKind::Sciospec(_) => sciospec(instrument, content.serial, played),
        DriverKind::Board(board) => {
            // inverse of the factor that the driver multiplies by
            let unit = match board.unit {
                Unit::Volt => 1.0,
                Unit::Ohm => instrument.current_a,
                Unit::Arbitrary => skin.settings.recording.factor(),
            };
            Ok(text_board(board, instrument, unit, played))
        }
    }
}

/// Returns an electrode that a drive does not use; potentials are measured against it.
fn free_electrode(drive: [u32; 2]) -> u32 {
    (0..).find(|electrode| !drive.contains(electrode)).unwrap_or_default()
}

/// Measurements whose voltages the device needs: those it sends or, for a Sciospec instrument, the potential
/// of each electrode against one that is not driven.
fn quadruples(instrument: &Instrument) -> Vec<Quadruple> {
    match &instrument.kind {
        DriverKind::Eits1 => instrument.quadruples.clone(),
        DriverKind::Sciospec(settings) => {
            let electrodes = settings.electrodes;
            let of_drive = |&[a, b]: &[u32; 2]| {
                let free = free_electrode([a, b]);
                (0..electrodes).filter(move |&e| e != free).map(move |e| [a, b, e, free])
            };
            settings.drives.iter().flat_map(of_drive).collect()
        }
        DriverKind::Board(board) => match &board.layout {
            Layout::Quadruples(quadruples) => quadruples.clone(),
            // those of undriven electrodes, against the sink
            Layout::Potentials { drives, electrodes, driven: false } => {
                let others = |&[a, b]: &[u32; 2]| {
                    let all = 0..u32::try_from(*electrodes).unwrap_or(u32::MAX);
                    all.filter(move |e| ![a, b].contains(e)).map(move |e| [a, b, e, b])
                };
                drives.iter().flat_map(others).collect()
            }
            _ => instrument.quadruples.clone(),
        },
    }
}

fn from_model(
    skin: &Skin,
    instrument: &Instrument,
    wanted: &[Quadruple],
    seed: u64,
    progress: &mut Progress,
) -> Result<Played, SkinError> {
    let electrodes = skin.mesh.electrodes().len();
    let protocol = Protocol::from_quadruples(electrodes, wanted, instrument.current_a)
        .map_err(|e| mismatch(skin, instrument, &e.to_string()))?;
    let (contacts, order) = (&skin.contact_impedance, skin.model.element_order());
    let model = ForwardModel::with_element_order(&skin.mesh, &protocol, contacts, order)?;
    let background = vec![skin.conductivity_s; model.elements()];
    let voltages = progress.stage("voltages", || {
        let mut workspace = model.workspace()?;
        let mut solution = model.solve(&background, &mut workspace)?;
        rounding_warning(&solution.report())?;
        Ok::<_, SkinError>(solution.measurements())
    })?;
    let median = eit_core::median(voltages.iter().map(|v| v.abs())).unwrap_or_default();
    Ok(Played {
        noise: skin.settings.noise.additive_v.unwrap_or(DEFAULT_NOISE * median),
        random: Random::stream(seed, 0x0a02_bdbf_7bb3_c0a7),
        ..Played::of(voltages.insert_axis(ndarray::Axis(0)))
    })
}

/// Reads frames in the scene's protocol from a file and converts them to voltages of the wanted measurements.
fn from_file(
    skin: &Skin,
    instrument: &Instrument,
    wanted: &[Quadruple],
    file: &Path,
) -> Result<Played, SkinError> {
    let (own, count) = (Some(&instrument.quadruples[..]), instrument.quadruples.len());
    let options = eit_hw::ReadOptions {
        measurements: Some(skin.layout.value_count().unwrap_or(count)),
        ..Default::default()
    };
    let recording = eit_hw::read_recording(file, None, &options)?;
    let recording = recording.arranged_for(&skin.layout, own, count);
    let part = |component| {
        let mut frames = recording.frames_for(own, count, component)?;
        frames.to_volts(instrument.current_a);
        skin.settings.recording.convert(&mut frames);
        // a missing value cannot be sent
        frames.values.mapv_inplace(|value| if value.is_finite() { value } else { 0.0 });
        arranged(&instrument.quadruples, &frames.values, wanted)
            .map_err(|why| mismatch(skin, instrument, &why))
    };
    let real = part(eit_hw::Component::Real)?;
    let imaginary = match recording.imaginary.is_some() {
        true => Some(part(eit_hw::Component::Imaginary)?),
        false => None,
    };
    Ok(Played { imaginary, ..Played::of(real) })
}

fn mismatch(skin: &Skin, instrument: &Instrument, why: &str) -> SkinError {
    SkinError::input(format!(
        "the protocol of {} does not match what the instrument \"{}\" measures: {why}; change \
         [protocol] or instrument.driver",
        skin.place,
        instrument.driver_name()
    ))
}

fn eits1(instrument: &Instrument, serial: &str, mut played: Played) -> Box<dyn Device> {
    let complex = played.imaginary.is_some();
    let information = Information {
        electrodes: u16::try_from(instrument.electrodes).unwrap_or(u16::MAX),
        max_measurements: u16::try_from(instrument.quadruples.len()).unwrap_or(u16::MAX),
        max_frame_rate_hz: MOST_RATE_HZ,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex,
        name: NAME.to_owned(),
        serial: serial.to_owned(),
    };
    let place: HashMap<Quadruple, usize> =
        instrument.quadruples.iter().enumerate().map(|(index, &q)| (q, index)).collect();
    let source = move |number: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        let step = if complex { 2 } else { 1 };
        for (slots, quadruple) in values.chunks_exact_mut(step).zip(quadruples) {
            // a host with another scene may ask for a measurement that this one lacks
            let parts = place.get(quadruple).map_or([0.0; 2], |&index| played.at(number, index));
            slots.copy_from_slice(&parts[..step]);
        }
    };
    Box::new(Eits1Device::new(information, Box::new(source)))
}

fn sciospec(
    instrument: &Instrument,
    serial: &str,
    mut played: Played,
) -> Result<Box<dyn Device>, SkinError> {
    let number = serial.parse().map_err(|_| {
        SkinError::argument("serial", format!("{serial}: a Sciospec serial number is 0 to 65535"))
    })?;
    let DriverKind::Sciospec(settings) = &instrument.kind else {
        return Err(SkinError::Failure("no settings of a Sciospec instrument".to_owned()));
    };
    let (drives, electrodes) = (settings.drives.clone(), instrument.electrodes);
    let source = move |number: u64, [a, b]: [u32; 2], potentials: &mut [[f64; 2]]| {
        let found = drives.iter().position(|drive| *drive == [a, b] || *drive == [b, a]);
        let Some(drive) = found else { return potentials.fill([0.0; 2]) };
        let sign = if drives[drive] == [a, b] { 1.0 } else { -1.0 };
        let free = free_electrode([a, b]) as usize;
        let mut index = drive * (electrodes - 1);
        for (electrode, slot) in potentials.iter_mut().enumerate() {
            *slot = [0.0; 2];
            if electrode != free {
                *slot = played.at(number, index).map(|part| sign * part);
                index += 1;
            }
        }
        // relative to the mean, as an instrument measures against its ground
        let count = potentials.len() as f64;
        for part in 0..2 {
            let mean = potentials.iter().map(|parts| parts[part]).sum::<f64>() / count;
            potentials.iter_mut().for_each(|parts| parts[part] -= mean);
        }
    };
    let count = u32::try_from(electrodes).unwrap_or(u32::MAX);
    Ok(Box::new(SciospecDevice::new(count, number, false, Box::new(source))))
}

fn text_board(
    board: &eit_hw::driver::Board,
    instrument: &Instrument,
    unit: f64,
    mut played: Played,
) -> Box<dyn Device> {
    let step = if board.format.complex { 2 } else { 1 };
    let source = move |number: u64, _: &[Quadruple], values: &mut [f64]| {
        for (index, slots) in values.chunks_exact_mut(step).enumerate() {
            let parts = played.at(number, index).map(|part| part / unit);
            slots.copy_from_slice(&parts[..step]);
        }
    };
    let mut board = board.clone();
    // the device has no scene: it sends what it is given
    board.layout = Layout::ProtocolOrder;
    Box::new(BoardDevice::new(board, instrument.frame_rate_hz, Box::new(source)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Values lie between those of the frames around them, each drive's at its own time; ends of the loop stay.
    #[test]
    fn drives_take_turns() {
        let quadruples = [[0, 1, 2, 3], [0, 1, 3, 4], [1, 2, 3, 4], [2, 3, 4, 0], [2, 3, 0, 1]];
        let mut played = Played {
            real: array![[1.0; 5], [5.0; 5], [13.0; 5]],
            imaginary: None,
            noise: 0.0,
            random: Random::new(0),
            shifts: shifts(&quadruples, 0.75),
            hold: None,
            kind: ValueKind::Voltage,
            last: (0, 0),
        };
        // three drives: a quarter of a frame before, at and after its time
        for (number, wanted) in
            [(0, [1.0, 1.0, 2.0]), (1, [4.0, 5.0, 7.0]), (5, [11.0, 13.0, 13.0])]
        {
            let found = [0, 1, 2, 3, 4].map(|index| played.at(number, index)[0]);
            let [before, at, after] = wanted;
            assert_eq!(found, [before, before, at, after, after], "{number}");
        }
        assert!(shifts(&quadruples, 0.0).iter().all(|shift| *shift == 0.0));
    }
}
