//! An emulated Sciospec EIT instrument, according to public descriptions.

use std::time::Duration;

use super::device::{Device, Pace};
use crate::codec::sciospec::{
    Code, DataFrame, Decoder, Event, GROUP, Output, TAG_DATA, TAG_DEVICE, TAG_GET_SETUP, TAG_RESET,
    TAG_SET_OUTPUT, TAG_SET_SETUP, TAG_SYSTEM, encode, encode_data,
};

/// A command interrupted for longer is abandoned.
const GAP: Duration = Duration::from_millis(10);

/// Computes the potentials for one driven pair from the frame number and the pair [a, b] (from 0,
/// current enters at `a`); fills real and imaginary part for each electrode, in volts.
pub type PotentialSource = Box<dyn FnMut(u64, [u32; 2], &mut [[f64; 2]]) + Send>;

/// A Sciospec EIT instrument with up to 128 electrodes. It accepts electrode numbers of either
/// width and the settings that the driver uses; others are "not executed".
pub struct SciospecDevice {
    electrodes: usize,
    serial: u16,
    reversed: bool,
    source: PotentialSource,
    decoder: Decoder,
    last_byte: Duration,
    setup: Setup,
    output: Output,
    pace: Option<Pace>,
    sequence: u64,
}

#[derive(Clone, Debug, Default)]
struct Setup {
    drives: Vec<[u8; 2]>,
    frame_rate_hz: f32,
    burst: u16,
    /// Settings by number, as received.
    stored: Vec<(u8, Vec<u8>)>,
}

impl std::fmt::Debug for SciospecDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SciospecDevice")
            .field("electrodes", &self.electrodes)
            .field("serial", &self.serial)
            .field("sequence", &self.sequence)
            .finish_non_exhaustive()
    }
}

impl SciospecDevice {
    /// Creates an instrument with this serial number. With `reversed`, current enters at the second
    /// electrode of a listed pair.
    pub fn new(electrodes: u32, serial: u16, reversed: bool, source: PotentialSource) -> Self {
        Self {
            electrodes: electrodes.min(128) as usize,
            serial,
            reversed,
            source,
            decoder: Decoder::of_commands(),
            last_byte: Duration::ZERO,
            setup: Setup::default(),
            output: Output { drive: false, frequency_row: false, time: false },
            pace: None,
            sequence: 0,
        }
    }

    fn answer(&mut self, tag: u8, payload: &[u8], now: Duration, out: &mut Vec<u8>) {
        let code = match tag {
            TAG_DEVICE => {
                let [s0, s1] = self.serial.to_be_bytes();
                encode(TAG_DEVICE, &[1, 0, 0x19, s0, s1, 0x0A, 7, 1, 0, 0x58], out);
                Code::Executed
            }
            TAG_SET_SETUP => self.set(payload),
            TAG_GET_SETUP => match self.get(payload) {
                Some(value) => {
                    encode(TAG_GET_SETUP, &value, out);
                    Code::Executed
                }
                None => Code::NotExecuted,
            },
            TAG_SET_OUTPUT => self.choose(payload),
            TAG_DATA => self.run(payload, now),
            TAG_RESET => {
                self.power_cycle();
                Code::Executed
            }
            _ => Code::Unknown,
        };
        encode(TAG_SYSTEM, &[code.byte()], out);
        if tag == TAG_RESET {
            encode(TAG_SYSTEM, &[Code::Booted.byte()], out);
            encode(TAG_SYSTEM, &[Code::Ready.byte()], out);
        }
    }

    fn set(&mut self, payload: &[u8]) -> Code {
        if self.pace.is_some() {
            return Code::NotExecuted;
        }
        let in_range = |value: f64, least: f64, most: f64| (least..=most).contains(&value);
        let float = |bytes: &[u8; 4]| f64::from(f32::from_be_bytes(*bytes));
        let valid = match payload {
            [0x01] => {
                self.setup = Setup::default();
                return Code::Executed;
            }
            [0x06, a, b] | [0x06, 0, a, 0, b] => {
                let limit = 1..=self.electrodes;
                let fits = a != b && [a, b].iter().all(|&&e| limit.contains(&usize::from(e)));
                if fits {
                    self.setup.drives.push([*a, *b]);
                }
                return if fits { Code::Executed } else { Code::NotExecuted };
            }
            [0x02, high, low] => {
                self.setup.burst = u16::from_be_bytes([*high, *low]);
                true
            }
            [0x03, r0, r1, r2, r3] => {
                let rate = f32::from_be_bytes([*r0, *r1, *r2, *r3]);
                let fits = in_range(f64::from(rate), 0.1, 100.0);
                if fits {
                    self.setup.frame_rate_hz = rate;
                }
                fits
            }
            [0x04, rest @ ..] => match rest.as_chunks::<4>() {
                ([least, most, _], [_] | []) | ([least, most], [_, _, _]) => {
                    in_range(float(least), 1e2, 1e6) && in_range(float(most), 1e2, 1e6)
                }
                _ => false,
            },
            [0x05, bytes @ ..] => match (bytes.first_chunk::<4>(), bytes.first_chunk::<8>()) {
                (_, Some(bytes)) => in_range(f64::from_be_bytes(*bytes), 1e-7, 1e-2),
                (Some(bytes), None) => in_range(float(bytes), 1e-7, 1e-2),
                _ => false,
            },
            [0x08, mode, boundary] => (1..=4).contains(mode) && (1..=2).contains(boundary),
            [0x09, 1, gain] => *gain <= 3,
            [0x0C, switch] => (1..=2).contains(switch),
            [0x0D, range] => (1..=3).contains(range),
            _ => false,
        };
        let Some((&setting, value)) = payload.split_first().filter(|_| valid) else {
            return Code::NotExecuted;
        };
        self.setup.stored.retain(|(stored, _)| *stored != setting);
        self.setup.stored.push((setting, value.to_vec()));
        Code::Executed
    }

    fn get(&self, payload: &[u8]) -> Option<Vec<u8>> {
        let &[setting] = payload else { return None };
        let (_, value) = self.setup.stored.iter().find(|(stored, _)| *stored == setting)?;
        Some([&[setting], &value[..]].concat())
    }

    fn choose(&mut self, payload: &[u8]) -> Code {
        match *payload {
            [1, on @ 0..=1] => self.output.drive = on == 1,
            [2, on @ 0..=1] => self.output.frequency_row = on == 1,
            [3, on @ 0..=1] => self.output.time = on == 1,
            _ => return Code::NotExecuted,
        }
        Code::Executed
    }

    fn run(&mut self, payload: &[u8], now: Duration) -> Code {
        match payload {
            [0] => self.pace = None,
            [1] if !self.setup.drives.is_empty() && self.setup.frame_rate_hz > 0.0 => {
                self.pace = Some(Pace::new(f64::from(self.setup.frame_rate_hz), now));
                self.sequence = 0;
            }
            _ => return Code::NotExecuted,
        }
        Code::Executed
    }

    fn frame(&mut self, now: Duration, out: &mut Vec<u8>) {
        let mut potentials = vec![[0.0; 2]; self.electrodes];
        let sign = if self.reversed { -1.0 } else { 1.0 };
        for &[a, b] in &self.setup.drives {
            let drive = [u32::from(a) - 1, u32::from(b) - 1];
            (self.source)(self.sequence, drive, &mut potentials);
            for (group, channels) in (1..).zip(potentials.chunks(GROUP)) {
                // an unconnected channel, as in a public recording
                let mut potentials_v = [[-2.5e-6, -1.7e-6]; GROUP];
                for (slot, parts) in potentials_v.iter_mut().zip(channels) {
                    *slot = parts.map(|part| (sign * part) as f32);
                }
                let data = DataFrame {
                    group,
                    drive: self.output.drive.then_some([a, b]),
                    frequency_row: self.output.frequency_row.then_some(1),
                    time_ms: self.output.time.then_some(now.as_millis() as u32),
                    potentials_v,
                };
                encode_data(&data, out);
            }
        }
        self.sequence += 1;
        if self.setup.burst > 0 && self.sequence >= u64::from(self.setup.burst) {
            self.pace = None;
        }
    }
}

impl Device for SciospecDevice {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        self.last_byte = now;
        let mut decoder = std::mem::replace(&mut self.decoder, Decoder::of_commands());
        decoder.push(bytes, &mut |event| match event {
            Event::Other { tag, payload } => self.answer(tag, payload, now, out),
            Event::Skipped { .. } => encode(TAG_SYSTEM, &[Code::Syntax.byte()], out),
            Event::System(_) | Event::Data(_) => {}
        });
        self.decoder = decoder;
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        if self.decoder.is_open() && now.saturating_sub(self.last_byte) > GAP {
            self.decoder.reset();
            encode(TAG_SYSTEM, &[Code::Timeout.byte()], out);
        }
        while let Some(due) = self.pace.as_mut().and_then(|pace| pace.due(now)) {
            self.frame(due, out);
        }
    }

    fn power_cycle(&mut self) {
        self.decoder.reset();
        self.setup = Setup::default();
        self.output = Output { drive: false, frequency_row: false, time: false };
        self.pace = None;
    }
}
