//! Driver of EITS-1 instruments: see [`codec::eits1`](crate::codec::eits1) and docs/EITS-1.md.

mod command;
mod meaning;

use std::time::{Duration, Instant};

use self::command::{Command, answer_limit, send};
use self::meaning::{Count, Counted, fill, reason, text};
use super::decoded::{Decoded, RawFrame};
use super::interface::Driver;
use super::setup::{Identity, Limits, Setup};
use crate::codec::eits1::{
    CRC_BYTES, Configuration, Decoder, Event, HEADER_BYTES, Information, Kind,
};
use crate::error::HwError;
use crate::frame::{Quadruple, Quality};
use crate::recording::Layout;
use crate::transport::Link;

/// Maximum number of times a command is sent: commands are idempotent, and bytes may be lost.
const ATTEMPTS: u32 = 4;
/// Relative tolerance for a device that rounds its settings.
const READ_BACK_ERROR: f32 = 0.01;

/// Driver of EITS-1 instruments.
///
/// If a frame has no flags per measurement, its "saturated" and "electrode off" flags mark all of
/// its measurements, since nothing says which are affected.
#[derive(Clone, Debug)]
pub struct Eits1 {
    configuration: Configuration,
    decoder: Decoder,
    command: u32,
    complex: bool,
    count: Count,
    /// Arrival of the last frame, to estimate how many can have been lost since.
    came: Option<Instant>,
    values: Vec<f64>,
    imaginary: Vec<f64>,
    quality: Vec<Quality>,
    /// Bytes received after the last answer: the start of the stream.
    early: Vec<u8>,
}

impl Eits1 {
    /// Creates a driver that measures these quadruples, in their order; `frequency_hz` 0 is direct
    /// current.
    ///
    /// # Errors
    /// [`HwError::Setting`] if EITS-1 cannot represent the quadruples, the rate or current is not
    /// finite and above 0, or the frequency is not finite and at least 0.
    pub fn new(
        quadruples: &[Quadruple],
        frame_rate_hz: f32,
        current_a: f32,
        frequency_hz: f32,
    ) -> Result<Self, HwError> {
        for (name, value, least_ok) in [
            ("frame_rate_hz", frame_rate_hz, false),
            ("current_a", current_a, false),
            ("frequency_hz", frequency_hz, true),
        ] {
            let is_valid = value.is_finite() && (value > 0.0 || least_ok && value == 0.0);
            let wanted = "a finite number above 0 (0 is direct current)";
            HwError::require(is_valid, name, value, wanted)?;
        }
        let configuration = Configuration::new(quadruples, frame_rate_hz, current_a, frequency_hz)?;
        let count = quadruples.len();
        Ok(Self {
            configuration,
            decoder: Decoder::new(),
            command: 0,
            complex: false,
            count: Count::default(),
            came: None,
            values: vec![0.0; count],
            imaginary: Vec::new(),
            quality: vec![Quality::GOOD; count],
            early: Vec::new(),
        })
    }

    /// Sends a command until it is answered; returns the answer's payload.
    fn ask(&mut self, link: &mut Link, command: &Command<'_>) -> Result<Vec<u8>, HwError> {
        let Command { kind, payload, answer: wanted, purpose } = *command;
        let mut buffer = [0; 4096];
        self.early.clear();
        let first = self.command.wrapping_add(1);
        let mut waited = Duration::ZERO;
        for attempt in 0..ATTEMPTS {
            self.command = self.command.wrapping_add(1);
            let sequence = self.command;
            send(link, kind, sequence, payload)?;
            let sent = Instant::now();
            let limit = answer_limit(link.endpoint(), attempt, payload.len(), wanted);
            waited += limit;
            // all attempts send the same command, so a late answer to an earlier one is as good
            let is_ours = |number: u32| number.wrapping_sub(first) <= sequence.wrapping_sub(first);
            while sent.elapsed() < limit {
                let received = link.read(&mut buffer)?;
                let (mut answer, mut refusal) = (None, None);
                let mut bytes = buffer[..received].iter();
                for byte in bytes.by_ref() {
                    self.decoder.push(&[*byte], &mut |event| match event {
                        Event::Message(m) if is_ours(m.sequence) && m.kind == wanted => {
                            answer = Some(m.payload.to_vec());
                        }
                        Event::Message(m) if is_ours(m.sequence) && m.kind == Kind::Refusal => {
                            refusal = Some(reason(m.payload));
                        }
                        _ => {}
                    });
                    if answer.is_some() {
                        break;
                    }
                }
                self.early.extend(bytes);
                if let Some(answer) = answer {
                    return Ok(answer);
                }
                if let Some(reason) = refusal {
                    let endpoint = link.endpoint().to_string();
                    return Err(HwError::Refused { endpoint, command: purpose, reason });
                }
            }
        }
        let (endpoint, waited_s) = (link.endpoint().to_string(), waited.as_secs_f64());
        if wanted == Kind::Information {
            let wanted = "EITS-1 information";
            return Err(HwError::NoReply { endpoint, driver: "eits1", wanted, waited_s });
        }
        // it has identified itself, so neither driver nor baud rate is wrong
        let bytes = HEADER_BYTES + payload.len() + CRC_BYTES;
        Err(HwError::Unanswered { endpoint, command: purpose, bytes, waited_s })
    }

    /// Checks that the instrument has the electrodes and the room for the measurements.
    fn fits(&self, link: &Link, information: &Information) -> Result<(), HwError> {
        let quadruples = &self.configuration.quadruples;
        let electrodes = quadruples.iter().flatten().max().map_or(0, |&last| usize::from(last) + 1);
        for (setting, wanted, found) in [
            ("the number of electrodes", electrodes, information.electrodes),
            ("the number of measurements", quadruples.len(), information.max_measurements),
        ] {
            if wanted > usize::from(found) {
                let (endpoint, wanted) = (link.endpoint().to_string(), wanted.to_string());
                let found = format!("at most {found}");
                return Err(HwError::ReadBack { endpoint, setting, wanted, found });
            }
        }
        Ok(())
    }

    fn read_back(&self, link: &Link, found: &Configuration) -> Result<(), HwError> {
        let wanted = &self.configuration;
        let differs = |setting, wanted: String, found: String| {
            let endpoint = link.endpoint().to_string();
            Err(HwError::ReadBack { endpoint, setting, wanted, found })
        };
        for (setting, wanted, found) in [
            ("the frame rate in Hz", wanted.frame_rate_hz, found.frame_rate_hz),
            ("the current in A", wanted.current_a, found.current_a),
            ("the frequency in Hz", wanted.frequency_hz, found.frequency_hz),
        ] {
            // a NaN is not near
            let near = (found - wanted).abs() <= READ_BACK_ERROR * wanted.abs();
            if !near {
                return differs(setting, wanted.to_string(), found.to_string());
            }
        }
        let pairs = wanted.quadruples.iter().zip(&found.quadruples);
        if let Some((wanted, found)) = pairs.clone().find(|(wanted, found)| wanted != found) {
            return differs("a measurement", format!("{wanted:?}"), format!("{found:?}"));
        }
        let (wanted, found) = (wanted.quadruples.len(), found.quadruples.len());
        if wanted == found {
            return Ok(());
        }
        differs("the number of measurements", wanted.to_string(), found.to_string())
    }
}

impl Driver for Eits1 {
    fn name(&self) -> &'static str {
        "eits1"
    }

    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError> {
        self.decoder.reset();
        send(link, Kind::Stop, 0, &[])?;
        link.drain(Duration::from_millis(60), Duration::from_millis(500))?;
        let identify =
            Command::without_payload(Kind::Identify, Kind::Information, "identify itself");
        let bytes = self.ask(link, &identify)?;
        let not_read = |what| HwError::Refused {
            endpoint: link.endpoint().to_string(),
            command: what,
            reason: "its answer is not valid in EITS-1 version 1".into(),
        };
        let information =
            Information::from_bytes(&bytes).ok_or_else(|| not_read("identify itself"))?;
        self.fits(link, &information)?;
        self.ask(link, &Command::without_payload(Kind::Stop, Kind::Acknowledgement, "stop"))?;
        let payload = self.configuration.to_bytes();
        let configure = Command {
            kind: Kind::Configuration,
            payload: &payload,
            answer: Kind::Configuration,
            purpose: "use the configuration",
        };
        let bytes = self.ask(link, &configure)?;
        let found = Configuration::from_bytes(&bytes).ok_or_else(|| HwError::Refused {
            endpoint: link.endpoint().to_string(),
            command: "use the configuration",
            reason: "its answer is not valid in EITS-1 version 1".into(),
        })?;
        self.read_back(link, &found)?;
        let count = self.configuration.quadruples.len();
        self.complex = information.complex;
        self.imaginary = vec![0.0; if self.complex { count } else { 0 }];
        let full_scale = f64::from(information.full_scale);
        Ok(Setup {
            identity: Identity::one_line("eits1", &information.name, &information.serial),
            layout: Layout::Quadruples(
                self.configuration.quadruples.iter().map(|q| q.map(u32::from)).collect(),
            ),
            value_count: count,
            complex: self.complex,
            unit: information.unit,
            frame_rate_hz: Some(f64::from(found.frame_rate_hz)),
            limits: Limits {
                full_scale: (full_scale.is_finite() && full_scale > 0.0).then_some(full_scale),
                open_up_to: None,
                stuck_frames: Some(64),
            },
        })
    }

    fn start(&mut self, link: &mut Link) -> Result<(), HwError> {
        (self.count, self.came) = (Count::default(), None);
        let start = Command::without_payload(Kind::Start, Kind::Acknowledgement, "start");
        self.ask(link, &start).map(|_| ())
    }

    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>)) {
        let Self { decoder, count, came, values, imaginary, quality, complex, early, .. } = self;
        let rate_hz = f64::from(self.configuration.frame_rate_hz);
        let mut on_event = |event: Event<'_>| {
            let message = match event {
                Event::Damaged { bytes, .. } => {
                    return on_decoded(Decoded::Damaged { bytes: bytes as u64 });
                }
                Event::Message(message) => message,
            };
            match message.kind {
                Kind::Frame => {}
                Kind::Text => return on_decoded(Decoded::Notice(&text(message.payload))),
                // a device sends its information when it starts
                Kind::Information => return on_decoded(Decoded::Restarted),
                _ => return,
            }
            let size = message.payload.len() as u64;
            if message.measurements() != values.len() || message.is_complex() != *complex {
                return on_decoded(Decoded::Damaged { bytes: size });
            }
            let waited_s = came.replace(Instant::now()).map_or(0.0, |t| t.elapsed().as_secs_f64());
            let counter = match count.take(message.sequence, rate_hz * waited_s) {
                Counted::Frame(counter) => counter,
                Counted::PassedOver => return on_decoded(Decoded::Damaged { bytes: size }),
                Counted::Renumbered { count, passed_over } => {
                    (0..passed_over).for_each(|_| on_decoded(Decoded::TruncatedFrame));
                    on_decoded(Decoded::Renumbered);
                    count
                }
            };
            fill(&message, values, imaginary, quality);
            on_decoded(Decoded::Frame(RawFrame {
                values,
                imaginary,
                quality,
                counter: Some(counter),
                device_time_s: Some(message.device_time_us as f64 * 1e-6),
            }));
        };
        decoder.push(&std::mem::take(early), &mut on_event);
        decoder.push(bytes, &mut on_event);
    }

    fn stop(&mut self, link: &mut Link) -> Result<(), HwError> {
        send(link, Kind::Stop, 0, &[])
    }
}
