//! A skin that is not there: an emulated instrument on TCP, and a finger that presses now and then.

use super::touch_sense::{QUIET, SHEET_S, model};
use eit_hw::codec::eits1::Information;
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Endpoint, Quadruple, Unit};
use std::error::Error;

/// Where the finger presses, metres, and how wide it is.
pub const FINGER_M: [f64; 2] = [0.035, 0.02];
const WIDTH_M: f64 = 0.01;
/// Standard deviation of a voltage's noise, volt; the smallest voltages are about 0.1 V.
const NOISE_V: f64 = 2e-5;
/// Frames of a press, and of the pause after it.
const PRESS: u64 = 25;

/// The instrument at a port, or without one an emulated skin, which lives as long as it is held.
pub fn endpoint(port: Option<&str>) -> Result<(Endpoint, Option<Emulator>), Box<dyn Error>> {
    if let Some(port) = port {
        return Ok((Endpoint::parse(port, 921_600)?, None));
    }
    let skin = skin()?;
    Ok((skin.endpoint().clone(), Some(skin)))
}

/// Starts an emulated skin whose first frames are quiet.
pub fn skin() -> Result<Emulator, Box<dyn Error>> {
    let quiet = QUIET as u64;
    let (mesh, model, protocol) = model(0.004)?;
    let own = protocol.quadruples().ok_or("a protocol of pairs")?.to_vec();
    let bell = |c: &[f64; 3]| {
        let far_m = (c[0] - FINGER_M[0]).hypot(c[1] - FINGER_M[1]);
        SHEET_S * (1.0 + 0.3 * (-0.5 * (far_m / WIDTH_M).powi(2)).exp())
    };
    let pressed: Vec<f64> = mesh.surface().centroids().iter().map(bell).collect();
    let rest = model.forward(&vec![SHEET_S; model.elements()])?;
    let pressed = model.forward(&pressed)?;
    let mut state = 1_u64;
    let mut normal = move || {
        // sums of twelve uniform numbers
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| draw()).sum::<f64>() - 6.0
    };
    let source = move |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        let touched = sequence > quiet && (sequence - quiet) / PRESS % 2 == 1;
        let frame = if touched { &pressed } else { &rest };
        for (value, quadruple) in values.iter_mut().zip(quadruples) {
            // what was not modelled is zero
            let place = own.iter().position(|q| q == quadruple);
            *value = place.map_or(0.0, |i| frame[i]) + NOISE_V * normal();
        }
    };
    let information = Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 10.0,
        unit: Unit::Volt,
        complex: false,
        name: "emulated skin".to_owned(),
        serial: "1".to_owned(),
    };
    let device = Box::new(Eits1Device::new(information, Box::new(source)));
    Ok(Emulator::start(device, &Listen::Tcp("127.0.0.1:0".to_owned()), FaultPlan::default())?)
}
