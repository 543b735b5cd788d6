//! The same of recordings in parts: a folder of files whose names are safe or not.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::{io, mem};

use fixtures::Random;

use super::{PATH, Shared, check, entry, session};
use crate::capture::write::storage::{Folder, Storage};
use crate::capture::write::{CaptureSettings, CaptureWriter};
use crate::capture::{Entry, read};
use crate::error::HwError;

/// A folder whose files lose power together.
#[derive(Clone, Default)]
struct Drawer(Arc<Mutex<Names>>);

#[derive(Default)]
struct Names {
    files: BTreeMap<PathBuf, Shared>,
    /// Files whose names are safe.
    durable: Vec<PathBuf>,
    /// Number of files after which none can be created, or its name not be forced to the disk.
    most: Option<usize>,
    most_synced: Option<usize>,
}

impl Drawer {
    fn with<T>(&self, act: impl FnOnce(&mut Names) -> T) -> T {
        act(&mut self.0.lock().unwrap())
    }

    /// Returns the files after a power cut; one whose name was not forced to the disk may be gone.
    fn after_power_cut(&self, random: &mut Random) -> Vec<(PathBuf, Vec<u8>)> {
        self.with(|names| {
            let mut left = Vec::new();
            for (path, disk) in &names.files {
                if names.durable.contains(path) || random.below(2) == 0 {
                    left.push((path.clone(), disk.with(|disk| disk.after_power_cut(random))));
                }
            }
            left
        })
    }
}

impl Folder for Drawer {
    fn create(&mut self, path: &Path) -> Result<Box<dyn Storage>, HwError> {
        self.with(|names| {
            if names.most.is_some_and(|most| names.files.len() >= most) {
                let place = crate::error::Place::file(path);
                return Err(HwError::Write { place, source: io::ErrorKind::StorageFull.into() });
            }
            let disk = Shared::default();
            assert!(names.files.insert(path.to_path_buf(), disk.clone()).is_none(), "{path:?}");
            Ok(Box::new(disk) as Box<dyn Storage>)
        })
    }

    fn sync(&mut self, path: &Path) -> io::Result<()> {
        self.with(|names| {
            if names.most_synced.is_some_and(|most| names.durable.len() >= most) {
                return Err(io::ErrorKind::StorageFull.into());
            }
            assert!(names.files.contains_key(path));
            names.durable.push(path.to_path_buf());
            Ok(())
        })
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        self.with(|names| {
            assert!(names.files.remove(path).is_some());
            Ok(())
        })
    }
}

/// Records in parts until a power cut; returns the entries written and the number flushed.
fn record_parts(
    drawer: &Drawer,
    random: &mut Random,
    entries: usize,
    sync: bool,
) -> (Vec<Entry>, usize) {
    let settings = CaptureSettings {
        flush_s: 3600.0,
        sync,
        part_bytes: Some(2000 + random.below(3000) as u64),
        part_s: None,
    };
    let (path, mut written) = (Path::new(PATH), Vec::new());
    let folder = Box::new(drawer.clone());
    let begun = CaptureWriter::new_in(folder, path, &session(), settings)
        .and_then(|capture| CaptureWriter::begin(capture, &session()));
    let Ok(mut writer) = begun else { return (written, 0) };
    let mut flushed = 0;
    for sequence in 0..entries as u64 {
        let entry = entry(random, sequence);
        let result = writer.write(&entry);
        written.push(entry);
        result.unwrap();
        if random.below(3) == 0 {
            writer.flush().unwrap();
            flushed = written.len();
        }
    }
    if random.below(4) == 0 {
        writer.finish().unwrap();
        flushed = written.len();
    } else {
        mem::forget(writer);
    }
    (written, flushed)
}

/// Reads what a power cut has left, without the sessions at the start of each part. Files are written over those of the
/// last call, without truncating them first, which some file systems force to the disk: new ones take minutes.
fn entries_of(left: &[(PathBuf, Vec<u8>)], folder: &Path) -> Option<Vec<Entry>> {
    for old in std::fs::read_dir(folder).unwrap() {
        let old = old.unwrap();
        if left.iter().all(|(path, _)| path.as_os_str() != old.file_name()) {
            std::fs::remove_file(old.path()).unwrap();
        }
    }
    for (path, bytes) in left {
        let mut settings = File::options();
        let mut file =
            settings.write(true).create(true).truncate(false).open(folder.join(path)).unwrap();
        file.write_all(bytes).unwrap();
        file.set_len(bytes.len() as u64).unwrap();
    }
    let found = read(&folder.join(PATH)).ok()?.entries;
    Some(found.into_iter().filter(|entry| !matches!(entry, Entry::Session(_))).collect())
}

/// Each file of a recording in parts, their names, and the ends of earlier parts that are written in
/// the background are on the disk or not, as it happens.
#[test]
fn ten_thousand_power_cuts_across_parts_lose_nothing_flushed() {
    let folder = tempfile::tempdir().unwrap();
    let (mut most_parts, mut read_more) = (0, 0);
    for seed in 0..2_500 {
        let mut random = Random::new(77_000 + seed);
        let drawer = Drawer::default();
        let entries = random.below(40);
        let (written, flushed) = record_parts(&drawer, &mut random, entries, true);
        for cut in 0..4 {
            let left = drawer.after_power_cut(&mut random);
            let found = entries_of(&left, folder.path()).unwrap_or_default();
            check(&found, &[], &written, flushed, &format!("seed {seed}, cut {cut}"));
            most_parts = most_parts.max(left.len());
            read_more += usize::from(found.len() > flushed);
        }
    }
    println!("up to {most_parts} parts; more than was flushed was read in {read_more} of 10 000");
    assert!(most_parts >= 5, "{most_parts}");
}

/// Without forcing names to the disk the same cuts lose what was flushed: the test above can fail.
#[test]
fn a_name_that_is_not_forced_to_the_disk_loses_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let lost = (0..200).filter(|seed| {
        let mut random = Random::new(88_000 + seed);
        let drawer = Drawer::default();
        let (_, flushed) = record_parts(&drawer, &mut random, 30, true);
        // as if the folder had not been forced to the disk after the first part
        drawer.with(|names| names.durable.truncate(1));
        let left = drawer.after_power_cut(&mut random);
        let found = entries_of(&left, folder.path()).unwrap_or_default();
        found.len() < flushed
    });
    let lost = lost.count();
    assert!(lost > 20, "{lost}");
}

/// With `sync` the name of each new file is forced to the disk before anything is written to it, and
/// without it never.
#[test]
fn names_are_forced_to_the_disk_with_sync_only() {
    for sync in [true, false] {
        let drawer = Drawer::default();
        record_parts(&drawer, &mut Random::new(3), 40, sync);
        let (files, durable) = drawer
            .with(|names| (names.files.keys().cloned().collect::<Vec<_>>(), names.durable.clone()));
        assert!(files.len() > 2, "{files:?}");
        assert_eq!(durable, if sync { files } else { Vec::new() });
        // a single file, too
        let drawer = Drawer::default();
        let settings = CaptureSettings { sync, ..CaptureSettings::default() };
        let folder = Box::new(drawer.clone());
        CaptureWriter::new_in(folder, Path::new(PATH), &session(), settings).unwrap();
        assert_eq!(drawer.with(|names| names.durable.len()), usize::from(sync));
    }
}

/// A folder that can hold no further file, or whose names cannot be forced to the disk: the
/// recording goes on in its file, says so, and leaves no other.
#[test]
fn a_folder_that_fails_costs_no_frame() {
    let folder = tempfile::tempdir().unwrap();
    for most in 1..4 {
        for is_sync in [false, true] {
            let drawer = Drawer::default();
            drawer.with(|names| match is_sync {
                true => names.most_synced = Some(most),
                false => names.most = Some(most),
            });
            let (written, _) = record_parts(&drawer, &mut Random::new(9), 40, true);
            let files = drawer.with(|names| names.files.len());
            assert_eq!(files, most);
            let left: Vec<_> = drawer.with(|names| {
                let bytes = |disk: &Shared| disk.with(|disk| disk.bytes.clone());
                names.files.iter().map(|(path, disk)| (path.clone(), bytes(disk))).collect()
            });
            let found = entries_of(&left, folder.path()).unwrap();
            let goes_on = |entry: &&Entry| matches!(entry, Entry::Note(text) if text.contains("goes on in this file"));
            assert!(found.iter().any(|entry| goes_on(&entry)), "{most} {is_sync}");
            let kept: Vec<_> = found.iter().filter(|entry| !goes_on(entry)).collect();
            assert!(written.iter().zip(&kept).all(|(written, kept)| written == *kept));
        }
    }
    // not even the first: refused, and nothing is left
    let drawer = Drawer::default();
    drawer.with(|names| names.most_synced = Some(0));
    let folder = Box::new(drawer.clone());
    let settings = CaptureSettings { sync: true, ..CaptureSettings::default() };
    let refused = CaptureWriter::new_in(folder, Path::new(PATH), &session(), settings);
    assert!(matches!(refused.err(), Some(HwError::Write { .. })));
    assert_eq!(drawer.with(|names| names.files.len()), 0);
}
