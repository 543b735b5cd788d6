//! Scenes: no text panics or allocates without limit, and a parsed scene is written back unchanged
//! and parses again.
#![no_main]

use eit_skin::Scene;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Scene::parse(text, "fuzz") {
        Ok(mut scene) => {
            assert_eq!(scene.to_toml().expect("as it was"), text);
            // changed settings survive writing and reading
            scene.touch.radius_m = Some(0.01);
            if let Ok(written) = scene.to_toml() {
                let again = Scene::parse(&written, "fuzz").expect("what was written is read");
                assert_eq!(again.to_toml().expect("as it was"), written);
            }
        }
        // errors have a message
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
