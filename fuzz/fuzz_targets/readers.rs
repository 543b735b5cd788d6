//! Readers of files: no input panics or allocates without limit, and results have consistent sizes.
#![no_main]

use eit_hw::{black_sensor, csv, goe, lct, npy, sciospec, serial_log};
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let Some((&first, data)) = data.split_first() else { return };
    let path = Path::new("fuzz");
    let read = match first % 8 {
        0 => csv::parse(data, path, &csv::CsvOptions::default()),
        1 => npy::parse(data, path, &npy::NpyOptions::default()),
        2 => sciospec::parse(data, path, &sciospec::SciospecOptions::default()),
        3 => goe::parse(data, path),
        4 => lct::parse(data, path),
        6 => black_sensor::parse(data, path),
        5 => serial_log::parse(data, path, &serial_log::SerialLogOptions::default()),
        _ => {
            if let Ok(array) = npy::parse_array(data, path) {
                assert!(array.len() <= data.len());
            }
            return;
        }
    };
    if let Ok(recording) = read {
        assert_eq!(recording.real().dim(), recording.quality().dim());
    }
});
