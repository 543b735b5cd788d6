//! The example runs and draws the documented pictures.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[cfg(feature = "mesh")]
#[path = "../examples/gallery.rs"]
#[allow(dead_code, reason = "main of the example is not called here")]
mod gallery;

/// Every file is a picture of the returned size; a point is two pixels, so all sizes are even.
#[cfg(feature = "mesh")]
#[test]
fn gallery_example() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = gallery::run(folder.path()).unwrap();
    for (name, size) in ["sheet", "mesh", "tracks", "plot"].iter().zip(&sizes) {
        let bytes = std::fs::read(folder.path().join(format!("{name}.png"))).unwrap();
        // header of a PNG: width and height, four bytes each from the 17th byte on
        let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!([number(16) as usize, number(20) as usize], *size, "{name}");
        assert!(size.iter().all(|length| length % 2 == 0), "{name}: {size:?}");
    }
    let movie = std::fs::read(folder.path().join("movie.gif")).unwrap();
    assert_eq!(movie[..6], *b"GIF89a");
}
