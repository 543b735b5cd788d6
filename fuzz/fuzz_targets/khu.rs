//! KHU folders: no content of a projection table and a scan panics or allocates without limit.
//! The input is the table, a zero byte and the scan.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use std::sync::LazyLock;

/// The folder that is read, in memory where the system has a file system there.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = PathBuf::from("/dev/shm");
    let root = if memory.is_dir() { memory } else { std::env::temp_dir() };
    let folder = root.join(format!("eit-fuzz-khu-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for the files");
    folder
});

fuzz_target!(|data: &[u8]| {
    let middle = data.iter().position(|&byte| byte == 0).unwrap_or(data.len());
    let (table, scan) = data.split_at(middle);
    std::fs::write(FOLDER.join("ProjectionTableSendLog.txt"), table).expect("a table");
    std::fs::write(FOLDER.join("1Scan.txt"), scan.get(1..).unwrap_or_default()).expect("a scan");
    let options = eit_hw::ReadOptions::default();
    if let Ok(recording) = eit_hw::read_recording(FOLDER.as_path(), None, &options) {
        assert!(
            recording.quality.as_ref().is_none_or(|quality| quality.dim() == recording.real.dim())
        );
        assert_eq!(recording.frame_count(), 1);
    }
});
