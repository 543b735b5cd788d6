//! Converts raw frames to frames in protocol order.

use std::time::{SystemTime, UNIX_EPOCH};

use super::settings::SessionSettings;
use crate::driver::decoded::RawFrame;
use crate::driver::quality::Marker;
use crate::driver::setup::Setup;
use crate::error::HwError;
use crate::frame::Frame;
use crate::recording::{FrameMap, Layout};
use crate::transport::Endpoint;

/// Converts raw frames to frames in protocol order.
pub(super) struct Stream {
    map: FrameMap,
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
        let (name, count) = (endpoint.to_string(), setup.value_count);
        let map = match settings.quadruples.as_deref() {
            // as the instrument sends them
            None => FrameMap::new(&Layout::ProtocolOrder, count, None, count, &name)?,
            wanted @ Some(list) => FrameMap::new(&setup.layout, count, wanted, list.len(), &name)?,
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
        // a frame built elsewhere may have another size
        let mut frame = spare.unwrap_or_else(|| Frame::new(0, Vec::new()));
        let imaginary = self.complex.then_some(raw.imaginary);
        self.map.apply(raw.values, imaginary, &self.marker.quality, &mut frame).ok()?;
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
}
