//! What is known of every patch: touches, silence, losses, clock. Knows no network, so that tests set the time.

use super::clock::ClockOffset;
use super::latency::Latency;
use super::{BodySettings, Placement};
use crate::ros::{
    Attachment, BodyTouch, BodyTouchArray, DiagnosticStatus, Header, PatchState, Time, TouchArray,
    TouchMessage, skin_state, touch_state,
};
use eit_skin::SkinState;
use std::time::{Duration, Instant};

/// A stamp that is further from the time of sending than this, seconds, is not of now (a replay): the time of
/// sending counts.
const OLD_S: f64 = 10.0;

/// Time for which a second publisher counts after its last message.
const STALE: Duration = Duration::from_secs(2);

/// Least delays that clocks which agree can have, seconds: a transfer takes some time, and less than this.
const DELAYS_S: std::ops::Range<f64> = -1e-3..0.05;

/// Something that a body reports.
#[derive(Debug, Clone, PartialEq)]
pub enum BodyNews {
    /// Touches of all patches that are not silent.
    Touches(BodyTouches),
    /// A patch has been silent for too long; its touches are no longer listed.
    Silent {
        /// Its number in the settings.
        patch: usize,
        /// Time since its last message, or since the start.
        for_s: f64,
        /// Whether it was ever heard.
        was_heard: bool,
    },
    /// A silent patch is heard again.
    Back {
        /// Its number in the settings.
        patch: usize,
        /// Length of the silence.
        after_s: f64,
    },
    /// What is known of the skin of a patch has changed; not told when a patch is heard first or again and sound.
    State {
        /// Its number in the settings.
        patch: usize,
        /// What is known now.
        state: SkinState,
    },
    /// Two programs publish one patch: the one that was heard first is listened to until it is silent. Reported once.
    TwoPublishers {
        /// Its number in the settings.
        patch: usize,
    },
    /// The messages of a patch cannot be read: they have another version. Reported once.
    Unreadable {
        /// Its number in the settings.
        patch: usize,
        /// Description of the problem.
        reason: String,
    },
}

/// The joined list.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct BodyTouches {
    /// Time by this computer's clock, seconds since 1970.
    pub time_s: f64,
    /// Touches in the robot's frame.
    pub touches: Vec<PlacedTouch>,
}

/// A touch in the robot's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PlacedTouch {
    /// Number of its patch in the settings.
    pub patch: usize,
    /// Number of the patch's connection to its instrument.
    pub epoch: u32,
    /// Time of its frame, converted to this computer's clock, seconds since 1970.
    pub time_s: f64,
    /// Touch in the frame named above.
    pub touch: TouchMessage,
}

/// When a message was sent and when it arrived.
#[derive(Debug, Clone, Copy)]
pub struct Origin {
    /// Number and time of sending.
    pub attachment: Attachment,
    /// When it arrived.
    pub arrived: Instant,
    /// Arrival by this computer's clock, seconds since 1970.
    pub arrived_s: f64,
}

#[derive(Debug)]
struct Patch {
    /// Number of the patch in the settings.
    number: usize,
    name: String,
    placement: Placement,
    touches: Vec<PlacedTouch>,
    /// Last message, or the start.
    heard: Instant,
    was_heard: bool,
    is_silent: bool,
    /// Publisher and number of the last message.
    last: Option<([u8; 16], i64)>,
    received: u64,
    lost: u64,
    clock: ClockOffset,
    is_unreadable: bool,
    /// When a second publisher was heard last.
    second: Option<Instant>,
    state: SkinState,
}

/// Joins the messages of all patches.
#[derive(Debug)]
pub struct BodyState {
    patches: Vec<Patch>,
    frame_id: String,
    silent_after: Duration,
    has_changed: bool,
    /// Sending times of messages that are not in a list yet, seconds.
    unlisted: Vec<f64>,
    latency: Latency,
}

impl BodyState {
    /// Creates the state before any message; silence is measured from `now`.
    pub fn new(settings: &BodySettings, now: Instant) -> Self {
        let patch = |(number, patch): (usize, &super::PatchSettings)| Patch {
            number,
            name: patch.name.clone(),
            placement: patch.placement,
            touches: Vec::new(),
            heard: now,
            was_heard: false,
            is_silent: false,
            last: None,
            received: 0,
            lost: 0,
            clock: ClockOffset::default(),
            is_unreadable: false,
            second: None,
            state: SkinState::NoData,
        };
        Self {
            patches: settings.patches.iter().enumerate().map(patch).collect(),
            frame_id: settings.frame_id.clone(),
            silent_after: settings.silent_after,
            has_changed: false,
            unlisted: Vec::new(),
            latency: Latency::default(),
        }
    }

    /// Processes a message of a patch; reports the patch if it had been silent, or its skin is in another state.
    pub fn receive(
        &mut self,
        number: usize,
        message: &TouchArray,
        origin: &Origin,
        news: &mut impl Extend<BodyNews>,
    ) {
        let silent_after = self.silent_after;
        let Some(patch) = self.patches.get_mut(number) else { return };
        let silence = origin.arrived.saturating_duration_since(patch.heard);
        let Attachment { sequence, time_ns, gid } = origin.attachment;
        match patch.last {
            // older than what is known: the network has changed the order
            Some((publisher, last)) if publisher == gid && sequence <= last => return,
            Some((publisher, last)) if publisher == gid => {
                patch.lost += sequence.abs_diff(last).saturating_sub(1);
            }
            // the first message, or a patch that was started anew
            None => {}
            Some(_) if silence >= silent_after || patch.state == SkinState::NoData => {}
            Some(_) => {
                if patch.second.replace(origin.arrived).is_none() {
                    news.extend([BodyNews::TwoPublishers { patch: number }]);
                }
                return;
            }
        }
        patch.last = Some((gid, sequence));
        patch.received += 1;
        let sent_s = 1e-9 * time_ns as f64;
        patch.clock.observe(sent_s, origin.arrived_s);
        patch.heard = origin.arrived;
        patch.was_heard = true;
        let was_silent = std::mem::replace(&mut patch.is_silent, false);
        let state = skin_state::of(message.state);
        let before = std::mem::replace(&mut patch.state, state);
        self.has_changed |= patch.take(message, sent_s);
        self.unlisted.push(sent_s);
        if !self.has_changed {
            self.listed(origin.arrived_s);
        }
        if was_silent {
            news.extend([BodyNews::Back { patch: number, after_s: silence.as_secs_f64() }]);
        }
        if (state, before) != (SkinState::Sound, SkinState::NoData) && state != before {
            news.extend([BodyNews::State { patch: number, state }]);
        }
    }

    /// Reports the first unreadable message of each patch.
    pub fn unreadable(&mut self, number: usize, reason: String) -> Option<BodyNews> {
        let patch = self.patches.get_mut(number)?;
        let was_unreadable = std::mem::replace(&mut patch.is_unreadable, true);
        (!was_unreadable).then_some(BodyNews::Unreadable { patch: number, reason })
    }

    /// Reports patches that have fallen silent, and ends their touches.
    pub fn silences(&mut self, now: Instant, news: &mut impl Extend<BodyNews>) {
        for (number, patch) in self.patches.iter_mut().enumerate() {
            let silence = now.saturating_duration_since(patch.heard);
            if patch.is_silent || silence < self.silent_after {
                continue;
            }
            (patch.is_silent, patch.state) = (true, SkinState::NoData);
            self.has_changed |= !patch.touches.is_empty();
            for placed in &mut patch.touches {
                (placed.touch.state, placed.touch.valid) = (touch_state::END, false);
            }
            let (for_s, was_heard) = (silence.as_secs_f64(), patch.was_heard);
            news.extend([BodyNews::Silent { patch: number, for_s, was_heard }]);
        }
    }

    /// Returns whether anything has changed since the last list.
    pub fn has_changed(&self) -> bool {
        self.has_changed
    }

    /// Builds the list of touches. A touch that has ended is listed once more.
    pub fn list(&mut self, now_s: f64) -> BodyTouches {
        self.has_changed = false;
        self.listed(now_s);
        let mut touches = Vec::new();
        for patch in &mut self.patches {
            touches.extend_from_slice(&patch.touches);
            patch.touches.retain(|placed| placed.touch.state != touch_state::END);
        }
        BodyTouches { time_s: now_s, touches }
    }

    /// Converts a list of touches to a ROS 2 message.
    pub fn message(&self, list: &BodyTouches, now: Instant) -> BodyTouchArray {
        let stamp = Time::from_seconds(list.time_s);
        let touch = |placed: &PlacedTouch| BodyTouch {
            patch: self.name(placed.patch).to_owned(),
            epoch: placed.epoch,
            stamp: Time::from_seconds(placed.time_s),
            touch: placed.touch,
        };
        BodyTouchArray {
            header: Header { stamp, frame_id: self.frame_id.clone() },
            patches: self.states(now),
            touches: list.touches.iter().map(touch).collect(),
        }
    }

    /// State of every patch.
    pub fn states(&self, now: Instant) -> Vec<PatchState> {
        let state = |patch: &Patch| PatchState {
            name: patch.name.clone(),
            silent: patch.is_silent || !patch.was_heard,
            state: skin_state::number(patch.state),
            age: match patch.was_heard {
                true => now.saturating_duration_since(patch.heard).as_secs_f64(),
                false => f64::NAN,
            },
            received: patch.received,
            lost: patch.lost,
        };
        self.patches.iter().map(state).collect()
    }

    /// Names the patches whose touches are not known; `None` if all are.
    pub(super) fn not_known(&self) -> Option<String> {
        let why = |patch: &Patch| {
            let why = patch.state.why_not_known();
            why.map(|why| format!("{} not known: {why}", patch.name))
        };
        let lines: Vec<String> = self.patches.iter().filter_map(why).collect();
        (!lines.is_empty()).then(|| lines.join("\n"))
    }

    /// How every patch is.
    pub fn diagnostics(&self, now: Instant) -> Vec<DiagnosticStatus> {
        let status = |patch: &Patch| {
            let silence = now.saturating_duration_since(patch.heard);
            let has_two = patch.second.is_some_and(|second| now - second < STALE);
            let (level, message) = match patch.state.why_not_known() {
                _ if patch.is_unreadable => (2, "its messages have another version".to_owned()),
                _ if !patch.was_heard => (3, "not heard yet".to_owned()),
                _ if patch.is_silent => (3, format!("silent for {:.1} s", silence.as_secs_f64())),
                _ if has_two => (1, "two programs publish it; one is listened to".to_owned()),
                Some(why) => (1, why.to_owned()),
                None => (0, "sound".to_owned()),
            };
            DiagnosticStatus {
                level,
                name: format!("body: {}", patch.name),
                message,
                ..DiagnosticStatus::default()
            }
        };
        self.patches.iter().map(status).collect()
    }

    /// Returns the name of a patch, from the settings.
    pub fn name(&self, number: usize) -> &str {
        self.patches.get(number).map_or("", |patch| &patch.name)
    }

    /// Returns the latencies from sending by the patch to the list with the message (for heartbeats, to being
    /// read); `None` where the clock of a patch's computer differs from this one's, so that they say nothing.
    pub fn latency(&self) -> Option<&Latency> {
        let mut delays_s = self.patches.iter().filter_map(|patch| patch.clock.offset_s());
        delays_s.all(|delay_s| DELAYS_S.contains(&delay_s)).then_some(&self.latency)
    }

    /// Forgets the latencies so far.
    pub fn reset_latency(&mut self) {
        self.latency = Latency::default();
    }

    fn listed(&mut self, now_s: f64) {
        for sent_s in self.unlisted.drain(..) {
            self.latency.add(now_s - sent_s);
        }
    }
}

impl Patch {
    /// Replaces the touches of the patch; returns whether that changes the list.
    fn take(&mut self, message: &TouchArray, sent_s: f64) -> bool {
        let stamp_s = message.header.stamp.seconds();
        let stamp_s = if (stamp_s - sent_s).abs() < OLD_S { stamp_s } else { sent_s };
        let time_s = stamp_s + self.clock.offset_s().unwrap_or(0.0);
        let had_touches = !self.touches.is_empty();
        // an end that nobody was told of stays until the next list
        let is_listed = |placed: &PlacedTouch| {
            let is_same = |touch: &TouchMessage| touch.id == placed.touch.id;
            placed.epoch == message.epoch && message.touches.iter().any(is_same)
        };
        self.touches.retain(|placed| placed.touch.state == touch_state::END && !is_listed(placed));
        let (patch, placement, epoch) = (self.number, self.placement, message.epoch);
        self.touches.extend(message.touches.iter().map(|touch| PlacedTouch {
            patch,
            epoch,
            time_s,
            touch: placement.place(touch),
        }));
        had_touches || !message.touches.is_empty()
    }
}
