//! Converts raw frames to frames in protocol order.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use super::settings::SessionSettings;
use crate::driver::decoded::RawFrame;
use crate::driver::quality::Marker;
use crate::driver::setup::Setup;
use crate::error::HwError;
use crate::frame::{Frame, Quality};
use crate::recording::{FrameMap, Projection};
use crate::transport::Endpoint;

/// Converts raw frames to frames in protocol order.
pub(super) struct Stream {
    map: Option<FrameMap>,
    marker: Marker,
    value_count: usize,
    complex: bool,
    /// Counter and clock of the epoch's first frame.
    first: Option<(Option<u64>, Option<f64>)>,
    pub(super) epoch: u32,
    pub(super) next_sequence: u64,
    /// Sequence number of the epoch's first frame.
    base: u64,
}

impl Stream {
    pub(super) fn new(
        setup: &Setup,
        settings: &SessionSettings,
        endpoint: &Endpoint,
    ) -> Result<Self, HwError> {
        let map = match &settings.quadruples {
            None => None,
            Some(wanted) => {
                let name = endpoint.to_string();
                let source = Path::new(&name);
                let count = wanted.len();
                Some(FrameMap::new(&setup.layout, setup.value_count, Some(wanted), count, source)?)
            }
        };
        Ok(Self {
            map,
            marker: Marker::new(setup.limits, setup.value_count),
            value_count: setup.value_count,
            complex: setup.complex,
            first: None,
            epoch: 0,
            next_sequence: 0,
            base: 0,
        })
    }

    /// Starts again after a reconnection.
    pub(super) fn renew(&mut self, setup: &Setup) {
        self.marker = Marker::new(setup.limits, setup.value_count);
        self.begin_epoch();
    }

    /// Starts a new epoch, in which counter and clock restart.
    pub(super) fn begin_epoch(&mut self) {
        self.first = None;
        self.epoch = self.epoch.saturating_add(1);
        self.base = self.next_sequence;
    }

    /// Returns the frame and the number of frames lost before it; `None` if it does not match the
    /// set-up.
    pub(super) fn frame(
        &mut self,
        raw: &RawFrame<'_>,
        spare: Option<Frame>,
    ) -> Option<(Frame, u64)> {
        if raw.values.len() != self.value_count
            || raw.imaginary.len() != if self.complex { self.value_count } else { 0 }
        {
            return None;
        }
        let host_time_s =
            SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs_f64());
        self.marker.mark(raw);
        let count = self.map.as_ref().map_or(self.value_count, FrameMap::measurements);
        let mut frame = spare.unwrap_or_else(|| Frame {
            values: vec![0.0; count],
            imaginary: self.complex.then(|| vec![0.0; count]),
            quality: vec![Quality::GOOD; count],
            sequence: 0,
            epoch: 0,
            device_time_s: None,
            host_time_s: None,
        });
        // a frame built elsewhere may have another size
        frame.values.resize(count, 0.0);
        frame.quality.resize(count, Quality::GOOD);
        if self.complex {
            frame.imaginary.get_or_insert_default().resize(count, 0.0);
        } else {
            frame.imaginary = None;
        }
        self.write(raw, &mut frame)?;
        let &mut (first_count, first_time) =
            self.first.get_or_insert((raw.counter, raw.device_time_s));
        let sequence = match (raw.counter, first_count) {
            (Some(counter), Some(first)) => {
                self.base.saturating_add(counter.saturating_sub(first)).max(self.next_sequence)
            }
            _ => self.next_sequence,
        };
        let lost = sequence - self.next_sequence;
        self.next_sequence = sequence.saturating_add(1);
        frame.sequence = sequence;
        frame.epoch = self.epoch;
        frame.device_time_s = raw.device_time_s.zip(first_time).map(|(now, first)| now - first);
        frame.host_time_s = host_time_s;
        Some((frame, lost))
    }

    fn write(&self, raw: &RawFrame<'_>, frame: &mut Frame) -> Option<()> {
        let quality = &self.marker.quality;
        let Some(map) = &self.map else {
            frame.values.copy_from_slice(raw.values);
            frame.quality.copy_from_slice(quality);
            if let Some(imaginary) = &mut frame.imaginary {
                imaginary.copy_from_slice(raw.imaginary);
            }
            return Some(());
        };
        let parts = self.complex.then_some(raw.imaginary);
        let (values, flags) = (&mut frame.values, &mut frame.quality);
        map.apply_into(raw.values, parts, quality, Projection::Real, values, flags).ok()?;
        if let Some(imaginary) = &mut frame.imaginary {
            let projection = Projection::Imaginary;
            map.apply_into(raw.values, parts, quality, projection, imaginary, flags).ok()?;
        }
        Some(())
    }
}
