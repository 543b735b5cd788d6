//! An emulated EITS-1 instrument.

use std::time::Duration;

use super::device::{Device, Pace, ValueSource};
use crate::codec::eits1::{
    Configuration, Decoder, Event, Information, Kind, Message, Refusal, encode, flags,
};
use crate::frame::Quadruple;

/// An EITS-1 instrument that measures as configured, with values from the caller.
pub struct Eits1Device {
    information: Information,
    source: ValueSource,
    decoder: Decoder,
    configuration: Option<Configuration>,
    quadruples: Vec<Quadruple>,
    values: Vec<f64>,
    payload: Vec<u8>,
    /// Timing of frames while streaming.
    pace: Option<Pace>,
    sequence: u64,
    announce: bool,
}

impl std::fmt::Debug for Eits1Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Eits1Device")
            .field("information", &self.information)
            .field("configuration", &self.configuration)
            .field("sequence", &self.sequence)
            .finish_non_exhaustive()
    }
}

impl Eits1Device {
    /// Creates an instrument that reports `information`.
    pub fn new(information: Information, source: ValueSource) -> Self {
        Self {
            information,
            source,
            decoder: Decoder::new(),
            configuration: None,
            quadruples: Vec::new(),
            values: Vec::new(),
            payload: Vec::new(),
            pace: None,
            sequence: 0,
            announce: false,
        }
    }

    /// Applies the host's configuration if it is valid.
    fn configure(&mut self, payload: &[u8]) -> Result<(), Refusal> {
        if self.pace.is_some() {
            return Err(Refusal::Busy);
        }
        let wanted = Configuration::from_bytes(payload).ok_or(Refusal::Length)?;
        let count = wanted.quadruples.len();
        let electrode = |&e: &u8| u16::from(e) < self.information.electrodes;
        let rate = wanted.frame_rate_hz > 0.0
            && wanted.frame_rate_hz <= self.information.max_frame_rate_hz;
        if count == 0
            || count > usize::from(self.information.max_measurements)
            || !wanted.quadruples.iter().flatten().all(electrode)
            || !rate
        {
            return Err(Refusal::Value);
        }
        self.quadruples = wanted.quadruples.iter().map(|q| q.map(u32::from)).collect();
        self.values = vec![0.0; if self.information.complex { 2 * count } else { count }];
        self.configuration = Some(wanted);
        Ok(())
    }

    fn answer(&mut self, message: &Message<'_>, now: Duration, out: &mut Vec<u8>) {
        let refused = |refusal: Refusal| (Kind::Refusal, vec![message.kind as u8, refusal as u8]);
        let done = (Kind::Acknowledgement, vec![message.kind as u8]);
        let in_force = |configuration: &Option<Configuration>| match configuration {
            Some(configuration) => (Kind::Configuration, configuration.to_bytes()),
            None => refused(Refusal::Busy),
        };
        let (kind, payload) = match message.kind {
            Kind::Identify => (Kind::Information, self.information.to_bytes()),
            Kind::Configuration => match self.configure(message.payload) {
                Ok(()) => in_force(&self.configuration),
                Err(refusal) => refused(refusal),
            },
            Kind::ReadConfiguration => in_force(&self.configuration),
            Kind::Start => match &self.configuration {
                Some(configuration) => {
                    self.pace = Some(Pace::new(f64::from(configuration.frame_rate_hz), now));
                    self.sequence = 0;
                    done
                }
                None => refused(Refusal::Busy),
            },
            Kind::Stop => {
                self.pace = None;
                done
            }
            _ => refused(Refusal::UnknownKind),
        };
        send(kind, message.sequence, 0, 0, &payload, out);
    }
}

fn send(kind: Kind, sequence: u32, time_us: u64, flags: u16, payload: &[u8], out: &mut Vec<u8>) {
    let values = if kind == Kind::Frame { payload.len() / 4 } else { payload.len() };
    let count = values.min(usize::from(u16::MAX)) as u16;
    // a payload that is too long is not sent: the caller chose the maximum number of measurements
    let _ =
        encode(&Message { kind, sequence, device_time_us: time_us, flags, count, payload }, out);
}

impl Device for Eits1Device {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        let mut decoder = std::mem::take(&mut self.decoder);
        decoder.push(bytes, &mut |event| {
            if let Event::Message(message) = event {
                self.answer(&message, now, out);
            }
        });
        self.decoder = decoder;
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        if std::mem::take(&mut self.announce) {
            send(Kind::Information, 0, 0, 0, &self.information.to_bytes(), out);
        }
        while let Some(due) = self.pace.as_mut().and_then(|pace| pace.due(now)) {
            self.frame(due, out);
        }
    }

    fn power_cycle(&mut self) {
        self.decoder.reset();
        self.configuration = None;
        self.pace = None;
        self.announce = true;
    }
}

impl Eits1Device {
    fn frame(&mut self, now: Duration, out: &mut Vec<u8>) {
        (self.source)(self.sequence, &self.quadruples, &mut self.values);
        self.payload.clear();
        self.payload.extend(self.values.iter().flat_map(|&value| (value as f32).to_le_bytes()));
        let complex = if self.information.complex { flags::COMPLEX } else { 0 };
        let time_us = now.as_micros() as u64;
        let sequence = self.sequence as u32;
        send(Kind::Frame, sequence, time_us, flags::CALIBRATED | complex, &self.payload, out);
        self.sequence += 1;
    }
}
