//! Files of settings: scenes, scripts of touches, lists of patches.

use crate::error::SkinError;
use std::io::Read as _;
use std::path::Path;

/// Maximum size of a file of settings in bytes; the largest of this project has 3 kB. A parsed number takes up to
/// 80 times the bytes of its text.
pub(super) const MOST_BYTES: u64 = 1 << 19;

/// Reads a file of settings, which is TOML.
///
/// # Errors
///
/// A file that cannot be read, is longer than 512 kB or not text; a device or pipe, which may have no end.
pub fn read_settings(path: impl AsRef<Path>) -> Result<String, SkinError> {
    let path = path.as_ref();
    let place = path.display();
    let refused = |why: String| SkinError::input(format!("{place}: {why}"));
    let data = std::fs::metadata(path).map_err(|e| refused(e.to_string()))?;
    let too_long = || refused(format!("not a file of at most {} kB", MOST_BYTES >> 10));
    if !data.is_file() {
        return Err(too_long());
    }
    let (file, mut bytes) = (eit_hw::regular_file(path)?, Vec::new());
    // one extra byte reveals a longer file; the size stated by the system may be wrong
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(|e| refused(e.to_string()))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(too_long());
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        refused(format!("byte {at}: not text; it must be TOML in UTF-8"))
    })
}
