//! Driver of Sciospec EIT16 to EIT128: see [`codec::sciospec`](crate::codec::sciospec).
//!
//! Works over the virtual serial port of USB full speed, or TCP port 5000 of models with a network.
//! USB high speed needs the vendor's library and is not supported. Follows public sources; not
//! verified on hardware. Check the polarity, which the driver determines by itself where it can.

mod frame;
mod settings;

pub use settings::{Gain, PairWidth, Polarity, Range, SciospecSettings};

use std::time::{Duration, Instant};

use self::frame::Assembly;
use super::decoded::Decoded;
use super::interface::Driver;
use super::setup::{Identity, Limits, Setup};
use crate::codec::sciospec::{
    Code, Decoder, Event, Output, TAG_DATA, TAG_DEVICE, TAG_GET_SETUP, TAG_SET_OUTPUT,
    TAG_SET_SETUP, encode,
};
use crate::error::HwError;
use crate::recording::{Layout, Unit};
use crate::transport::Link;

/// Time limit for the acknowledgement of a command.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// Number of times the whole set-up is tried: driven pairs accumulate, so a single command cannot
/// be repeated.
const ATTEMPTS: u32 = 3;
/// Relative tolerance for an instrument that rounds its settings.
const READ_BACK_ERROR: f32 = 0.01;
/// Largest magnitude of an open input in volts; in a public recording it reads about 3.6e-6 V.
const OPEN_UP_TO_V: f64 = 5e-6;

/// Driver of Sciospec EIT instruments. Values are the complex potentials of all electrodes against
/// the instrument's ground for each driven pair, in volts.
#[derive(Clone, Debug)]
pub struct Sciospec {
    settings: SciospecSettings,
    decoder: Decoder,
    assembly: Assembly,
    /// Bytes received after the last acknowledgement: the start of the stream.
    early: Vec<u8>,
}

impl Sciospec {
    /// Creates a driver with these settings.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first invalid setting.
    pub fn new(settings: SciospecSettings) -> Result<Self, HwError> {
        settings.validate()?;
        let assembly = Assembly::new(&settings);
        Ok(Self { settings, decoder: Decoder::new(Output::default()), assembly, early: Vec::new() })
    }

    /// Sends a command and waits for its acknowledgement; returns the value received before it.
    fn command(
        &mut self,
        link: &mut Link,
        tag: u8,
        payload: &[u8],
        doing: &'static str,
    ) -> Result<Option<Vec<u8>>, HwError> {
        let mut wire = Vec::new();
        encode(tag, payload, &mut wire);
        // in one piece: the instrument abandons a command that is interrupted for 10 ms
        link.write(&wire)?;
        let (sent, mut buffer) = (Instant::now(), [0; 4096]);
        let (mut value, mut code) = (None, None);
        self.early.clear();
        while sent.elapsed() < ANSWER_LIMIT {
            let received = link.read(&mut buffer)?;
            let mut bytes = buffer[..received].iter();
            for byte in bytes.by_ref() {
                self.decoder.push(&[*byte], &mut |event| match event {
                    Event::Other { tag: from, payload } if from == tag => {
                        value = Some(payload.to_vec());
                    }
                    Event::System(found)
                        if found == Code::Executed || found.failure().is_some() =>
                    {
                        code = Some(found);
                    }
                    _ => {}
                });
                if code.is_some() {
                    break;
                }
            }
            let Some(code) = code else { continue };
            self.early.extend(bytes);
            return match code.failure() {
                None => Ok(value),
                Some(reason) => Err(HwError::Refused {
                    endpoint: link.endpoint().to_string(),
                    command: doing,
                    reason: format!("{reason} (code {:02X})", code.byte()),
                }),
            };
        }
        Err(HwError::NoReply {
            endpoint: link.endpoint().to_string(),
            driver: "sciospec",
            wanted: "acknowledgement",
            waited_s: ANSWER_LIMIT.as_secs_f64(),
        })
    }

    fn set_up(&mut self, link: &mut Link) -> Result<Identity, HwError> {
        self.decoder.reset();
        // it may still be streaming for another session, and the acknowledgement is then lost in
        // the data
        let mut stop = Vec::new();
        encode(TAG_DATA, &[0], &mut stop);
        link.write(&stop)?;
        link.drain(Duration::from_millis(300), Duration::from_secs(3))?;
        self.decoder.reset();
        let device = self.command(link, TAG_DEVICE, &[], "identify itself")?;
        let identity = identity(device.as_deref().unwrap_or_default());
        for (payload, doing) in self.settings.commands() {
            self.command(link, TAG_SET_SETUP, &payload, doing)?;
        }
        for output in [1, 2, 3] {
            self.command(link, TAG_SET_OUTPUT, &[output, 1], "choose its output")?;
        }
        let rate = self.read_back(link, 3, "read the frame rate back")?;
        self.check(link, "the frame rate in Hz", self.settings.frame_rate_hz, rate.first())?;
        let frequency = self.read_back(link, 4, "read the frequency back")?;
        self.check(link, "the frequency in Hz", self.settings.frequency_hz, frequency.first())?;
        Ok(identity)
    }

    /// Returns the floats of a setting.
    fn read_back(
        &mut self,
        link: &mut Link,
        setting: u8,
        doing: &'static str,
    ) -> Result<Vec<f32>, HwError> {
        let value = self.command(link, TAG_GET_SETUP, &[setting], doing)?.unwrap_or_default();
        let floats = value.strip_prefix(&[setting]).unwrap_or_default().as_chunks::<4>().0;
        Ok(floats.iter().map(|&bytes| f32::from_be_bytes(bytes)).collect())
    }

    fn check(
        &self,
        link: &Link,
        setting: &'static str,
        wanted: f32,
        found: Option<&f32>,
    ) -> Result<(), HwError> {
        if found.is_some_and(|found| (found - wanted).abs() <= READ_BACK_ERROR * wanted) {
            return Ok(());
        }
        Err(HwError::ReadBack {
            endpoint: link.endpoint().to_string(),
            setting,
            wanted: wanted.to_string(),
            found: found.map_or_else(|| "nothing".to_owned(), f32::to_string),
        })
    }
}

/// Parses version, identifier and serial number (both 16 bits), year since 2010 and month; the rest
/// is internal.
fn identity(payload: &[u8]) -> Identity {
    let (name, serial) = match *payload {
        [_, i0, i1, s0, s1, year, month, ..] => (
            format!("Sciospec {:04X}", u16::from_be_bytes([i0, i1])),
            format!("{:04X} ({}-{month:02})", u16::from_be_bytes([s0, s1]), 2010 + u16::from(year)),
        ),
        _ => ("Sciospec".to_owned(), String::new()),
    };
    Identity { driver: "sciospec", name, serial }
}

impl Driver for Sciospec {
    fn name(&self) -> &'static str {
        "sciospec"
    }

    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError> {
        let mut attempt = 1;
        let identity = loop {
            match self.set_up(link) {
                Ok(identity) => break identity,
                // a lost byte is worth another attempt, a refused value is not
                Err(error @ (HwError::NoReply { .. } | HwError::Refused { .. })) => {
                    if attempt == ATTEMPTS || is_final(&error) {
                        return Err(error);
                    }
                    attempt += 1;
                }
                Err(error) => return Err(error),
            }
        };
        let electrodes = self.settings.electrodes as usize;
        let drives = self.settings.drives.clone();
        Ok(Setup {
            identity,
            value_count: drives.len() * electrodes,
            layout: Layout::Potentials { drives, electrodes, driven: true },
            complex: true,
            unit: Unit::Volt,
            frame_rate_hz: Some(f64::from(self.settings.frame_rate_hz)),
            limits: Limits {
                full_scale: Some(self.settings.range.volts() / self.settings.gain.factor()),
                open_up_to: Some(OPEN_UP_TO_V),
                stuck_frames: Some(64),
            },
        })
    }

    fn start(&mut self, link: &mut Link) -> Result<(), HwError> {
        self.assembly.reset();
        self.command(link, TAG_DATA, &[1], "start").map(|_| ())
    }

    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>)) {
        let Self { decoder, assembly, early, .. } = self;
        let mut on_event = |event: Event<'_>| match event {
            Event::Data(data) => assembly.take(&data, on_decoded),
            Event::System(Code::Booted | Code::Ready) => on_decoded(Decoded::Restarted),
            Event::System(Code::HoldUp(_)) => on_decoded(Decoded::Notice("data was held up")),
            Event::System(code) => {
                if let Some(failure) = code.failure() {
                    on_decoded(Decoded::Notice(failure));
                }
            }
            Event::Other { .. } => {}
            Event::Skipped { bytes } => on_decoded(Decoded::Damaged { bytes }),
        };
        decoder.push(&std::mem::take(early), &mut on_event);
        decoder.push(bytes, &mut on_event);
    }

    fn stop(&mut self, link: &mut Link) -> Result<(), HwError> {
        let mut wire = Vec::new();
        encode(TAG_DATA, &[0], &mut wire);
        link.write(&wire)
    }
}

fn is_final(error: &HwError) -> bool {
    let code = format!("(code {:02X})", Code::NotExecuted.byte());
    matches!(error, HwError::Refused { reason, .. } if reason.ends_with(&code))
}
