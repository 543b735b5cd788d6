//! Tests with disks that fail and lose power: everything flushed must survive.

mod parts_tests;

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::{io, mem};

use fixtures::Random;

use super::storage::Storage;
use super::{CaptureSettings, CaptureWriter};
use crate::capture::{CaptureReader, Entry, SessionRecord, parse};
use crate::error::HwError;
use crate::frame::{Frame, Quality};

/// Size of the unit that a disk writes atomically, in bytes.
const SECTOR: usize = 512;
const PATH: &str = "power.mcap";

/// A change to the file since the last sync.
#[derive(Clone)]
enum Change {
    Append { at: usize, bytes: Vec<u8> },
    Cut(usize),
}

#[derive(Default)]
struct Disk {
    /// Contents as programs see them.
    bytes: Vec<u8>,
    /// Contents as of the last sync.
    durable: Vec<u8>,
    changes: Vec<Change>,
    calls: usize,
    /// After how many calls the disk fails, and how many bytes the first failing call still writes.
    fails: Option<(usize, usize)>,
}

impl Disk {
    fn call(&mut self) -> Option<usize> {
        self.calls += 1;
        self.fails.filter(|(call, _)| *call < self.calls).map(|(_, bytes)| bytes)
    }

    /// Returns the file after a power cut: each change since the last sync is present, absent or
    /// partly present, sector by sector, in any order; the length is any that the file has had
    /// since.
    fn after_power_cut(&self, random: &mut Random) -> Vec<u8> {
        let mut file = self.durable.clone();
        let mut lengths = vec![file.len()];
        for change in &self.changes {
            let length = match change {
                Change::Append { at, bytes } => {
                    let length = at + bytes.len();
                    file.resize(file.len().max(length), 0);
                    let mut start = *at;
                    while start < length {
                        let end = ((start / SECTOR + 1) * SECTOR).min(length);
                        if random.below(2) == 0 {
                            file[start..end].copy_from_slice(&bytes[start - at..end - at]);
                        }
                        start = end;
                    }
                    length
                }
                Change::Cut(to) => *to,
            };
            lengths.push(length);
        }
        file.truncate(lengths[random.below(lengths.len())].max(self.never_shorter()));
        file
    }

    /// Returns the lowest position that a change has touched; bytes before it are safe.
    fn never_shorter(&self) -> usize {
        let starts = self.changes.iter().map(|change| match change {
            Change::Append { at, .. } => *at,
            Change::Cut(to) => *to,
        });
        starts.min().unwrap_or(self.durable.len()).min(self.durable.len())
    }
}

#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Disk>>);

impl Shared {
    fn with<T>(&self, act: impl FnOnce(&mut Disk) -> T) -> T {
        act(&mut self.0.lock().unwrap())
    }
}

impl Storage for Shared {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.with(|disk| {
            let failed = disk.call();
            let written = bytes[..failed.unwrap_or(bytes.len()).min(bytes.len())].to_vec();
            let at = disk.bytes.len();
            disk.bytes.extend(&written);
            disk.changes.push(Change::Append { at, bytes: written });
            failed.map_or(Ok(()), |_| Err(io::ErrorKind::StorageFull.into()))
        })
    }

    fn sync(&mut self) -> io::Result<()> {
        self.with(|disk| {
            if disk.call().is_some() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            disk.durable = disk.bytes.clone();
            disk.changes.clear();
            Ok(())
        })
    }

    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.with(|disk| {
            disk.bytes.truncate(bytes as usize);
            disk.changes.push(Change::Cut(bytes as usize));
            Ok(())
        })
    }
}

fn session() -> SessionRecord {
    SessionRecord { instrument: "disk".into(), ..SessionRecord::default() }
}

fn entry(random: &mut Random, sequence: u64) -> Entry {
    if sequence % 7 == 3 {
        return Entry::Note(format!("note {sequence}"));
    }
    let values = (0..40).map(|_| random.uniform()).collect();
    Entry::Frame(Frame {
        values,
        imaginary: None,
        quality: vec![Quality::GOOD; 40],
        sequence,
        epoch: 0,
        device_time_s: Some(sequence as f64),
        host_time_s: Some(1e9),
    })
}

fn writer(disk: &Shared, whole_bytes: u64) -> Result<CaptureWriter, HwError> {
    let settings = CaptureSettings { flush_s: 3600.0, sync: true, ..CaptureSettings::default() };
    let on = CaptureWriter::on(Box::new(disk.clone()), Path::new(PATH), settings, whole_bytes)?;
    CaptureWriter::begin(on, &session())
}

/// Writes entries and flushes now and then until something fails; returns the entries written and
/// the number flushed.
fn record(
    disk: &Shared,
    whole_bytes: u64,
    random: &mut Random,
    entries: usize,
    ends: bool,
) -> (Vec<Entry>, usize) {
    let mut written = vec![Entry::Session(session())];
    let Ok(mut writer) = writer(disk, whole_bytes) else { return (written, 0) };
    let mut flushed = 1;
    for sequence in 0..entries as u64 {
        let entry = entry(random, sequence);
        let result = writer.write(&entry);
        written.push(entry);
        if result.is_err() {
            // after one failure every write fails
            assert!(writer.note("more").is_err());
            return (written, flushed);
        }
        if random.below(4) == 0 {
            match writer.flush() {
                Ok(()) => flushed = written.len(),
                Err(_) => return (written, flushed),
            }
        }
    }
    if ends {
        if writer.finish().is_ok() {
            flushed = written.len();
        }
    } else {
        // the power fails: no destructor writes what is left
        mem::forget(writer);
    }
    (written, flushed)
}

/// Checks that what is read starts with what was flushed, then has entries that were written, in
/// order.
fn check(found: &[Entry], before: &[Entry], written: &[Entry], flushed: usize, what: &str) {
    let safe: Vec<&Entry> = before.iter().chain(&written[..flushed.min(written.len())]).collect();
    assert!(found.len() >= safe.len(), "{what}: {} of {} entries", found.len(), safe.len());
    assert!(found.iter().zip(&safe).all(|(found, safe)| found == *safe), "{what}");
    let mut rest = written[flushed.min(written.len())..].iter();
    for entry in &found[safe.len()..] {
        assert!(rest.any(|written| written == entry), "{what}: what was not written was read");
    }
}

#[test]
fn ten_thousand_power_cuts_lose_nothing_flushed() {
    let mut read_more = 0;
    for seed in 0..10_000 {
        let mut random = Random::new(seed);
        let disk = Shared::default();
        let mut before = Vec::new();
        let mut whole = 0;
        if seed % 2 == 1 {
            // append to a recording, finished or not: its index is cut off
            let entries = 1 + random.below(8);
            before = record(&disk, 0, &mut random, entries, seed % 4 == 1).0;
            let bytes = disk.with(|disk| disk.bytes.clone());
            let mut reader = CaptureReader::new(io::Cursor::new(&bytes), Path::new(PATH)).unwrap();
            let mut kept = Vec::new();
            while let Some(entry) = reader.next_entry().unwrap() {
                kept.push(entry);
            }
            before.truncate(kept.len());
            assert_eq!(kept, before);
            whole = reader.whole_bytes();
            disk.with(|disk| {
                disk.changes.clear();
                disk.durable = disk.bytes.clone();
            });
            disk.clone().cut(whole).unwrap();
        }
        let entries = random.below(16);
        let ends = random.below(4) == 0;
        let (written, flushed) = record(&disk, whole, &mut random, entries, ends);
        let file = disk.with(|disk| disk.after_power_cut(&mut random));
        let found = parse(&file, Path::new(PATH)).unwrap();
        check(&found.entries, &before, &written, flushed, &format!("seed {seed}"));
        read_more += usize::from(found.entries.len() > before.len() + flushed);
    }
    // in some runs complete chunks had reached the disk unforced
    println!("more than was flushed was read in {read_more} of 10 000");
}

#[test]
fn a_disk_that_fails_at_any_call_costs_nothing_flushed() {
    let calls = {
        let disk = Shared::default();
        record(&disk, 0, &mut Random::new(5), 60, true);
        disk.with(|disk| disk.calls)
    };
    assert!(calls > 20, "{calls}");
    for call in 0..calls {
        for bytes in [0, 1, 100, 100_000] {
            let disk = Shared::default();
            disk.with(|disk| disk.fails = Some((call, bytes)));
            let (written, flushed) = record(&disk, 0, &mut Random::new(5), 60, true);
            let file = disk.with(|disk| disk.bytes.clone());
            if file.is_empty() {
                assert_eq!(flushed, 0);
                continue;
            }
            let found = parse(&file, Path::new(PATH)).unwrap();
            check(&found.entries, &[], &written, flushed, &format!("call {call}, {bytes} bytes"));
        }
    }
}
