//! A C ABI of `eit-skin`: load a scene, push frames, read touches, free. `include/eit_skin.h` is made of this file.
//!
//! Every `unsafe` here reads or writes through a pointer that the caller promises to be valid.

use eit_skin::eit_hw::Frame;
use eit_skin::live::SkinState;
use eit_skin::{Sensor, Skin, SkinError, Touch, TouchState};
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A skin that frames are pushed to.
pub struct EitSensor {
    sensor: Sensor,
    measurements: usize,
    pushed: u64,
    touches: Vec<EitTouch>,
    state: EitSkinState,
    message: CString,
}

/// What a frame led to.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EitPush {
    /// The frame was refused or failed: see `eit_message`. The touches are those of the frame before.
    Error = -1,
    /// The frame went into the reference, for which the skin must be untouched. There are no touches yet.
    Reference = 0,
    /// The touches of the frame were found.
    Touches = 1,
}

/// What is known of the skin.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EitSkinState {
    /// Touches, or their absence, explain the frame.
    Sound = 0,
    /// They do not: no touch is valid.
    NotExplained = 1,
    /// The instrument repeats an old frame.
    Frozen = 2,
    /// The reference is being taken.
    Reference = 3,
    /// There are no data.
    NoData = 4,
}

/// Whether a touch is new.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EitTouchState {
    /// Reported for the first time.
    Begin = 0,
    /// Reported before.
    Hold = 1,
    /// Reported for the last time; where it was seen last.
    End = 2,
}

/// A touch. What is unknown is NaN.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EitTouch {
    /// Counted from 1 and never reused.
    pub id: u64,
    /// New, held or ended.
    pub state: EitTouchState,
    /// Whether position and strength may be acted on.
    pub valid: bool,
    /// Whether the frame was complete, without faulty electrodes.
    pub whole: bool,
    /// Position x, y, z, metres.
    pub position_m: [f64; 3],
    /// Standard deviation of each coordinate, metres.
    pub position_std_m: [f64; 3],
    /// Velocity, metres per second.
    pub velocity_m_s: [f64; 3],
    /// Force and its standard deviation, newton, where they were learnt.
    pub force_n: f64,
    /// Standard deviation of the force, newton.
    pub force_std_n: f64,
    /// Integral of the conductivity change, S m^2.
    pub intensity_s_m2: f64,
    /// Confidence that there is a touch, 0 to 1.
    pub confidence: f64,
    /// Time since its begin, seconds.
    pub age_s: f64,
}

impl From<&Touch> for EitTouch {
    fn from(touch: &Touch) -> Self {
        Self {
            id: touch.id,
            state: match touch.state {
                TouchState::Begin => EitTouchState::Begin,
                TouchState::Hold => EitTouchState::Hold,
                TouchState::End => EitTouchState::End,
            },
            valid: touch.valid,
            whole: touch.whole,
            position_m: touch.position_m,
            position_std_m: touch.position_std_m(),
            velocity_m_s: touch.velocity_m_s,
            force_n: touch.force_n().unwrap_or(f64::NAN),
            force_std_n: touch.force_std_n().unwrap_or(f64::NAN),
            intensity_s_m2: touch.intensity_s_m2,
            confidence: touch.confidence,
            age_s: touch.age_s,
        }
    }
}

impl From<SkinState> for EitSkinState {
    fn from(state: SkinState) -> Self {
        match state {
            SkinState::Sound => Self::Sound,
            SkinState::NotExplained => Self::NotExplained,
            SkinState::Frozen => Self::Frozen,
            SkinState::Reference => Self::Reference,
            SkinState::NoData => Self::NoData,
        }
    }
}

/// The result of some work, or what it says of its error or panic.
fn guarded<T>(work: impl FnOnce() -> Result<T, SkinError>) -> Result<T, String> {
    let panicked = |_| Err(SkinError::input("an error inside the library: please report it"));
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked).map_err(|e| e.to_string())
}

impl EitSensor {
    fn load(scene: &CStr) -> Result<Self, SkinError> {
        let skin = Skin::load(scene.to_string_lossy().as_ref())?;
        Ok(Self {
            sensor: skin.sensor()?,
            measurements: skin.protocol.measurements(),
            pushed: 0,
            touches: Vec::new(),
            state: EitSkinState::Reference,
            message: CString::default(),
        })
    }

    fn push(&mut self, values_v: &[f64], time_s: f64) -> Result<EitPush, SkinError> {
        let device_time_s = time_s.is_finite().then_some(time_s);
        let frame = Frame { device_time_s, ..Frame::new(self.pushed, values_v.to_vec()) };
        let shown = self.sensor.push(&frame)?;
        self.pushed += 1;
        self.touches.clear();
        let Some(shown) = shown else {
            self.state = EitSkinState::Reference;
            return Ok(EitPush::Reference);
        };
        self.touches.extend(shown.touches.iter().map(EitTouch::from));
        self.state = shown.state.into();
        Ok(EitPush::Touches)
    }
}

/// Loads a scene file, or a built-in scene by name, such as "paper-disc". Takes up to a second. Returns NULL after an error,
/// whose message, cut to `size` bytes with its ending zero, is in `message` unless that is NULL.
///
/// # Safety
/// `scene` is a string that ends with a zero; `message` is NULL or has room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_load(
    scene: *const c_char,
    message: *mut c_char,
    size: usize,
) -> *mut EitSensor {
    let loaded = match scene.is_null() {
        true => Err("the scene is NULL".to_owned()),
        // SAFETY: not NULL, and the caller's string ends with a zero
        false => guarded(|| EitSensor::load(unsafe { CStr::from_ptr(scene) })),
    };
    match loaded {
        Ok(sensor) => Box::into_raw(Box::new(sensor)),
        Err(error) => {
            if !message.is_null() && size > 0 {
                // a cut must not split a character
                let fits = |length: &usize| *length < size && error.is_char_boundary(*length);
                let length = (0..=error.len()).rev().find(fits).unwrap_or(0);
                // SAFETY: the caller has `size` bytes of room, of which `length` + 1 are written
                unsafe {
                    error.as_ptr().copy_to_nonoverlapping(message.cast(), length);
                    message.add(length).write(0);
                }
            }
            std::ptr::null_mut()
        }
    }
}

/// Number of values of a frame; 0 for NULL.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_measurements(sensor: *const EitSensor) -> usize {
    // SAFETY: the caller's promise
    unsafe { sensor.as_ref() }.map_or(0, |sensor| sensor.measurements)
}

/// Number of frames of the untouched skin that the reference needs; 0 for NULL.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_reference_frames(sensor: *const EitSensor) -> usize {
    // SAFETY: the caller's promise
    unsafe { sensor.as_ref() }.map_or(0, |sensor| sensor.sensor.reference_frames())
}

/// Takes a frame: `count` values in protocol order, volt, NaN where one was lost, and the instrument's time in seconds, or NaN.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed; `values_v` is NULL or points at `count` values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_push(
    sensor: *mut EitSensor,
    values_v: *const f64,
    count: usize,
    time_s: f64,
) -> EitPush {
    // SAFETY: the caller's promise
    let Some(sensor) = (unsafe { sensor.as_mut() }) else { return EitPush::Error };
    let pushed = match values_v.is_null() {
        true => Err("the values are NULL".to_owned()),
        false => {
            // SAFETY: not NULL, and the caller has `count` values
            let values_v = unsafe { std::slice::from_raw_parts(values_v, count) };
            guarded(|| sensor.push(values_v, time_s))
        }
    };
    pushed.unwrap_or_else(|error| {
        sensor.message = CString::new(error.replace('\0', "")).unwrap_or_default();
        EitPush::Error
    })
}

/// Writes the touches of the last frame into `touches`, at most `capacity`; returns how many there are.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed; `touches` is NULL or has room for `capacity` touches.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_touches(
    sensor: *const EitSensor,
    touches: *mut EitTouch,
    capacity: usize,
) -> usize {
    // SAFETY: the caller's promise
    let Some(sensor) = (unsafe { sensor.as_ref() }) else { return 0 };
    if !touches.is_null() {
        let count = sensor.touches.len().min(capacity);
        // SAFETY: the caller has room for `capacity` touches
        unsafe { sensor.touches.as_ptr().copy_to_nonoverlapping(touches, count) };
    }
    sensor.touches.len()
}

/// What the last frame said of the skin; no data for NULL.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_state(sensor: *const EitSensor) -> EitSkinState {
    // SAFETY: the caller's promise
    unsafe { sensor.as_ref() }.map_or(EitSkinState::NoData, |sensor| sensor.state)
}

/// Message of the last error of `eit_push`, valid until the next; empty if there was none, NULL for NULL.
///
/// # Safety
/// `sensor` is NULL or from `eit_load` and not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_message(sensor: *const EitSensor) -> *const c_char {
    // SAFETY: the caller's promise
    unsafe { sensor.as_ref() }.map_or(std::ptr::null(), |sensor| sensor.message.as_ptr())
}

/// Frees a sensor. NULL is ignored.
///
/// # Safety
/// `sensor` is NULL or from `eit_load`, and not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eit_free(sensor: *mut EitSensor) {
    if !sensor.is_null() {
        // SAFETY: made by Box::into_raw in eit_load, and freed once
        drop(unsafe { Box::from_raw(sensor) });
    }
}
