//! `eit plan`

use super::Answer;
use crate::cli::PlanArgs;
use crate::error::CliError;
use crate::progress;
use eit_skin::plan::{self, Plan};
use eit_skin::scene::Scene;
use serde_json::json;

/// Prints the scene, or what it needs.
pub(crate) fn run(args: &PlanArgs) -> Result<Answer, CliError> {
    if args.print_scene {
        let text = Scene::text(&args.scene)?;
        let json = json!({ "scene": text });
        return Ok(Answer { text: text.trim_end().to_owned(), json });
    }
    let scene = Scene::load(&args.scene)?;
    let Plan { text, json } = plan::plan(scene, args.method.as_deref(), &mut progress::terminal())?;
    Ok(Answer { text, json })
}
