//! The ABI as a C program uses it, and its header.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]
#![allow(clippy::undocumented_unsafe_blocks, reason = "pointers of this file")]

use eit_skin::Skin;
use eit_skin::eit_fem::fabric::{Contact, SimulatedSkin};
use eit_skin::eit_hw::Frame;
use eit_skin_c::*;
use std::ffi::{CStr, CString};
use std::ptr::null_mut;

fn load(scene: &str) -> *mut EitSensor {
    let scene = CString::new(scene).unwrap();
    unsafe { eit_load(scene.as_ptr(), null_mut(), 0) }
}

/// The header is that of the source. `EIT_WRITE_HEADER=1` writes it.
#[test]
fn the_header_is_up_to_date() {
    let folder = env!("CARGO_MANIFEST_DIR");
    let path = format!("{folder}/include/eit_skin.h");
    let mut made = Vec::new();
    cbindgen::generate(folder).unwrap().write(&mut made);
    let made = String::from_utf8(made).unwrap();
    if std::env::var_os("EIT_WRITE_HEADER").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    assert_eq!(std::fs::read_to_string(&path).unwrap(), made, "run with EIT_WRITE_HEADER=1");
}

/// Pushed frames give the touches of the library, value for value.
#[test]
fn touches_are_those_of_the_library() {
    let skin = Skin::load("paper-disc").unwrap();
    let mut simulated = SimulatedSkin::new(&skin.simulated_fabric().unwrap(), 1).unwrap();
    let mut wanted = skin.sensor().unwrap();
    let sensor = load("paper-disc");
    assert_eq!(unsafe { eit_measurements(sensor) }, 208);
    let reference = unsafe { eit_reference_frames(sensor) };
    let mut found = 0;
    for k in 0..reference + 30 {
        let press = k >= reference + 8;
        let force_n = if press { 1.5 } else { 0.0 };
        let finger = Contact { position_m: [0.03, 0.02], force_n, ..Contact::default() };
        let values_v = simulated.step(&[finger], 0.05).unwrap().values_v.to_vec();
        let time_s = 0.05 * k as f64;
        let pushed = unsafe { eit_push(sensor, values_v.as_ptr(), values_v.len(), time_s) };
        let frame = Frame { device_time_s: Some(time_s), ..Frame::new(k as u64, values_v) };
        let touches: Vec<EitTouch> = match wanted.push(&frame).unwrap() {
            Some(shown) => {
                assert_eq!(pushed, EitPush::Touches);
                shown.touches.iter().map(EitTouch::from).collect()
            }
            None => {
                assert_eq!(pushed, EitPush::Reference);
                assert_eq!(unsafe { eit_state(sensor) }, EitSkinState::Reference);
                Vec::new()
            }
        };
        let count = unsafe { eit_touches(sensor, null_mut(), 0) };
        let mut out = Vec::with_capacity(count);
        unsafe { eit_touches(sensor, out.as_mut_ptr(), count) };
        // SAFETY: as many were written
        unsafe { out.set_len(count) };
        assert_eq!(count, touches.len());
        // NaN differs from itself: their texts are compared
        assert_eq!(format!("{out:?}"), format!("{touches:?}"));
        found += count;
    }
    assert!(found > 10, "{found}");
    unsafe { eit_free(sensor) };
}

/// Errors are messages; nothing is read through NULL, and what was found stays.
#[test]
fn errors_are_messages() {
    let mut message = [1; 40];
    let scene = CString::new("no-such-scene").unwrap();
    let none = unsafe { eit_load(scene.as_ptr(), message.as_mut_ptr(), message.len()) };
    assert!(none.is_null());
    let text = unsafe { CStr::from_ptr(message.as_ptr()) }.to_str().unwrap();
    assert!(text.contains("no-such-scene") && text.len() < 40, "{text}");
    assert!(unsafe { eit_load(std::ptr::null(), null_mut(), 0) }.is_null());
    assert_eq!(unsafe { eit_measurements(null_mut()) }, 0);
    assert_eq!(unsafe { eit_push(null_mut(), [0.0].as_ptr(), 1, 0.0) }, EitPush::Error);
    assert_eq!(unsafe { eit_touches(null_mut(), null_mut(), 0) }, 0);
    assert!(unsafe { eit_message(null_mut()) }.is_null());
    unsafe { eit_free(null_mut()) };

    let sensor = load("paper-disc");
    assert_eq!(unsafe { eit_push(sensor, [0.0; 7].as_ptr(), 7, 0.0) }, EitPush::Error);
    let text = unsafe { CStr::from_ptr(eit_message(sensor)) }.to_str().unwrap();
    assert!(text.contains('7') && text.contains("208"), "{text}");
    assert_eq!(unsafe { eit_push(sensor, std::ptr::null(), 208, 0.0) }, EitPush::Error);
    unsafe { eit_free(sensor) };
}
