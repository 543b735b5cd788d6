//! Tracking of blobs from image to image.

use super::assign::Assignment;
use super::contact::{Touch, TouchState};
use super::filter::Filter;
use super::noise::NoiseFloor;
use super::segment::{Segmenter, Spot};
use super::settings::TouchStreamSettings;
use crate::geometry::distance_m;

/// Cost of a forbidden pair: above any sum of gates.
const NEVER: f64 = 1e7;

/// A blob tracked over time; it has no id until it is confirmed.
#[derive(Debug, Clone, Copy)]
struct Track {
    id: Option<u64>,
    filter: Filter,
    spot: Spot,
    /// Whether each of the last images showed the touch, one bit per image, the current one lowest.
    shown: u32,
    /// Images since the first one.
    frames: u64,
    missed: usize,
    begin: Option<(u64, f64)>,
    split_from: Option<u64>,
    merged_into: Option<u64>,
    ended: bool,
    /// Index of its spot in this image.
    matched: Option<usize>,
}

/// Follows blobs; [`run`](Self::run) does not allocate.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    tracks: Vec<Track>,
    assignment: Assignment,
    taken: Vec<bool>,
    /// Id of the touch whose blob contained each cell; 0 for none.
    owner: Vec<u64>,
    /// Whether any cell may be owned.
    owned: bool,
    next_id: u64,
    capacity: usize,
    pub(super) touches: Vec<Touch>,
}

impl Tracker {
    pub(super) fn new(cells: usize, most: usize) -> Self {
        // as many again may be waiting for confirmation or for their end
        let capacity = 2 * most;
        Self {
            tracks: Vec::with_capacity(capacity),
            assignment: Assignment::new(capacity, most + capacity),
            taken: vec![false; most],
            owner: vec![0; cells],
            owned: false,
            next_id: 1,
            capacity,
            touches: Vec::with_capacity(capacity),
        }
    }

    /// Processes the blobs of one image, `dt` seconds after the previous image.
    pub(super) fn run(
        &mut self,
        segmenter: &Segmenter,
        time_s: f64,
        dt: f64,
        settings: &TouchStreamSettings,
        effective_cells: f64,
    ) {
        self.tracks.retain(|track| !track.ended);
        for track in &mut self.tracks {
            track.filter.predict(dt, settings.acceleration_m_s2);
            track.frames += 1;
            track.shown <<= 1;
        }
        self.pair(&segmenter.spots, settings);
        self.pair_by_area(segmenter, settings);
        self.misses(segmenter, settings);
        self.births(&segmenter.spots, settings);
        self.confirm(time_s, settings);
        self.own(segmenter);
        self.report(time_s, settings, effective_cells);
    }

    /// Pairs tracks and blobs with the largest likelihood, each pair within the gate.
    fn pair(&mut self, spots: &[Spot], settings: &TouchStreamSettings) {
        let tracks = &self.tracks;
        let (rows, count) = (tracks.len(), spots.len());
        self.taken.fill(false);
        let columns = self.assignment.solve(rows, count + rows, |row, column| {
            match spots.get(column) {
                // its own column leaves a track unmatched; tracks with an id come first
                None if column - count == row => {
                    settings.gate * if tracks[row].id.is_some() { 2.0 } else { 1.0 }
                }
                None => NEVER,
                Some(spot) => {
                    let covariance = measured(spot, settings);
                    let distance = tracks[row].filter.distance(spot.position_m, &covariance);
                    if distance <= settings.gate { distance } else { NEVER }
                }
            }
        });
        for (track, &column) in self.tracks.iter_mut().zip(columns) {
            track.matched = (column < count).then_some(column);
            let Some(spot) = track.matched.map(|column| spots[column]) else { continue };
            self.taken[column] = true;
            track.filter.update(spot.position_m, &measured(&spot, settings));
            track.spot = spot;
            track.shown |= 1;
            track.missed = 0;
            track.merged_into = None;
        }
    }

    /// Pairs the remaining named tracks and blobs, nearest first, if the blob covers the track or has split
    /// off its area.
    ///
    /// When two touches merge into one blob or separate, its centre moves farther than any gate. The track
    /// restarts at the blob's position, at rest.
    fn pair_by_area(&mut self, segmenter: &Segmenter, settings: &TouchStreamSettings) {
        loop {
            let mut nearest: Option<(f64, usize, usize)> = None;
            let waiting = |t: &(usize, &Track)| t.1.matched.is_none() && t.1.id.is_some();
            for (at, track) in self.tracks.iter().enumerate().filter(waiting) {
                let hill = segmenter.hill_at(track.filter.position_m);
                let left = |s: &(usize, &Spot)| !self.taken[s.0];
                for (k, spot) in segmenter.spots.iter().enumerate().filter(left) {
                    let owner = Some(self.owner[spot.top]);
                    if hill != Some(spot.hill) && owner != track.id && owner != track.merged_into {
                        continue;
                    }
                    let way = distance_m(spot.position_m, track.filter.position_m);
                    if nearest.is_none_or(|(least, _, _)| way < least) {
                        nearest = Some((way, at, k));
                    }
                }
            }
            let Some((_, at, k)) = nearest else { return };
            let (track, spot) = (&mut self.tracks[at], segmenter.spots[k]);
            let covariance = measured(&spot, settings);
            track.filter = Filter::new(spot.position_m, covariance, settings.velocity_std_m_s);
            track.matched = Some(k);
            track.spot = spot;
            track.shown |= 1;
            track.missed = 0;
            track.merged_into = None;
            self.taken[k] = true;
        }
    }

    /// Handles tracks without a blob: merged into another touch's blob, forgiven, or ended.
    fn misses(&mut self, segmenter: &Segmenter, settings: &TouchStreamSettings) {
        for at in 0..self.tracks.len() {
            if self.tracks[at].matched.is_some() {
                continue;
            }
            let hill = segmenter.hill_at(self.tracks[at].filter.position_m);
            let host = self.tracks.iter().find(|other| {
                let spot = other.matched.map(|k| &segmenter.spots[k]);
                other.id.is_some() && spot.is_some_and(|spot| Some(spot.hill) == hill)
            });
            let merged_into = host.and_then(|host| host.id);
            let track = &mut self.tracks[at];
            track.missed += 1;
            track.merged_into = merged_into.or(track.merged_into);
            // without a blob there is no evidence of motion
            track.filter.rest(settings.velocity_std_m_s);
            let hits = track.shown.count_ones() as usize;
            let left = settings.birth_frames.saturating_sub(track.frames as usize + 1);
            track.ended = match track.id {
                None => hits + left < settings.birth_hits,
                Some(_) => track.missed > settings.forgiven_frames,
            };
        }
        // tracks that were never reported end silently
        self.tracks.retain(|track| track.id.is_some() || !track.ended);
    }

    /// Starts tracks from unmatched blobs.
    fn births(&mut self, spots: &[Spot], settings: &TouchStreamSettings) {
        for (at, spot) in spots.iter().enumerate().filter(|(at, _)| !self.taken[*at]) {
            if self.tracks.len() == self.capacity {
                return;
            }
            let owner = self.owner[spot.top];
            let covariance = measured(spot, settings);
            self.tracks.push(Track {
                id: None,
                filter: Filter::new(spot.position_m, covariance, settings.velocity_std_m_s),
                spot: *spot,
                shown: 1,
                frames: 0,
                missed: 0,
                begin: None,
                split_from: (owner != 0).then_some(owner),
                merged_into: None,
                ended: false,
                matched: Some(at),
            });
        }
    }

    /// Gives an id to tracks that enough of their first images have shown.
    fn confirm(&mut self, time_s: f64, settings: &TouchStreamSettings) {
        let named = self.tracks.iter().filter(|track| track.id.is_some() && !track.ended).count();
        let mut free = settings.max_touches.saturating_sub(named);
        for track in self.tracks.iter_mut().filter(|track| track.id.is_none()) {
            if track.shown.count_ones() as usize >= settings.birth_hits && free > 0 {
                track.id = Some(self.next_id);
                track.begin = Some((track.frames, time_s));
                self.next_id += 1;
                free -= 1;
            }
        }
    }

    /// Marks the cells of touches that have an id.
    fn own(&mut self, segmenter: &Segmenter) {
        if std::mem::replace(&mut self.owned, !segmenter.watershed.is_empty()) {
            self.owner.fill(0);
        }
        for cell in segmenter.watershed.cells() {
            let hill = segmenter.watershed.hill(cell);
            let track = self.tracks.iter().find(|t| t.missed == 0 && t.spot.hill == hill);
            self.owner[cell] = track.and_then(|track| track.id).unwrap_or(0);
        }
    }

    fn report(&mut self, time_s: f64, settings: &TouchStreamSettings, effective_cells: f64) {
        self.touches.clear();
        for track in &self.tracks {
            let (Some(id), Some((born, begin_s))) = (track.id, track.begin) else { continue };
            let state = match (track.ended, track.frames == born) {
                (true, _) => TouchState::End,
                (false, true) => TouchState::Begin,
                (false, false) => TouchState::Hold,
            };
            let span = settings.birth_frames.min(track.frames as usize + 1);
            // the shift stays within 32 bits
            let recent = track.shown & (u32::MAX >> (32 - span.clamp(1, 32)));
            let share = f64::from(recent.count_ones()) / span as f64;
            let chance = NoiseFloor::exceedance(effective_cells, track.spot.level);
            let spread = (0..3).map(|i| track.filter.pp[i][i]).fold(0.0, f64::max);
            self.touches.push(Touch {
                id,
                state,
                position_m: track.filter.position_m,
                normal: None,
                position_covariance_m2: track.filter.pp,
                velocity_m_s: track.filter.velocity_m_s,
                area_m2: Some(track.spot.area_m2),
                intensity_s_m2: track.spot.integral,
                intensity_std_s_m2: None,
                peak_s: track.spot.peak,
                learnt: None,
                confidence: (1.0 - chance) * share,
                age_frames: track.frames - born,
                age_s: time_s - begin_s,
                valid: track.missed == 0 && spread.sqrt() <= settings.max_position_std_m,
                whole: true,
                split_from: track.split_from,
                merged_into: track.merged_into,
            });
        }
        self.touches.sort_unstable_by_key(|touch| touch.id);
    }
}

/// Covariance of a measured position: the image's noise and the method's own error.
fn measured(spot: &Spot, settings: &TouchStreamSettings) -> [[f64; 3]; 3] {
    let mut covariance = spot.covariance_m2;
    (0..3).for_each(|i| covariance[i][i] += settings.method_std_m.powi(2));
    covariance
}
