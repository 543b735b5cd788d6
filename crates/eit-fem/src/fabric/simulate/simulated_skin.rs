//! A simulated skin that is stepped: contacts in, a frame out, as a robot's simulator needs it.

use super::course::{Course, Measured, Response};
use super::linearised::Linearised;
use super::plan::Plan;
use crate::error::FemError;
use crate::fabric::contact::Tip;
use crate::fabric::fabric_model::Fabric;
use crate::fabric::script::Touch;
use crate::fabric::seat::Seat;
use crate::fabric::truth::{TrueQuality, TrueTouch};
use std::collections::VecDeque;
use std::fmt;

/// A finger that presses on a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Number of the finger. The same number in two steps is the same finger, which has moved.
    pub finger: u32,
    /// Pressure profile of the fingertip.
    pub tip: Tip,
    /// Centre of the fingertip, metres, as seen from +z; must be on the skin.
    pub position_m: [f64; 2],
    /// Force, newton, at least zero; zero means no contact.
    pub force_n: f64,
    /// Radius of the fingertip, metres, above zero; see [`Tip`].
    pub radius_m: f64,
}

impl Default for Contact {
    /// Finger 1, a sphere of 10 mm that does not press.
    fn default() -> Self {
        Self { finger: 1, tip: Tip::Round, position_m: [0.0; 2], force_n: 0.0, radius_m: 0.01 }
    }
}

impl Contact {
    fn check(&self, fabric: &Fabric, time_s: f64) -> Result<(), FemError> {
        let Self { finger, position_m: [x, y], force_n, radius_m, .. } = *self;
        FemError::require("position_m[0] of a contact", x, true, "finite")?;
        FemError::require("position_m[1] of a contact", y, true, "finite")?;
        FemError::require(
            "force_n of a contact",
            force_n,
            force_n >= 0.0,
            "finite and at least zero",
        )?;
        FemError::require(
            "radius_m of a contact",
            radius_m,
            radius_m > 0.0,
            "finite and above zero",
        )?;
        // dents look for their places themselves
        if fabric.settings.linear.is_some() {
            let place = || "in a step".to_owned();
            let seat = Seat::on(fabric.mesh.surface(), [x, y]);
            Seat::require(seat, finger, place, time_s, [x, y])?;
        }
        Ok(())
    }

    /// The contact at a share `s` of the way from this one to the next.
    fn towards(&self, next: &Self, s: f64) -> Self {
        let mix = |a: f64, b: f64| if s == 1.0 { b } else { a + s * (b - a) };
        Self {
            position_m: [0, 1].map(|i| mix(self.position_m[i], next.position_m[i])),
            force_n: mix(self.force_n, next.force_n),
            radius_m: mix(self.radius_m, next.radius_m),
            ..*next
        }
    }
}

/// A frame of a stepped skin.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedFrame<'a> {
    /// Number of the frame, from 0.
    pub number: usize,
    /// Time since the first frame, seconds.
    pub time_s: f64,
    /// Values recorded by the instrument, volt, in protocol order.
    pub values_v: &'a [f64],
    /// Exact voltages before gain, noise and converter, volt.
    pub exact_v: &'a [f64],
    /// Quality of each value.
    pub quality: &'a [TrueQuality],
    /// The contacts that press, as the fabric feels them.
    pub touches: &'a [TrueTouch],
}

/// A simulated skin, stepped frame by frame: the fabric's memory, drift and instrument of [`Fabric::simulate`].
///
/// The contacts of a step are those at its end. Where the drives of a scan take turns
/// ([`Instrument::scan_share`](crate::fabric::Instrument)), contacts move on straight lines between steps, the scan lies
/// around the middle of the step, and the frame's time with it.
///
/// ```
/// use eit_fem::PairProtocol;
/// use eit_fem::fabric::{Contact, Fabric, FabricSettings, SimulatedSkin};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let mesh = generate(&SkinShape::Disc { radius_m: 0.1 }, &electrodes, &MeshSettings::with_edge(0.01))?;
/// let protocol = PairProtocol::default().protocol()?;
/// let fabric = Fabric::new(&mesh, &protocol, 1e-5, &[1e3; 16], &FabricSettings::default())?;
///
/// let mut skin = SimulatedSkin::new(&fabric, 1)?;
/// let untouched = skin.step(&[], 0.05)?.values_v.to_vec();
/// let finger = Contact { position_m: [0.03, 0.0], force_n: 1.0, ..Contact::default() };
/// let touched = skin.step(&[finger], 0.05)?;
/// assert_eq!(touched.values_v.len(), untouched.len());
/// assert!(touched.touches[0].depth_m > 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SimulatedSkin {
    fabric: Fabric,
    course: Course,
    /// Contacts of the last step, and the touches of the last instants, one frame's.
    contacts: Vec<Contact>,
    trail: VecDeque<Vec<Touch>>,
    touches: Vec<TrueTouch>,
}

impl fmt::Debug for SimulatedSkin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SimulatedSkin")
            .field("frames", &self.course.frames())
            .finish_non_exhaustive()
    }
}

impl SimulatedSkin {
    /// Creates a skin that solves every frame as [`Fabric::simulate`] does: with the contacts of a script's frames and
    /// the time between them, its frames are the same to the last bit.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`](crate::ForwardModel::solve) for the untouched skin.
    pub fn new(fabric: &Fabric, seed: u64) -> Result<Self, FemError> {
        Self::with(fabric, seed, |_| Ok(Response::Full(vec![fabric.worker()?])))
    }

    /// Creates a skin whose voltages follow linearly from conductivity, strain and contacts, which takes a tenth of the
    /// time. Mechanics, memory and instrument are the same; `docs/FABRIC.md` states its distance from full solves.
    ///
    /// # Errors
    /// Those of [`SimulatedSkin::new`]; [`FemError::OutOfRange`] for loose contacts, a compliance voltage and common-mode
    /// rejection, which are not linear or need more than the voltages; [`FemError::LinearElementsOnly`].
    pub fn linearised(fabric: &Fabric, seed: u64) -> Result<Self, FemError> {
        Linearised::check(fabric)?;
        Self::with(fabric, seed, |plan| {
            Ok(Response::Linearised(Box::new(Linearised::new(fabric, plan)?)))
        })
    }

    fn with(
        fabric: &Fabric,
        seed: u64,
        response: impl FnOnce(&Plan) -> Result<Response, FemError>,
    ) -> Result<Self, FemError> {
        Ok(Self {
            // the rate is set by the first step
            course: Course::new(fabric, (1.0, seed), (1, 0), response)?,
            fabric: fabric.clone(),
            contacts: Vec::new(),
            trail: VecDeque::new(),
            touches: Vec::new(),
        })
    }

    /// Exact voltages of the untouched skin at time 0, volt.
    pub fn reference_v(&self) -> &[f64] {
        &self.course.reference_v
    }

    /// Moves the contacts and measures the next frame, `dt_s` seconds after the one before. The first frame is at time 0.
    ///
    /// # Errors
    /// Before any work: [`FemError::OutOfRange`] for a time that is not from 1 us to 1 h, a force or radius that is not finite or below zero,
    /// [`FemError::OutsideSkin`], [`FemError::ForceTooLarge`]; and [`FemError::FoldedMesh`]. After an error, the skin is as
    /// it was after the last frame.
    pub fn step(
        &mut self,
        contacts: &[Contact],
        dt_s: f64,
    ) -> Result<SimulatedFrame<'_>, FemError> {
        // loose contacts open and close many times in a longer one
        let fits = (1e-6..=3600.0).contains(&dt_s);
        FemError::require("dt_s", dt_s, fits, "from a microsecond to an hour")?;
        let (fabric, course) = (&self.fabric, &mut self.course);
        let (mut clock, rate_hz) = (course.clock, rate_hz(dt_s));
        clock.set_rate(rate_hz);
        let (n, seed) = (clock.per_frame, course.seed());
        let time_s = |ahead| clock.time(ahead) / rate_hz;
        contacts.iter().try_for_each(|contact| contact.check(fabric, time_s(n - 1)))?;
        let mut trail = self.trail.clone();
        let mut touched = Vec::with_capacity(n);
        for k in 0..n {
            let s = (k + 1) as f64 / n as f64;
            // the first frame has none a whole frame before
            let before = (course.frames() * n + k >= n + clock.middle).then(|| &trail[0][..]);
            let touches: Vec<Touch> = between(&self.contacts, contacts, s)
                .filter(|contact| contact.force_n > 0.0)
                .map(|contact| touch(&contact, before.unwrap_or(&[])))
                .collect();
            let dents = fabric.dents(&touches, time_s(k), seed)?;
            if trail.len() == n {
                trail.pop_front();
            }
            trail.push_back(touches.clone());
            touched.push((touches, dents));
        }
        course.set_rate(fabric, rate_hz);
        for (instant, (touches, dents)) in course.next(1).iter_mut().zip(touched) {
            (instant.touches, instant.dents) = (touches, dents);
        }
        course.solve(fabric, 1, None)?;
        (self.contacts, self.trail) = (contacts.to_vec(), trail);
        let number = course.frames();
        let (_, instant, _) = course.measure(fabric, 0);
        self.touches.clear();
        self.touches.extend(instant.true_touches());
        let time_s = instant.time_s;
        course.pass(1);
        let Measured { exact_v, values_v, quality } = &course.measured;
        let touches = &self.touches;
        Ok(SimulatedFrame { number, time_s, values_v, exact_v, quality, touches })
    }
}

/// The frame rate of a time between frames: a whole number where that is its inverse, else `1 / dt_s`.
fn rate_hz(dt_s: f64) -> f64 {
    let rate_hz = 1.0 / dt_s;
    let whole = rate_hz.round();
    if 1.0 / whole == dt_s { whole } else { rate_hz }
}

/// The contacts at a share `s` of the way from those before to those now. A finger that comes or goes does so where it
/// is, its force from or to zero.
fn between<'a>(
    before: &'a [Contact],
    now: &'a [Contact],
    s: f64,
) -> impl Iterator<Item = Contact> + 'a {
    let of = |list: &'a [Contact], finger| list.iter().find(move |c: &&Contact| c.finger == finger);
    let released = |contact: &Contact| Contact { force_n: 0.0, ..*contact };
    let present = now.iter().map(move |next| {
        let from = of(before, next.finger).copied().unwrap_or_else(|| released(next));
        from.towards(next, s)
    });
    let gone = before.iter().filter(move |from| of(now, from.finger).is_none());
    present.chain(gone.map(move |from| from.towards(&released(from), s)))
}

/// A contact as a touch, which moves away from where its finger was a frame before.
fn touch(contact: &Contact, before: &[Touch]) -> Touch {
    let Contact { finger, tip, position_m, force_n, radius_m } = *contact;
    let mut touch = Touch { finger, tip, position_m, force_n, radius_m, direction: [0.0; 2] };
    if let Some(before) = before.iter().find(|touch| touch.finger == finger) {
        touch.turn(before);
    }
    touch
}
