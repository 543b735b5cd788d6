//! `eit mesh`

use crate::cli::MeshArgs;
use crate::commands::prelude::*;
use eit_mesh::{GmshVersion, Mesh, Quality};
use eit_picture::{ColorMap, MeshDrawing, PictureSettings, SkinDrawing, View, draw_mesh};
use eit_report::ReportError;
use eit_skin::scene::{MeshChoice, element_text};
use std::io::Write;

/// Generates the mesh, reports its quality, and writes it.
pub(super) fn run(args: &MeshArgs) -> Result<Answer, CliError> {
    let format = check_ending(&args.out, &["msh", "vtu", "png"])?;
    let scene = Scene::load(&args.scene)?;
    let out = OutFile::new(&args.out)?;
    let wanted = scene.mesh(args.nodes)?;
    let mut progress = progress::terminal();
    let MeshChoice { mesh, element_order, notes, accuracy } =
        scene.choose_mesh(&wanted, args.nodes.is_some(), &mut progress)?;
    let quality = Quality::of(&mesh);
    out.write(|writer| match format.as_str() {
        "msh" => Ok(eit_mesh::write_gmsh(&mesh, &mut &mut *writer, GmshVersion::V4_1, &[])?),
        "vtu" => Ok(eit_mesh::write_vtu(&mesh, &mut &mut *writer, &[])?),
        _ => picture(&mesh, &scene.name, writer),
    })?;
    // length in metres, or area in square metres, of each electrode
    let measures = (0..mesh.electrodes().len()).map(|l| mesh.electrode_measure(l));
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "electrode_measures": measures.collect::<Vec<_>>(),
        "elements": element_text(element_order),
        "accuracy": accuracy,
        "mesh_notes": notes,
        "stages": progress.times(),
    });
    let chosen = accuracy.map_or_else(String::new, |accuracy| {
        format!("\nfor {} elements: {}", element_text(element_order), accuracy.description())
    });
    let text = format!("{quality}{chosen}\nwritten: {}", args.out.display());
    Ok(Answer { text, json: joined(json, quality) })
}

fn picture(mesh: &Mesh, name: &str, writer: &mut dyn Write) -> Result<(), ReportError> {
    let surface = mesh.surface();
    let view = View::of(surface);
    let nodes_m: Vec<[f64; 2]> = surface.nodes().iter().map(|&p| view.flat(p)).collect();
    let visible = view.visible(surface);
    let triangles: Vec<[usize; 3]> =
        visible.iter().map(|&t| surface.triangles()[t].map(|n| n as usize)).collect();
    let quality: Vec<f64> = visible.iter().map(|&t| surface.triangle_quality(t)).collect();
    let drawing = MeshDrawing { nodes_m: &nodes_m, triangles: &triangles, values: Some(&quality) };
    let hidden = surface.triangles().len() - visible.len();
    let settings = PictureSettings {
        title: format!("{name}: mesh{}", view.description(surface)),
        footnote: match hidden {
            0 => String::new(),
            _ => format!("{hidden} more triangles face away"),
        },
        quantity: "quality".to_owned(),
        unit: String::new(),
        map: ColorMap::Viridis,
        range: Some([0.0, 1.0]),
        ..Default::default()
    };
    Ok(draw_mesh(&drawing, &SkinDrawing::from_mesh(mesh, &view), &settings)?.write_png(writer)?)
}
