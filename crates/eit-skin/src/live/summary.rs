//! What happened while watching, in bounded memory.

use super::{ImageState, LiveFrame, LiveImages};
use crate::faults::ElectrodeFault;
use eit_inverse::touch::{Touch, TouchState};
use serde_json::{Value, json};

/// Latencies that the summary is made of: the last ones.
const LATENCIES: usize = 10_000;
/// Notices that are kept: the first ones; a line that breaks all day says the same again and again.
const NOTICES: usize = 100;

/// What happened.
#[derive(Debug, Default)]
pub struct Summary {
    /// Frames that were shown.
    pub frames: u64,
    /// References taken.
    pub references: u64,
    /// Touches that began.
    pub touches: u64,
    /// Most at once.
    pub most_at_once: usize,
    /// How the images are made, with the weights of the last epoch.
    pub images: String,
    /// Images that did not explain their measurements, so that the raw one was shown.
    pub aside: u64,
    /// Frames that no image explains within `delta`.
    pub interpolated: u64,
    /// Frames with bad values, which electrodes that move leave without an image.
    pub lost: u64,
    /// Frames whose image was skipped because further frames waited.
    pub skipped_images: u64,
    /// Largest proven gap of an image.
    pub worst_gap: Option<f64>,
    /// Faults of electrodes, in the order in which they were found: the first ones.
    pub faults: Vec<ElectrodeFault>,
    /// The last latencies of touches, seconds, in no order.
    pub latencies_s: Vec<f64>,
    /// The same of images.
    pub image_latencies_s: Vec<f64>,
    /// From the first frame shown to the last, seconds of this computer's clock.
    pub span_s: f64,
    /// The first things that the source said.
    pub notices: Vec<String>,
    /// How many it said after them.
    pub more_notices: u64,
}

impl Summary {
    /// Latency from a frame's last byte to its touches that this share of the frames, 0 to 1, did not
    /// exceed.
    pub fn latency_s(&self, share: f64) -> Option<f64> {
        quantile(&self.latencies_s, share)
    }

    /// The same to its image.
    pub fn image_latency_s(&self, share: f64) -> Option<f64> {
        quantile(&self.image_latencies_s, share)
    }

    /// How the images came about, for people.
    pub fn images_words(&self) -> String {
        let mut words = self.images.clone();
        if let Some(gap) = self.worst_gap {
            words += &format!(", proven to within {:.1} % of the optimum", 100.0 * gap.max(0.0));
        }
        if self.aside > 0 {
            words += &format!(
                "; {} of the net do not explain their measurements: there the raw image stays",
                self.aside
            );
        }
        if self.interpolated > 0 {
            words +=
                &format!("; {} frames fit no image within delta: passed over", self.interpolated);
        }
        if self.lost > 0 {
            words += &format!(
                "; {} frames have bad values and no image: electrode_movement_m mixes measurements",
                self.lost
            );
        }
        if self.skipped_images > 0 {
            words += &format!(
                "; {} frames have no image, as this computer could not keep up (touches are never skipped)",
                self.skipped_images
            );
        }
        words
    }

    /// The same for programs.
    pub fn images_json(&self) -> Value {
        json!({
            "how": self.images,
            "worst_gap": self.worst_gap,
            "put_aside": self.aside,
            "beyond_delta": self.interpolated,
            "lost": self.lost,
            "skipped": self.skipped_images,
        })
    }

    fn take(&mut self, touches: &[Touch], state: ImageState, latency_s: Option<f64>) {
        self.frames += 1;
        let of = |state| touches.iter().filter(|touch| touch.state == state).count();
        self.touches += of(TouchState::Begin) as u64;
        self.most_at_once = self.most_at_once.max(touches.len() - of(TouchState::End));
        self.aside += u64::from(state.is_aside);
        self.interpolated += u64::from(state.is_interpolated);
        self.lost += u64::from(state.is_lost);
        if let Some(gap) = state.gap {
            self.worst_gap = Some(self.worst_gap.map_or(gap, |worst| worst.max(gap)));
        }
        remember(&mut self.latencies_s, self.frames, latency_s);
    }

    /// Takes note of a frame, its image made.
    pub(crate) fn take_frame(&mut self, shown: &LiveFrame<'_>) {
        let state = shown.images.map(LiveImages::state).unwrap_or_default();
        self.take(shown.touches, state, shown.latency_s);
        self.take_faults(shown.faults);
        remember(&mut self.image_latencies_s, self.frames, shown.image_latency_s);
    }

    /// Remembers faults that are new.
    fn take_faults(&mut self, faults: &[ElectrodeFault]) {
        for fault in faults {
            if self.faults.len() < NOTICES && !self.faults.contains(fault) {
                self.faults.push(*fault);
            }
        }
    }

    /// The faults for programs.
    pub fn faults_json(&self) -> Value {
        self.faults.iter().map(ElectrodeFault::json).collect()
    }

    pub(crate) fn say(&mut self, words: String) {
        if self.notices.len() < NOTICES {
            self.notices.push(words);
        } else {
            self.more_notices += 1;
        }
    }
}

/// Keeps the last ones.
fn remember(latencies_s: &mut Vec<f64>, frame: u64, latency_s: Option<f64>) {
    let Some(latency_s) = latency_s else { return };
    if latencies_s.len() == LATENCIES {
        latencies_s[(frame % LATENCIES as u64) as usize] = latency_s;
    } else {
        latencies_s.push(latency_s);
    }
}

fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let index = (share * sorted.len() as f64) as usize;
    sorted.get(index.min(sorted.len().saturating_sub(1))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source that complains for ever fills no memory.
    #[test]
    fn notices_and_latencies_are_bounded() {
        let mut summary = Summary::default();
        for number in 0..NOTICES + 900 {
            summary.say(format!("notice {number}"));
        }
        assert_eq!((summary.notices.len(), summary.more_notices), (NOTICES, 900));
        assert_eq!(summary.notices[0], "notice 0");
        for number in 0..3 * LATENCIES {
            summary.take(&[], ImageState::default(), Some(number as f64));
        }
        assert_eq!(summary.latencies_s.len(), LATENCIES);
        // the last ones
        assert!(summary.latencies_s.iter().all(|&s| s >= (2 * LATENCIES) as f64));
    }
}
