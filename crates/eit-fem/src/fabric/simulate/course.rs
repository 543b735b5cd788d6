//! The course of a simulation: what the fabric remembers, the instrument, and how instants become frames.

use super::clock::Clock;
use super::instant::{Instant, Worker, each};
use super::linearised::Linearised;
use super::plan::Plan;
use super::view::View;
use crate::error::FemError;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::instrument::{Channels, Loose};
use crate::fabric::truth::TrueQuality;
use crate::solve::SolveReport;

/// How voltages follow from a touched fabric.
pub(super) enum Response {
    /// By a full solve on the moved mesh, one worker per thread.
    Full(Vec<Worker>),
    /// By the derivatives of the untouched skin.
    Linearised(Box<Linearised>),
}

/// State of a simulation.
pub(super) struct Course {
    pub plan: Plan,
    pub clock: Clock,
    pub channels: Channels,
    /// Exact voltages of the untouched skin with all contacts intact, and the report of their solve.
    pub reference_v: Vec<f64>,
    pub untouched: SolveReport,
    seed: u64,
    loose: Vec<Loose>,
    /// Of each element.
    memory: Vec<f64>,
    /// The last instant before, then those of the next frames.
    instants: Vec<Instant>,
    /// Number of finished frames, and the values of the last.
    frames: usize,
    pub measured: Measured,
    response: Response,
}

/// A frame as the instrument sees it.
#[derive(Default)]
pub(super) struct Measured {
    pub exact_v: Vec<f64>,
    pub values_v: Vec<f64>,
    pub quality: Vec<TrueQuality>,
}

impl Course {
    /// Starts a course that makes at most `frames` frames at a time, with images of `pixels` pixels.
    pub(super) fn new(
        fabric: &Fabric,
        (rate_hz, seed): (f64, u64),
        (frames, pixels): (usize, usize),
        response: impl FnOnce(&Plan) -> Result<Response, FemError>,
    ) -> Result<Self, FemError> {
        let (plan, loose, clock) = fabric.plan(rate_hz, seed);
        let mut workspace = fabric.model.workspace()?;
        let mut solution = fabric.model.solve(&plan.untouched_s, &mut workspace)?;
        let (reference_v, untouched) = (solution.measurements().to_vec(), solution.report());
        let (settings, protocol) = (&fabric.settings.instrument, fabric.model.protocol());
        let channels = Channels::new(settings, protocol, &reference_v, rate_hz, seed);
        let count = clock.per_frame * frames;
        Ok(Self {
            memory: vec![0.0; plan.law.memory() * fabric.model.elements()],
            instants: (0..=count).map(|_| fabric.instant(pixels)).collect(),
            response: response(&plan)?,
            measured: Measured::default(),
            frames: 0,
            plan,
            clock,
            channels,
            reference_v,
            untouched,
            seed,
            loose,
        })
    }

    pub(super) fn seed(&self) -> u64 {
        self.seed
    }

    /// Number of finished frames.
    pub(super) fn frames(&self) -> usize {
        self.frames
    }

    /// Changes the frame rate after the last frame.
    pub(super) fn set_rate(&mut self, fabric: &Fabric, rate_hz: f64) {
        if rate_hz == self.clock.rate_hz {
            return;
        }
        self.channels.set_rate(self.frames, self.clock.rate_hz, rate_hz);
        self.clock.set_rate(rate_hz);
        self.plan.law = fabric.law(&self.clock);
        self.plan.warming_per_frame = fabric.warming_per_frame(rate_hz);
    }

    /// Returns the instants of the next frames, at their times and with their loose contacts, for their touches.
    pub(super) fn next(&mut self, frames: usize) -> &mut [Instant] {
        let clock = &self.clock;
        let instants = &mut self.instants[1..=frames * clock.per_frame];
        for (ahead, instant) in instants.iter_mut().enumerate() {
            instant.time = clock.time(ahead);
            instant.time_s = instant.time / clock.rate_hz;
            instant.frame = self.frames + ahead / clock.per_frame;
            let rate_hz = clock.per_frame as f64 * clock.rate_hz;
            instant.open.fill(false);
            for loose in &mut self.loose {
                instant.open[loose.electrode] |= loose.is_open(clock.instants(ahead), rate_hz);
            }
        }
        instants
    }

    /// Computes the voltages of the next frames. After an error, memory and clock are those of the last frame.
    pub(super) fn solve(
        &mut self,
        fabric: &Fabric,
        frames: usize,
        view: Option<&View<'_>>,
    ) -> Result<(), FemError> {
        let (plan, memory) = (&self.plan, &mut self.memory);
        let (before, instants) = self.instants.split_at_mut(1);
        let instants = &mut instants[..frames * self.clock.per_frame];
        match &mut self.response {
            Response::Linearised(linearised) => {
                for instant in &mut *instants {
                    linearised.voltages(fabric, plan, instant, memory);
                }
            }
            Response::Full(workers) => {
                let kept = memory.clone();
                fabric.changes(plan, workers, instants, memory);
                each(workers, instants, |worker, instant| {
                    instant.error = fabric.solve(plan, view, worker, instant).err();
                });
                if let Some(error) = instants.iter_mut().find_map(|instant| instant.error.take()) {
                    *memory = kept;
                    return Err(error);
                }
            }
        }
        if self.frames == 0 {
            before[0] = instants[0].clone();
        }
        Ok(())
    }

    /// Passes the next frame, which is the `ahead`th of those solved, through the instrument. Returns it, its middle
    /// instant and the conductivity of the untouched skin.
    pub(super) fn measure(
        &mut self,
        fabric: &Fabric,
        ahead: usize,
    ) -> (&Measured, &mut Instant, &[f64]) {
        let (n, f) = (self.clock.per_frame, self.frames);
        let scan = &mut self.instants[n * ahead..=n * (ahead + 1)];
        let (exact_v, mut quality) = scanned(fabric, &self.plan, self.clock.middle, scan);
        let mut values_v = exact_v.clone();
        self.channels.measure(f, &mut values_v, &mut quality);
        let count = values_v.len();
        for k in self.channels.own_values(f, count)..count {
            (values_v[k], quality[k]) = (self.measured.values_v[k], TrueQuality::Torn);
        }
        self.measured = Measured { exact_v, values_v, quality };
        self.frames += 1;
        (&self.measured, &mut scan[1 + self.clock.middle], &self.plan.untouched_s)
    }

    /// Ends frames that were solved and measured.
    pub(super) fn pass(&mut self, frames: usize) {
        let count = frames * self.clock.per_frame;
        self.instants.swap(0, count);
        self.clock.pass(count);
    }
}

/// Exact value and quality of each measurement when its drive is on, interpolated between the last instant of the
/// former frame and those of this one.
fn scanned(
    fabric: &Fabric,
    plan: &Plan,
    middle: usize,
    scan: &[Instant],
) -> (Vec<f64>, Vec<TrueQuality>) {
    let at = |(k, datum): (usize, &[u32; 2])| {
        let place = (1 + middle) as f64 + plan.scan[datum[0] as usize];
        let (before, part) = (&scan[place as usize], place.fract());
        let after = if part > 0.0 { &scan[place as usize + 1] } else { before };
        let [v, next_v] = [before, after].map(|instant| instant.voltages_v[k]);
        let quality = [before, after].map(|instant| quality(fabric, instant, datum));
        (v + part * (next_v - v), quality[0].max(quality[1]))
    };
    fabric.model.protocol().data().iter().enumerate().map(at).unzip()
}

/// Quality of a measurement before the converter.
fn quality(fabric: &Fabric, instant: &Instant, datum: &[u32; 2]) -> TrueQuality {
    let patterns = &fabric.model.patterns;
    let lost = |l: u32| fabric.settings.instrument.lost.contains(&(l as usize + 1));
    let open = |l: u32| instant.open[l as usize];
    let [stimulation, pattern] = datum.map(|k| k as usize);
    let involved =
        patterns.stimulations_a[stimulation].iter().chain(&patterns.measurements[pattern]);
    let mut electrodes = involved.map(|entry| entry.0);
    if electrodes.clone().any(lost) {
        TrueQuality::Lost
    } else if electrodes.any(open) {
        TrueQuality::Loose
    } else if instant.limited[stimulation] {
        TrueQuality::SourceLimited
    } else {
        TrueQuality::Good
    }
}
