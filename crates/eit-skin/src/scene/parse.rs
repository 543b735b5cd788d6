//! Parses TOML into a scene; errors take one line and suggest the nearest known key.

use crate::error::SkinError;
use serde::de::DeserializeOwned;

/// Parses settings of any type.
///
/// # Errors
///
/// Text that is not TOML, unknown keys, and values of the wrong type.
pub fn from_toml<T: DeserializeOwned>(text: &str, place: &str) -> Result<T, SkinError> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map(|span| 1 + text[..span.start].matches('\n').count());
        let at = line.map_or_else(String::new, |l| format!("line {l}: "));
        let written = line.and_then(|line| text.lines().nth(line - 1)).unwrap_or_default();
        let hint = comma_hint(written, error.message());
        // a message of a wrong value does not name its key
        let key = match (error.message().starts_with("invalid "), written.split_once('=')) {
            (true, Some((key, _))) => format!("{}: ", key.trim()),
            _ => String::new(),
        };
        SkinError::input(format!("{place}: {at}{key}{}{hint}", explain(error.message())))
    })
}

/// Explains a decimal comma, which TOML takes for the end of a number.
fn comma_hint(line: &str, message: &str) -> &'static str {
    let value = line.split_once('=').map_or("", |(_, value)| value.trim());
    let is_number = value.split_once(',').is_some_and(|(whole, decimals)| {
        whole.parse::<f64>().is_ok() && decimals.starts_with(|c: char| c.is_ascii_digit())
    });
    match is_number && !message.starts_with("unknown") {
        true => "; write a decimal point, not a comma",
        false => "",
    }
}

/// Suggests the nearest known key if a key is unknown; folds other messages to one line.
fn explain(message: &str) -> String {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let known = quoted.get(1..).unwrap_or_default();
    let is_key = message.starts_with("unknown field");
    if !(is_key || message.starts_with("unknown variant")) || known.is_empty() {
        return message.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    }
    let what = if is_key { "key" } else { "value" };
    let unknown = quoted[0];
    let nearest = known
        .iter()
        .map(|k| (strsim::damerau_levenshtein(unknown, k), k))
        .min()
        // beyond half of its letters it is no typing error
        .filter(|(distance, k)| 2 * distance <= k.len().max(unknown.len()));
    match nearest {
        Some((_, key)) => format!("unknown {what} \"{unknown}\": did you mean \"{key}\"?"),
        None => format!("unknown {what} \"{unknown}\": the known ones are {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    fn error(text: &str) -> String {
        from_toml::<Scene>(text, "s.toml").unwrap_err().to_string()
    }

    #[test]
    fn unknown_keys_and_values_get_the_nearest_known_one() {
        let found = error("[skin]\nshape = \"disc\"\nradus_m = 1\nconductivity_s = 1\n");
        assert_eq!(found, "s.toml: line 3: unknown key \"radus_m\": did you mean \"radius_m\"?");
        let found = error("[skin]\nshape = \"disk\"\nconductivity_s = 1\n");
        assert_eq!(found, "s.toml: line 2: unknown value \"disk\": did you mean \"disc\"?");
        let found = error("[skinn]\n");
        assert!(found.contains("did you mean \"skin\"?"), "{found}");
    }

    /// Scenes that were read and scenes built in code are equal as TOML.
    #[test]
    fn scenes_are_written_and_read_back() {
        for (name, _) in super::super::builtin::SCENES {
            let scene = Scene::load(name).unwrap();
            assert_eq!(scene.to_toml().unwrap(), Scene::text(name).unwrap());
            let mut changed = scene.clone();
            changed.noise.quiet_frames = Some((0..20).into());
            let text = changed.to_toml().unwrap();
            let again: Scene = from_toml(&text, name).unwrap();
            assert_eq!(again.noise, changed.noise, "{text}");
            assert_eq!(again.skin, scene.skin, "{text}");
            assert_eq!(again.electrodes, scene.electrodes, "{text}");
            assert_eq!(again.protocol, scene.protocol, "{text}");
            // the fingerprint does not depend on other sections, nor on how the scene is written
            let fingerprint = scene.skin_fingerprint().unwrap();
            assert_eq!(fingerprint.len(), 8);
            assert_eq!(changed.skin_fingerprint().unwrap(), fingerprint);
            assert_eq!(again.skin_fingerprint().unwrap(), fingerprint);
        }
        // that of the shipped net
        let scene = Scene::load("paper-disc").unwrap();
        assert_eq!(scene.skin_fingerprint().unwrap(), "6d1b102e");
    }

    #[test]
    fn a_decimal_comma_is_explained() {
        let found = error("[skin]\nshape = \"disc\"\nradius_m = 0,1\nconductivity_s = 1\n");
        assert!(found.starts_with("s.toml: line 3: "), "{found}");
        assert!(found.ends_with("; write a decimal point, not a comma"), "{found}");
        let found = error("[skin]\noutline = [0,1], [0,2]\n");
        assert!(!found.contains("decimal"), "{found}");
    }

    #[test]
    fn wrong_types_and_broken_toml_are_one_line() {
        for text in
            ["[skin]\nshape = \"disc\"\nradius_m = \"x\"\nconductivity_s = 1", "[skin\n", ""]
        {
            let found = error(text);
            assert!(!found.contains('\n') && found.starts_with("s.toml: "), "{found}");
        }
    }

    #[test]
    fn built_in_scenes_parse() {
        for (name, _) in super::super::builtin::SCENES {
            Scene::load(name).unwrap();
        }
    }
}
