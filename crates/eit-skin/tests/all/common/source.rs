//! A source of events that a test lists.

use eit_skin::eit_hw::driver::{Event, FrameSource, Identity, Limits, Setup, Statistics};
use eit_skin::eit_hw::{Frame, HwError, Layout, Unit};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Gives all of its events at once: the consumer is behind until the last one.
pub struct Listed {
    setup: Setup,
    events: VecDeque<Event>,
    hold: Option<(u64, Arc<AtomicBool>)>,
}

impl Listed {
    /// Events with frames of 20 Hz, volts.
    pub fn new(events: impl IntoIterator<Item = Event>) -> Self {
        let events: VecDeque<Event> = events.into_iter().collect();
        let values = |event: &Event| match event {
            Event::Frame(frame) => Some(frame.values.len()),
            _ => None,
        };
        let setup = Setup {
            identity: Identity { driver: "test", name: String::new(), serial: String::new() },
            layout: Layout::ProtocolOrder,
            value_count: events.iter().find_map(values).unwrap(),
            complex: false,
            unit: Unit::Volt,
            frame_rate_hz: Some(20.0),
            limits: Limits::default(),
        };
        Self { setup, events, hold: None }
    }

    /// Repeats the frame with this number each millisecond until `is_over` is set.
    pub fn held_at(self, sequence: u64, is_over: &Arc<AtomicBool>) -> Self {
        Self { hold: Some((sequence, Arc::clone(is_over))), ..self }
    }
}

impl FrameSource for Listed {
    fn setup(&self) -> &Setup {
        &self.setup
    }

    fn next_event(&mut self, _: Duration) -> Result<Option<Event>, HwError> {
        if let (Some((sequence, is_over)), Some(Event::Frame(frame))) =
            (&self.hold, self.events.front())
            && frame.sequence == *sequence
        {
            if !is_over.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
                return Ok(Some(Event::Frame(frame.clone())));
            }
            self.events.pop_front();
        }
        Ok(self.events.pop_front())
    }

    fn recycle(&mut self, _: Frame) {}

    fn statistics(&self) -> Statistics {
        Statistics::default()
    }

    fn frames_waiting(&self) -> usize {
        self.events.len()
    }

    fn is_over(&self) -> bool {
        self.events.is_empty()
    }
}
