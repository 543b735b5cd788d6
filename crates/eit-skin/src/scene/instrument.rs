//! `[instrument]`: the live instrument of a scene and its driver.

use super::Scene;
use crate::error::SkinError;
use eit_fem::Protocol;
use eit_hw::codec::text::TextFormat;
use eit_hw::driver::{
    Board, Driver, Eits1, Gain, PairWidth, Polarity, Range, Sciospec, SciospecSettings,
};
use eit_hw::{Endpoint, Layout, Quadruple};
use serde::{Deserialize, Serialize};

/// Default frame rate, hertz.
const DEFAULT_RATE_HZ: f64 = 20.0;
/// Baud rate if neither the scene nor the board states one.
const DEFAULT_BAUD: u32 = 115_200;
/// Default frequency of a Sciospec instrument's current, hertz.
const DEFAULT_SCIOSPEC_HZ: f64 = 1e4;

/// `[instrument]`
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct InstrumentSettings {
    /// "eits1", "sciospec", "csv", or the name of a board.
    pub driver: String,
    /// Serial port, or `tcp:HOST:PORT`.
    pub port: Option<String>,
    /// Baud rate of the serial line.
    pub baud: Option<u32>,
    /// Level of the DTR line while the port is open.
    pub dtr: Option<bool>,
    /// Requested frame rate, hertz; 20 by default.
    pub frame_rate_hz: Option<f64>,
    /// Frequency of the current, hertz.
    pub frequency_hz: Option<f64>,
    /// Sciospec: 1, 10, 100 or 1000.
    pub gain: Option<u32>,
    /// Sciospec: 1, 5 or 10 V.
    pub range_v: Option<u32>,
    /// Sciospec: bytes per electrode number.
    pub pair_width: Option<PairWidth>,
    /// Sciospec: the driven electrode at which the current enters.
    pub polarity: Option<Polarity>,
}

/// Driver, with the settings that only it needs.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum DriverKind {
    /// Our own protocol, docs/EITS-1.md.
    Eits1,
    /// Sciospec ISX-3 and EIT devices.
    Sciospec(SciospecSettings),
    /// A board that prints lines of numbers.
    Board(Box<Board>),
}

/// The instrument of a scene, checked.
#[derive(Debug, Clone)]
pub struct Instrument {
    /// Driver that talks to it.
    pub kind: DriverKind,
    /// Number of electrodes of the skin.
    pub electrodes: usize,
    /// Measurements of the scene's protocol, in its order.
    pub quadruples: Vec<Quadruple>,
    /// Requested frame rate, hertz.
    pub frame_rate_hz: f64,
    /// Amplitude of the current, ampere.
    pub current_a: f64,
    /// Frequency of the current, hertz; 0 is direct current.
    pub frequency_hz: f64,
    /// Port, if stated.
    pub port: Option<String>,
    /// Baud rate of the serial line.
    pub baud: u32,
    dtr: Option<bool>,
    /// The scene as named by the user, for messages.
    pub place: String,
}

impl Scene {
    /// Returns the instrument that the scene names, for its own skin and protocol. Does not generate a mesh.
    ///
    /// # Errors
    ///
    /// No `[instrument]`, an unknown driver, a key that the driver does not have, and an invalid protocol.
    pub fn instrument(&self) -> Result<Instrument, SkinError> {
        let named = self.instrument_settings().map(|_| ());
        let protocol = named.and_then(|()| self.protocol(self.electrode_count()?));
        self.instrument_of(&protocol.map_err(|e| e.within(&self.place))?)
    }

    /// The same for an existing protocol.
    fn instrument_of(&self, protocol: &Protocol) -> Result<Instrument, SkinError> {
        self.instrument_settings()
            .and_then(|settings| {
                settings.build(
                    protocol,
                    &self.frame_layout(protocol),
                    self.current_a(),
                    &self.place,
                )
            })
            .map_err(|e| e.within(&self.place))
    }

    /// Amplitude of the drive current, ampere.
    pub(crate) fn current_a(&self) -> f64 {
        self.protocol.current_a.unwrap_or(super::protocol::DEFAULT_CURRENT_A)
    }

    fn instrument_settings(&self) -> Result<&InstrumentSettings, SkinError> {
        self.instrument.as_ref().ok_or_else(|| {
            SkinError::input(
                "has no [instrument]: add one, such as `[instrument]`, `driver = \"eits1\"`, \
                 `port = \"/dev/ttyACM0\"` (docs/SCENE.md)",
            )
        })
    }
}

impl InstrumentSettings {
    /// The instrument for a protocol and the layout of frames that name no electrodes, checked.
    pub(crate) fn build(
        &self,
        protocol: &Protocol,
        layout: &Layout,
        current_a: f64,
        place: &str,
    ) -> Result<Instrument, SkinError> {
        let keys = self;
        let electrodes = protocol.electrodes();
        let quadruples = protocol.quadruples().map(<[_]>::to_vec).ok_or_else(|| {
            SkinError::input(
                "[protocol] has general current patterns, which no driver sets up: use `drive`, \
                 `pairs` or `quadruples_file`",
            )
        })?;
        let frame_rate_hz = keys.frame_rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let mut kind = keys.kind(electrodes, &quadruples, current_a, frame_rate_hz)?;
        if let (DriverKind::Board(board), Some(count)) = (&mut kind, layout.value_count())
            && board.layout == Layout::ProtocolOrder
        {
            (board.format, board.layout) = (TextFormat::csv(count), layout.clone());
        }
        keys.check_company(&kind)?;
        let (baud, frequency_hz) = match &kind {
            DriverKind::Board(board) => (board.baud, 0.0),
            DriverKind::Sciospec(settings) => (DEFAULT_BAUD, f64::from(settings.frequency_hz)),
            DriverKind::Eits1 => (DEFAULT_BAUD, keys.frequency_hz.unwrap_or(0.0)),
        };
        let instrument = Instrument {
            kind,
            electrodes,
            quadruples,
            frame_rate_hz,
            current_a,
            frequency_hz,
            port: keys.port.clone(),
            baud: keys.baud.unwrap_or(baud),
            dtr: keys.dtr,
            place: place.to_owned(),
        };
        // find invalid settings before a port is opened
        instrument.driver()?;
        Ok(instrument)
    }

    fn kind(
        &self,
        electrodes: usize,
        quadruples: &[Quadruple],
        current_a: f64,
        frame_rate_hz: f64,
    ) -> Result<DriverKind, SkinError> {
        match self.driver.as_str() {
            "eits1" => Ok(DriverKind::Eits1),
            "sciospec" => {
                let electrodes = u32::try_from(electrodes).unwrap_or(u32::MAX);
                Ok(DriverKind::Sciospec(SciospecSettings {
                    current_a,
                    frequency_hz: self.frequency_hz.unwrap_or(DEFAULT_SCIOSPEC_HZ) as f32,
                    frame_rate_hz: frame_rate_hz as f32,
                    gain: self.gain()?,
                    range: self.range()?,
                    pair_width: self.pair_width.unwrap_or_default(),
                    polarity: self.polarity.unwrap_or_default(),
                    ..SciospecSettings::for_quadruples(electrodes, quadruples)
                }))
            }
            "csv" => {
                let format = TextFormat::csv(quadruples.len());
                let board = Board::new("csv", DEFAULT_BAUD, format, Layout::ProtocolOrder);
                Ok(DriverKind::Board(Box::new(board)))
            }
            name if Board::PRESETS.contains(&name) => {
                Ok(DriverKind::Board(Box::new(Board::preset(name)?)))
            }
            name => {
                let known = ["eits1", "sciospec", "csv"].iter().chain(&Board::PRESETS);
                let known: Vec<String> = known.map(|name| format!("\"{name}\"")).collect();
                Err(SkinError::input(format!(
                    "instrument.driver = \"{name}\" is none of {}",
                    known.join(", ")
                )))
            }
        }
    }

    fn gain(&self) -> Result<Gain, SkinError> {
        match self.gain {
            None | Some(1) => Ok(Gain::X1),
            Some(10) => Ok(Gain::X10),
            Some(100) => Ok(Gain::X100),
            Some(1000) => Ok(Gain::X1000),
            Some(other) => Err(SkinError::input(format!(
                "instrument.gain is {other}: it must be 1, 10, 100 or 1000"
            ))),
        }
    }

    fn range(&self) -> Result<Range, SkinError> {
        match self.range_v {
            None | Some(1) => Ok(Range::V1),
            Some(5) => Ok(Range::V5),
            Some(10) => Ok(Range::V10),
            Some(other) => {
                let message = format!("instrument.range_v is {other}: it must be 1, 5 or 10");
                Err(SkinError::input(message))
            }
        }
    }

    /// Rejects keys that the driver does not read.
    fn check_company(&self, kind: &DriverKind) -> Result<(), SkinError> {
        let sciospec = [
            ("gain", self.gain.is_some()),
            ("range_v", self.range_v.is_some()),
            ("pair_width", self.pair_width.is_some()),
            ("polarity", self.polarity.is_some()),
        ];
        let set = [
            ("frame_rate_hz", self.frame_rate_hz.is_some()),
            ("frequency_hz", self.frequency_hz.is_some()),
        ];
        let ignored = match kind {
            DriverKind::Sciospec(_) => None,
            DriverKind::Eits1 => sciospec.iter().find(|key| key.1),
            DriverKind::Board(_) => sciospec.iter().chain(&set).find(|key| key.1),
        };
        match ignored {
            None => Ok(()),
            Some((key, _)) => Err(SkinError::input(format!(
                "instrument.{key} has no effect with driver = \"{}\": remove it",
                self.driver
            ))),
        }
    }
}

impl Instrument {
    /// Creates a driver that measures the scene's protocol.
    ///
    /// # Errors
    ///
    /// Settings that the driver rejects.
    pub fn driver(&self) -> Result<Box<dyn Driver>, SkinError> {
        Ok(match &self.kind {
            DriverKind::Eits1 => Box::new(Eits1::new(
                &self.quadruples,
                self.frame_rate_hz as f32,
                self.current_a as f32,
                self.frequency_hz as f32,
            )?),
            DriverKind::Sciospec(settings) => Box::new(Sciospec::new(settings.clone())?),
            DriverKind::Board(board) => board.as_ref().clone().driver()?,
        })
    }

    /// Returns the endpoint: `given` on the command line, else that of the scene.
    ///
    /// # Errors
    ///
    /// No port, and an address that is neither a port nor `tcp:host:port`.
    pub fn endpoint(&self, given: Option<&str>) -> Result<Endpoint, SkinError> {
        let port = given.or(self.port.as_deref()).ok_or_else(|| {
            let problem =
                "instrument.port is missing: set it, or give a port (`eit check` lists them)";
            SkinError::argument("port", problem).within(&self.place)
        })?;
        Ok(match Endpoint::parse(port, self.baud)? {
            Endpoint::Serial { path, baud, .. } => Endpoint::Serial { path, baud, dtr: self.dtr },
            other => other,
        })
    }

    /// Returns the driver's name in the scene, for messages.
    pub fn driver_name(&self) -> &str {
        match &self.kind {
            DriverKind::Eits1 => "eits1",
            DriverKind::Sciospec(_) => "sciospec",
            DriverKind::Board(board) => &board.name,
        }
    }
}
