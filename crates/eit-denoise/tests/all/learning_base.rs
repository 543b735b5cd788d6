//! Learning bases that are killed, damaged, of other settings; and what becomes an example.
#![cfg(feature = "base")]

use crate::common::{disc, shard};
use crate::says;
use eit_denoise::{
    BaseSettings, Examples, ImageStack, LearningBase, Part, Shard, TrainDevice, TrainSettings,
};
use ndarray::Array3;
use std::path::Path;

fn base_settings() -> BaseSettings {
    let (skin, recipe) = ("a skin".to_owned(), "bells".to_owned());
    BaseSettings { skin, pixels: [16, 16], seed: 3, shards: 3, recipe }
}

fn fill(base: &mut LearningBase) {
    for index in base.missing() {
        base.write(index, &shard(2 + index, 16)).unwrap();
    }
}

fn filled(folder: &Path) -> LearningBase {
    let mut base = LearningBase::create(folder, &base_settings()).unwrap();
    fill(&mut base);
    base
}

/// The file of a killed program is replaced; what another program is writing is left alone.
#[test]
fn what_a_killed_program_was_writing_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let hidden = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with('.')).collect::<Vec<_>>()
    };
    let left = folder.path().join(".eit-shard-00001.safetensors");
    std::fs::write(&left, b"half of a shard").unwrap();
    filled(folder.path());
    assert!(hidden().is_empty(), "{:?}", hidden());

    std::fs::write(&left, b"half of a shard").unwrap();
    let other = std::fs::File::open(&left).unwrap();
    other.try_lock().unwrap();
    std::fs::remove_file(folder.path().join("shard-00001.safetensors")).unwrap();
    assert!(filled(folder.path()).missing().is_empty());
    assert_eq!(std::fs::read(&left).unwrap(), b"half of a shard");
    assert_eq!(hidden().len(), 1);
}

#[test]
fn a_base_goes_on_where_it_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let mut base = LearningBase::create(folder.path(), &base_settings()).unwrap();
    assert_eq!(base.missing(), [0, 1, 2]);
    base.write(1, &shard(3, 16)).unwrap();
    // killed after a shard was in its place, before the manifest was: it is made again
    std::fs::write(folder.path().join("shard-00002.safetensors"), b"half").unwrap();
    let base = LearningBase::create(folder.path(), &base_settings()).unwrap();
    assert_eq!(base.missing(), [0, 2]);
    says(base.read(2), "not made yet");
    let base = filled(folder.path());
    assert!(base.missing().is_empty());
    assert_eq!((base.frames(), base.read(1).unwrap()), (2 + 3 + 4, shard(3, 16)));
    let whole = tempfile::tempdir().unwrap();
    assert_eq!(filled(whole.path()).checksum().unwrap(), base.checksum().unwrap());

    // a shard that lost its end, and one that lost a bit
    let path = folder.path().join("shard-00001.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 5]).unwrap();
    says(base.read(1), &format!("{} bytes with checksum", bytes.len() - 5));
    let mut changed = bytes.clone();
    changed[500] ^= 1;
    std::fs::write(&path, &changed).unwrap();
    assert_eq!(base.missing(), [1]);
    assert!(filled(folder.path()).missing().is_empty());
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

/// Two parts in one folder, made at the same time, and one part in a folder of its own whose files are
/// copied: each becomes, byte for byte, the base that one process makes.
#[test]
fn parts_merge_into_the_base_of_one_process() {
    let whole = tempfile::tempdir().unwrap();
    let wanted = filled(whole.path());
    let folder = tempfile::tempdir().unwrap();
    let part = |text: &str| text.parse::<Part>().unwrap();
    let create = |folder: &Path, text: &str| {
        LearningBase::create_part(folder, &base_settings(), part(text)).unwrap()
    };
    let mut first = create(folder.path(), "1/2");
    let mut second = create(folder.path(), "2/2");
    assert_eq!((first.missing(), second.missing()), (vec![0, 2], vec![1]));
    fill(&mut second);
    fill(&mut first);
    // a part sees what others made when it is started again
    assert_eq!(create(folder.path(), "1/2").checksum().unwrap(), wanted.checksum().unwrap());
    assert_eq!(LearningBase::open(folder.path()).unwrap().frames(), 2 + 3 + 4);
    let merged = LearningBase::create(folder.path(), &base_settings()).unwrap();
    assert!(merged.missing().is_empty());
    for name in ["manifest.json", "shard-00000.safetensors", "shard-00002.safetensors"] {
        let bytes = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert_eq!(bytes(folder.path()), bytes(whole.path()), "{name}");
    }
    let copied = tempfile::tempdir().unwrap();
    fill(&mut create(copied.path(), "3/3"));
    let other = tempfile::tempdir().unwrap();
    fill(&mut create(other.path(), "1/3"));
    fill(&mut create(other.path(), "2/3"));
    for entry in std::fs::read_dir(other.path()).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, copied.path().join(path.file_name().unwrap())).unwrap();
    }
    let merged = LearningBase::create(copied.path(), &base_settings()).unwrap();
    assert_eq!(merged.checksum().unwrap(), wanted.checksum().unwrap());
    // a part of another base is refused
    let other = BaseSettings { seed: 4, ..base_settings() };
    assert!(LearningBase::create_part(copied.path(), &other, part("1/2")).is_err());
    for text in ["0/2", "3/2", "1", "a/2", "1/0"] {
        assert!(text.parse::<Part>().is_err(), "{text}");
    }
}

#[test]
fn a_base_refuses_other_settings_and_empty_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let mut base = filled(folder.path());
    let other = BaseSettings { seed: 4, ..base_settings() };
    says(LearningBase::create(folder.path(), &other), "the seed is 3 there, but 4 here");
    let none = BaseSettings { shards: 0, ..base_settings() };
    assert!(LearningBase::create(folder.path(), &none).is_err());
    assert!(base.write(3, &shard(2, 16)).is_err());
    refused!(base.write(0, &shard(2, 20)), ShapeMismatch { .. });
    std::fs::write(folder.path().join("manifest.json"), b"{ \"version\": 1").unwrap();
    says(LearningBase::open(folder.path()), "manifest.json: damaged");
    assert!(LearningBase::open(&folder.path().join("nowhere")).is_err());

    let stack = |frames: usize, value: f64| {
        ImageStack::new(Array3::from_elem((frames, 16, 16), value), disc(16, 16)).unwrap()
    };
    refused!(Shard::new(&stack(2, 0.0), &stack(2, 1.0)), NothingToLearn { .. });
    refused!(Shard::new(&stack(2, 1.0), &stack(3, 1.0)), WrongLength { .. });
    refused!(Examples::new(&[], 1), NothingToLearn { .. });
}

/// The touches of a sequence come back from its file; those of another number of frames are damage.
#[test]
fn touches_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let mut made = shard(5, 16);
    let mut touches = Array3::from_elem((5, 2, 3), f32::NAN);
    for (f, mut frame) in touches.outer_iter_mut().enumerate() {
        frame.row_mut(0).assign(&ndarray::arr1(&[0.01 * f as f32, -0.02, 3e-10]));
    }
    made.touches = Some(touches.clone());
    let settings = BaseSettings { shards: 2, ..base_settings() };
    let mut base = LearningBase::create(folder.path(), &settings).unwrap();
    base.write(0, &made).unwrap();
    let read = base.read(0).unwrap().touches.unwrap();
    assert!(read.iter().zip(&touches).all(|(a, b)| a.to_bits() == b.to_bits()));
    made.touches = Some(Array3::zeros((4, 2, 3)));
    base.write(1, &made).unwrap();
    says(base.read(1), "images and touches of different sizes");
}

#[test]
fn settings_and_devices_that_cannot_be_are_refused() {
    for (settings, wanted) in [
        (TrainSettings { rate: f64::NAN, ..Default::default() }, "rate is NaN"),
        (TrainSettings { batch: 0, ..Default::default() }, "batch is 0"),
        (TrainSettings { epochs: 0, ..Default::default() }, "epochs is 0"),
    ] {
        says(settings.validate(), wanted);
    }
    for device in TrainDevice::ALL {
        assert_eq!(device.to_string().parse::<TrainDevice>().unwrap(), device);
    }
    let wanted = "no device is called \"torch\": there are flex (the processor), cuda and wgpu";
    assert_eq!("torch".parse::<TrainDevice>().unwrap_err().to_string(), wanted);
}
