//! `eit plan`

use crate::cli::PlanArgs;
use crate::commands::prelude::*;
use eit_skin::method;
use eit_skin::plan::{self, Plan, PlanText};
use eit_skin::reactive::ReactiveSkin;

/// Prints the scene, or plans for it.
pub(super) fn run(args: &PlanArgs) -> Result<Answer, CliError> {
    if args.print_scene {
        let text = Scene::text(&args.scene)?;
        let json = json!({ "scene": text });
        return Ok(Answer { text: text.trim_end().to_owned(), json });
    }
    let scene = Scene::load(&args.scene)?;
    let mut progress = progress::terminal();
    let (method, mesh) = (args.method.as_deref(), MeshOverride::default());
    if scene.is_reactive() {
        if method.is_some() {
            scene.refuse_reactive()?;
        }
        let skin = ReactiveSkin::set_up(&scene, &mesh, &mut progress)?;
        let PlanText { text, json } = plan::of_reactive(&skin, &mut progress)?;
        return Ok(Answer { text, json });
    }
    method::choose(&scene.stage_settings(), method, None)?;
    let skin = Skin::set_up(&scene, &mesh, &mut progress)?;
    let plan = Plan::of(skin, method, &mut progress)?;
    Ok(Answer { text: plan.text(), json: plan.json() })
}
