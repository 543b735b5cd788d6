//! Measures how long no frame has come, and decides whether that is too long.

use std::time::Instant;

use super::settings::SessionSettings;

/// Frame period assumed for an instrument of unknown rate until it can be estimated. Boards that
/// send text take up to a second or two for a frame of 16 electrodes.
const UNKNOWN_PERIOD_S: f64 = 2.0;
/// Number of intervals used to estimate the period. Buffered frames arrive together; with eight
/// intervals, a few of these do not distort the estimate.
const INTERVALS: usize = 8;
/// Frame periods without a frame that make a silence, and a stall.
const SILENCE_PERIODS: f64 = 3.0;
const STALL_PERIODS: f64 = 6.0;

/// Measures how long no frame has come, and decides whether that is too long.
#[derive(Debug)]
pub(super) struct Silence {
    /// Time of the last frame, or of the start.
    since: Instant,
    last_frame: Option<Instant>,
    /// Configured frame period, if any; otherwise it is estimated.
    set_period_s: Option<f64>,
    /// The most recent intervals between frames.
    intervals_s: [f64; INTERVALS],
    counted: usize,
    is_reported: bool,
}

impl Silence {
    pub(super) fn new(frame_rate_hz: Option<f64>) -> Self {
        Self {
            since: Instant::now(),
            last_frame: None,
            set_period_s: frame_rate_hz.filter(|rate| *rate > 0.0).map(f64::recip),
            intervals_s: [0.0; INTERVALS],
            counted: 0,
            is_reported: false,
        }
    }

    /// Called when the instrument was started or restarted; the estimated period is kept.
    pub(super) fn start(&mut self, now: Instant) {
        (self.since, self.last_frame) = (now, None);
    }

    /// Returns the time of the last frame, or of the start.
    pub(super) fn since(&self) -> Instant {
        self.since
    }

    pub(super) fn for_s(&self, now: Instant) -> f64 {
        now.saturating_duration_since(self.since).as_secs_f64()
    }

    /// Returns the frame period.
    fn period_s(&self) -> f64 {
        if let Some(period_s) = self.set_period_s {
            return period_s;
        }
        let mut sorted_s = self.intervals_s;
        sorted_s.sort_unstable_by(f64::total_cmp);
        let [.., second_s, largest_s] = sorted_s;
        // second longest: ignores a single outage, yet with frames in bursts finds the time between
        // bursts, of which there are at least two
        if self.counted < INTERVALS { UNKNOWN_PERIOD_S.max(largest_s) } else { second_s }
    }

    /// Returns the length of the silence if it is to be reported now.
    pub(super) fn begins(&mut self, settings: &SessionSettings, now: Instant) -> Option<f64> {
        let for_s = self.for_s(now);
        if self.is_reported || for_s < settings.silence_s.max(SILENCE_PERIODS * self.period_s()) {
            return None;
        }
        self.is_reported = true;
        Some(for_s)
    }

    pub(super) fn is_stall(&self, settings: &SessionSettings, now: Instant) -> bool {
        self.for_s(now) >= settings.stall_s.max(STALL_PERIODS * self.period_s())
    }

    /// Records a frame; returns the length of the silence before it if that was reported.
    pub(super) fn frame(&mut self, now: Instant) -> Option<f64> {
        if let Some(last) = self.last_frame {
            let interval_s = now.saturating_duration_since(last).as_secs_f64();
            self.intervals_s[self.counted % INTERVALS] = interval_s;
            // stays full, and at the same place of the ring
            self.counted =
                if self.counted + 1 == 2 * INTERVALS { INTERVALS } else { self.counted + 1 };
        }
        let reported_s = self.end(now);
        self.last_frame = Some(now);
        reported_s
    }

    /// Ends a silence, at a frame or when the connection ends; returns its length if it was
    /// reported.
    pub(super) fn end(&mut self, now: Instant) -> Option<f64> {
        let for_s = self.for_s(now);
        self.since = now;
        std::mem::take(&mut self.is_reported).then_some(for_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Feeds frames at these intervals, polling every 10 ms as a reader does; returns the reported
    /// silences, whether a stall was found, and the final time.
    fn reported(
        silence: &mut Silence,
        from: Instant,
        intervals_s: &[f64],
    ) -> (Vec<f64>, bool, Instant) {
        let settings = SessionSettings::default();
        let (mut now, mut reported, mut stalled) = (from, Vec::new(), false);
        for &interval_s in intervals_s {
            for _ in 0..(100.0 * interval_s).round() as usize {
                now += Duration::from_millis(10);
                reported.extend(silence.begins(&settings, now));
                stalled |= silence.is_stall(&settings, now);
            }
            silence.frame(now);
        }
        (reported, stalled, now)
    }

    fn at_rest(frame_rate_hz: Option<f64>) -> (Silence, Instant) {
        let (mut silence, start) = (Silence::new(frame_rate_hz), Instant::now());
        silence.start(start);
        (silence, start)
    }

    #[test]
    fn slow_boards_are_neither_silent_nor_stalled() {
        for period_s in [0.6, 1.0, 2.5, 4.0] {
            let (mut silence, start) = at_rest(None);
            // buffered frames arrive together
            let intervals_s: Vec<f64> = [0.0, 0.0].into_iter().chain([period_s; 20]).collect();
            let (reported, stalled, end) = reported(&mut silence, start, &intervals_s);
            assert!(reported.is_empty() && !stalled, "{period_s} s: {reported:?}, {stalled}");
            // then it falls silent: reported after three frame periods, set up again after six
            let settings = SessionSettings::default();
            let after = |periods: f64| end + Duration::from_secs_f64(periods * period_s);
            assert_eq!(silence.begins(&settings, after(2.9)), None);
            assert!(silence.begins(&settings, after(3.1)).is_some());
            assert!(!silence.is_stall(&settings, after(5.9)));
            assert!(silence.is_stall(&settings, after(6.1)));
        }
    }

    #[test]
    fn fast_boards_are_silent_after_half_a_second_once_their_rate_was_seen() {
        let (mut silence, start) = at_rest(None);
        let intervals_s = [vec![0.1; 20], vec![10.0], vec![0.1; 20], vec![1.0]].concat();
        let (reported, stalled, _) = reported(&mut silence, start, &intervals_s);
        // one outage of 10 s does not hide the next one of 1 s
        assert_eq!(reported.len(), 2, "{reported:?}");
        // polled every 10 ms
        assert!(
            reported.iter().all(|reported_s| (0.5..0.515).contains(reported_s)),
            "{reported:?}"
        );
        assert!(stalled);
    }

    #[test]
    fn a_rate_that_changes_is_learnt_again() {
        let (mut silence, start) = at_rest(None);
        let intervals_s = [vec![0.1; 20], vec![1.5; 10]].concat();
        let (reported, ..) = reported(&mut silence, start, &intervals_s);
        // the first two slow frames are reported: one long interval alone might be an outage
        assert_eq!(reported.len(), 2, "{reported:?}");
    }

    #[test]
    fn frames_in_bursts_are_no_silence() {
        let (mut silence, start) = at_rest(None);
        let intervals_s = [1.0, 0.0, 0.0].repeat(10);
        let (reported, stalled, _) = reported(&mut silence, start, &intervals_s);
        assert!(reported.is_empty() && !stalled, "{reported:?}");
    }

    #[test]
    fn a_rate_that_was_set_holds_from_the_start() {
        for (rate_hz, wanted_s) in [(100.0, 0.5), (2.0, 1.5)] {
            let (mut silence, start) = at_rest(Some(rate_hz));
            let settings = SessionSettings::default();
            let after = |for_s: f64| start + Duration::from_secs_f64(for_s);
            assert_eq!(silence.begins(&settings, after(wanted_s - 0.01)), None);
            assert!(silence.begins(&settings, after(wanted_s + 0.01)).is_some());
            // reported once
            assert_eq!(silence.begins(&settings, after(wanted_s + 1.0)), None);
            assert!(silence.frame(after(4.0)).is_some_and(|for_s| (for_s - 4.0).abs() < 1e-9));
            assert_eq!(silence.frame(after(4.1)), None);
        }
    }
}
