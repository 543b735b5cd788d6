//! One picture of every kind, of a disc with a finger moving around it.
//!
//! Run with `cargo run --release -p eit-picture --example gallery -- DIR`.
#![allow(missing_docs, reason = "an example is read, not linked against")]

use eit_mesh::{
    Direction, Mesh, MeshSettings, Placement, Raster, RimElectrodes, SkinShape, generate,
};
use eit_picture::{
    Canvas, ColorMap, FrameLabels, MeshDrawing, PictureSettings, Plot, Series, SkinDrawing, Track,
    TracksPanel, View, draw_mesh, draw_plot, draw_sheet, draw_tracks, write_gif,
};
use ndarray::Array3;
use std::error::Error;
use std::f64::consts::TAU;
use std::fs::File;
use std::path::Path;

/// Number of frames in the movie, and frames per second.
const FRAMES: usize = 8;
const RATE_HZ: f64 = 10.0;

/// Draws all pictures into a folder and returns the width and height of each PNG.
pub fn run(folder: &Path) -> Result<Vec<[usize; 2]>, Box<dyn Error>> {
    let mesh = disc()?;
    let raster = Raster::new(mesh.surface(), 64)?;
    let skin = SkinDrawing::from_raster(&mesh, &raster);
    let images = finger(&raster);
    let settings = PictureSettings {
        title: "A finger walks around".to_owned(),
        labels: FrameLabels::Time { rate_hz: RATE_HZ },
        marks_m: (0..FRAMES).map(|frame| vec![place_m(frame)]).collect(),
        ..Default::default()
    };
    let pictures = [
        ("sheet.png", draw_sheet(images.view(), &skin, &settings)?),
        ("mesh.png", quality(&mesh)?),
        ("tracks.png", tracks(&skin)?),
        ("plot.png", decay()?),
    ];
    for (name, picture) in &pictures {
        picture.write_png(File::create(folder.join(name))?)?;
    }
    let movie = File::create(folder.join("movie.gif"))?;
    write_gif(images.view(), &skin, &settings, RATE_HZ, movie, &mut |_, _| {})?;
    Ok(pictures.iter().map(|(_, picture)| picture.size_px()).collect())
}

/// A disc of 0.1 m with 16 electrodes.
fn disc() -> Result<Mesh, eit_mesh::MeshError> {
    let placement = Placement::EquallySpaced {
        count: 16,
        first_angle_deg: 90.0,
        direction: Direction::Counterclockwise,
    };
    let electrodes = RimElectrodes { width_m: 0.0196, placement };
    generate(&SkinShape::Disc { radius_m: 0.1 }, &electrodes, &MeshSettings::default())
}

/// Returns the finger's position.
fn place_m(frame: usize) -> [f64; 2] {
    let angle = TAU * frame as f64 / FRAMES as f64;
    [0.05 * angle.cos(), 0.05 * angle.sin()]
}

/// Returns the conductivity change it causes, in siemens: [frame, row, column].
fn finger(raster: &Raster) -> Array3<f64> {
    let pixels = raster.pixels();
    Array3::from_shape_fn((FRAMES, pixels, pixels), |(frame, row, column)| {
        let ([x, y], [finger_x, finger_y]) = (raster.centre_m(row, column), place_m(frame));
        let squared = (x - finger_x).powi(2) + (y - finger_y).powi(2);
        let change = 2e-6 * (-squared / (2.0 * 0.02_f64.powi(2))).exp();
        if raster.mask()[[row, column]] { change } else { f64::NAN }
    })
}

/// Draws the areas of the triangles.
fn quality(mesh: &Mesh) -> Result<Canvas, eit_picture::PictureError> {
    let surface = mesh.surface();
    let triangles: Vec<[usize; 3]> =
        surface.triangles().iter().map(|corners| corners.map(|node| node as usize)).collect();
    let nodes_m: Vec<[f64; 2]> = surface.nodes().iter().map(|&p| View::TOP.flat(p)).collect();
    let areas: Vec<f64> = surface.areas_m2().iter().map(|area| 1e6 * area).collect();
    let drawing =
        MeshDrawing { nodes_m: &nodes_m, triangles: &triangles, values: Some(&areas[..]) };
    let settings = PictureSettings {
        title: "Areas of the triangles".to_owned(),
        quantity: "area".to_owned(),
        unit: "mm²".to_owned(),
        map: ColorMap::Viridis,
        ..Default::default()
    };
    draw_mesh(&drawing, &SkinDrawing::from_mesh(mesh, &View::TOP), &settings)
}

/// Draws the true and detected positions of the finger.
fn tracks(skin: &SkinDrawing) -> Result<Canvas, eit_picture::PictureError> {
    let true_m: Vec<[f64; 2]> = (0..=FRAMES).map(place_m).collect();
    let found_m = true_m.iter().map(|[x, y]| [x + 0.003, y - 0.002]).collect();
    let track =
        |name: &str, places_m, is_truth| Track { name: name.to_owned(), places_m, is_truth };
    let tracks = vec![track("the finger", true_m, true), track("found", found_m, false)];
    let panel = TracksPanel { label: "one finger".to_owned(), tracks, first_color: 0 };
    draw_tracks(&[panel], skin, &PictureSettings { zoom: 2, ..Default::default() })
}

/// Draws errors that decrease with the edge length, of first and second order.
fn decay() -> Result<Canvas, eit_picture::PictureError> {
    let series = |order: i32| Series {
        name: format!("order {order}"),
        points: (0..6)
            .map(|k| 0.1 * 0.5_f64.powi(k))
            .map(|edge| [edge, edge.powi(order)])
            .collect(),
        line: true,
        markers: true,
    };
    draw_plot(&Plot {
        title: "Error against edge length".to_owned(),
        footnote: "Halving the edge length halves one error and quarters the other".to_owned(),
        x_label: "edge (m)".to_owned(),
        y_label: "relative error".to_owned(),
        x_log: true,
        y_log: true,
        series: vec![series(1), series(2)],
        zoom: 2,
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".to_owned());
    run(Path::new(&folder)).map(|_| ())
}
