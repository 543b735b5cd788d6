//! Recordings: no input panics, whether read as entries or converted to frames.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let path = Path::new("fuzz.mcap");
    let Ok(capture) = eit_hw::capture::parse(data, path) else { return };
    if let Ok(recording) = capture.recording(path) {
        assert_eq!(recording.frame_count(), capture.frames().count());
    }
});
