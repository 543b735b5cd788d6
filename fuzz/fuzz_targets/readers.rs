//! Readers of files: no input panics or allocates without limit, and results have consistent sizes.
#![no_main]

use eit_hw::{Format, ReadOptions, parse_recording};
use libfuzzer_sys::fuzz_target;

const FORMATS: [Format; 9] = [
    Format::Csv,
    Format::Npy,
    Format::Sciospec,
    Format::Goe,
    Format::Lct,
    Format::SerialLog,
    Format::BlackSensor,
    Format::Mat,
    Format::Npz,
];

fuzz_target!(|data: &[u8]| {
    let Some((&first, data)) = data.split_first() else { return };
    let format = FORMATS[usize::from(first) % FORMATS.len()];
    if let Ok(recording) = parse_recording(data, "fuzz", format, &ReadOptions::default()) {
        assert!(
            recording.quality.as_ref().is_none_or(|quality| quality.dim() == recording.real.dim())
        );
    }
});
