//! Converts the scene's keys to stimulation and measurement patterns.

use super::{Scene, plain};
use crate::arrangement::layout;
use crate::error::SkinError;
use eit_fem::{DrivenElectrodes, PairPattern, PairProtocol, Protocol};
use eit_hw::{Format, Layout, ReadOptions, read_recording};
use std::path::Path;

/// Default drive current, ampere.
pub(crate) const DEFAULT_CURRENT_A: f64 = 1e-4;

/// `protocol.drive` for currents on all electrodes at once.
const TRIGONOMETRIC: &str = "trigonometric";

/// `protocol.measure` for the potential of each electrode against a common one, such as the sink.
const GROUND: &str = "ground";

impl Scene {
    /// Returns the protocol for a number of electrodes.
    ///
    /// # Errors
    ///
    /// Keys that exclude each other, files that cannot be read, and patterns that are invalid for this number of
    /// electrodes.
    pub fn protocol(&self, electrodes: usize) -> Result<Protocol, SkinError> {
        let keys = &self.protocol;
        let current_a = keys.current_a.unwrap_or(DEFAULT_CURRENT_A);
        let found = if let Some(file) = &keys.quadruples_file {
            let quadruples = self.quadruples(file)?;
            Protocol::from_quadruples(electrodes, &quadruples, current_a)
        } else if let Some(file) = &keys.stimulation_file {
            return self.pattern_protocol(file, electrodes, current_a);
        } else if keys.drive.as_deref() == Some(TRIGONOMETRIC) {
            if keys.driven_electrodes == DrivenElectrodes::Drop {
                return Err(self.error(format!(
                    "protocol.drive = \"{TRIGONOMETRIC}\" drives every electrode: set \
                     protocol.driven_electrodes = \"keep\""
                )));
            }
            if self.is_ground() {
                return Err(self.error(format!(
                    "protocol.measure = \"{GROUND}\" is for currents of two electrodes, not \
                     drive = \"{TRIGONOMETRIC}\""
                )));
            }
            let measure = self.pattern("protocol.measure", keys.measure.as_deref())?;
            Protocol::trigonometric(electrodes, &measure, current_a)
        } else {
            self.pair_protocol(electrodes)?.protocol()
        };
        found.map_err(|e| SkinError::from(e).within(&self.place))
    }

    /// Whether the instrument measures potentials against a common electrode.
    fn is_ground(&self) -> bool {
        self.protocol.measure.as_deref() == Some(GROUND)
    }

    /// Returns what a frame holds where its source does not name electrodes: the measurements of the protocol, or potentials.
    pub fn frame_layout(&self, protocol: &Protocol) -> Layout {
        let quadruples = protocol.quadruples().unwrap_or_default();
        let ground = self.is_ground().then_some(self.protocol.driven_electrodes);
        layout(quadruples, protocol.electrodes(), ground)
    }

    /// Returns the scene's pair protocol, if it is one. Pairs that are formed from potentials are those of neighbours, without
    /// current-carrying electrodes.
    ///
    /// # Errors
    ///
    /// An unknown name of a pattern, and pairs that are invalid for this number of electrodes.
    pub(crate) fn pair_protocol(&self, electrodes: usize) -> Result<PairProtocol, SkinError> {
        let keys = &self.protocol;
        let drive = match &keys.pairs {
            Some(pairs) => PairPattern::Pairs(plain(pairs)),
            None => self.pattern("protocol.drive", keys.drive.as_deref())?,
        };
        let (measure, driven_electrodes) = match self.is_ground() {
            true => (PairPattern::Adjacent, DrivenElectrodes::Drop),
            false => {
                (self.pattern("protocol.measure", keys.measure.as_deref())?, keys.driven_electrodes)
            }
        };
        Ok(PairProtocol {
            electrodes,
            drive,
            measure,
            driven_electrodes,
            order: keys.order,
            current_a: keys.current_a.unwrap_or(DEFAULT_CURRENT_A),
        })
    }

    fn pattern(&self, key: &str, text: Option<&str>) -> Result<PairPattern, SkinError> {
        match text {
            None | Some("adjacent") => Ok(PairPattern::Adjacent),
            Some("opposite") => Ok(PairPattern::Opposite),
            Some(other) => match other.strip_prefix("skip-").map(str::parse) {
                Some(Ok(between)) => Ok(PairPattern::Skip(between)),
                _ => Err(self.error(format!(
                    "{key} = \"{other}\" is none of \"adjacent\", \"opposite\", \"skip-N\" \
                     (N electrodes between){}",
                    if key == "protocol.drive" { ", \"trigonometric\"" } else { ", \"ground\"" }
                ))),
            },
        }
    }

    fn quadruples(&self, file: &Path) -> Result<Vec<[u32; 4]>, SkinError> {
        let path = self.resolve(file);
        let table = read_table(&path, Format::Csv)?;
        let index = |value: &f64| {
            let whole = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(value);
            whole.then_some(*value as u32)
        };
        let rows = table.rows().into_iter().enumerate();
        rows.map(|(row, values)| {
            let numbers: Option<Vec<u32>> = values.iter().map(index).collect();
            numbers.and_then(|n| <[u32; 4]>::try_from(n).ok()).ok_or_else(|| {
                let found: Vec<f64> = values.to_vec();
                SkinError::input(format!(
                    "{}: row {}: {found:?} is not four electrode indices a,b,m,n from 0",
                    path.display(),
                    row + 1
                ))
            })
        })
        .collect()
    }

    fn pattern_protocol(
        &self,
        stimulation: &Path,
        electrodes: usize,
        current_a: f64,
    ) -> Result<Protocol, SkinError> {
        let measurement = self.needed(
            self.protocol.measurement_file.as_deref(),
            "protocol.measurement_file",
            "protocol.stimulation_file",
        )?;
        let mut stimulation_matrix = read_patterns(&self.resolve(stimulation), electrodes)?;
        let measurement_matrix = read_patterns(&self.resolve(measurement), electrodes)?;
        for (file, matrix) in
            [(stimulation, &stimulation_matrix), (measurement, &measurement_matrix)]
        {
            if matrix.nrows() != electrodes {
                return Err(SkinError::input(format!(
                    "{}: shape {:?}, but it must be [electrode, pattern] with {electrodes} \
                     electrodes",
                    self.resolve(file).display(),
                    matrix.shape()
                )));
            }
        }
        stimulation_matrix *= current_a;
        Ok(Protocol::from_patterns(stimulation_matrix.view(), measurement_matrix.view())?)
    }
}

fn read_table(path: &Path, format: Format) -> Result<ndarray::Array2<f64>, SkinError> {
    Ok(read_recording(path, Some(format), &ReadOptions::default())?.real)
}

/// Reads a pattern matrix [electrode, pattern] of any number type from an `.npy` file.
fn read_patterns(path: &Path, electrodes: usize) -> Result<ndarray::Array2<f64>, SkinError> {
    let matrix = read_table(path, Format::Npy)?;
    // the reader interprets one column as one frame: here it is one pattern
    let one_pattern = matrix.dim() == (1, electrodes) && electrodes > 1;
    Ok(if one_pattern { matrix.reversed_axes() } else { matrix })
}
