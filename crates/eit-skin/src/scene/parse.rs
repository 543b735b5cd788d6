//! TOML text to a scene; errors on one line with the nearest known key.

use super::Scene;
use crate::error::SkinError;
use serde::de::DeserializeOwned;

/// Parses a scene; `place` is the file or built-in name for messages.
pub fn parse(text: &str, place: &str) -> Result<Scene, SkinError> {
    from_toml(text, place)
}

/// Parses any settings of this kind.
pub fn from_toml<T: DeserializeOwned>(text: &str, place: &str) -> Result<T, SkinError> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map(|span| 1 + text[..span.start].matches('\n').count());
        let at = line.map_or_else(String::new, |l| format!("line {l}: "));
        SkinError::input(format!("{place}: {at}{}", explain(error.message())))
    })
}

/// Names the nearest known key where a key is unknown; other messages are folded to one line.
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
        // further than half of its letters is no typing error
        .filter(|(distance, k)| 2 * distance <= k.len().max(unknown.len()));
    match nearest {
        Some((_, key)) => format!("unknown {what} \"{unknown}\": did you mean \"{key}\"?"),
        None => format!("unknown {what} \"{unknown}\": known are {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        parse(text, "s.toml").unwrap_err().to_string()
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
        for name in super::super::BUILT_IN {
            Scene::load(name).unwrap();
        }
    }
}
