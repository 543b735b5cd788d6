//! Draws a mesh: edges, electrodes and optionally a value per triangle.

use crate::{
    PictureError, PictureSettings, PointOf, SkinDrawing,
    canvas::{Canvas, LINE, Rgb},
    page::{Page, PageSettings},
    panel::Panel,
    scale::Scale,
    sheet::joined,
    text::Font,
};

/// A triangulation in the plane.
#[derive(Clone, Copy, Debug)]
pub struct MeshDrawing<'a> {
    /// Nodes in metres.
    pub nodes_m: &'a [[f64; 2]],
    /// Triangles as indices of nodes, from 0.
    pub triangles: &'a [[usize; 3]],
    /// One value per triangle, for example its conductivity; NaN is left white.
    pub values: Option<&'a [f64]>,
}

/// Draws a mesh with the electrodes of the skin on top, and its outline if it has one.
///
/// `settings` provides colours, bar and texts; the footnote gives the numbers of nodes and
/// triangles.
///
/// # Errors
/// A number of values other than the number of triangles, nodes that do not exist, coordinates that
/// are not finite.
pub fn draw_mesh(
    mesh: &MeshDrawing<'_>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
) -> Result<Canvas, PictureError> {
    let (nodes, triangles) = (mesh.nodes_m.len(), mesh.triangles.len());
    check(mesh)?;
    let zoom = settings.zoom.clamp(1, 4);
    let font = Font::load()?;
    let panel = Panel::new(skin, 480.0, zoom, &font)?;
    let scale = mesh.values.map(|values| Scale::new(values.iter(), settings)).transpose()?;
    let mut notes =
        vec![settings.footnote.clone(), format!("{nodes} nodes, {triangles} triangles")];
    notes.extend(scale.iter().flat_map(|scale| scale.remarks.iter().cloned()));
    let page = Page::new(
        &PageSettings {
            title: &settings.title,
            note: &joined(&notes),
            cells: 1,
            columns: None,
            cell_size: panel.size,
            label_width: None,
            scale: scale.as_ref(),
            zoom,
        },
        font,
    );
    let (mut canvas, corner) = (page.canvas, page.corners[0]);
    let at = |node: usize| {
        let [x, y] = panel.to_page(mesh.nodes_m[node]);
        [corner[0] + x, corner[1] + y]
    };
    if let (Some(scale), Some(values)) = (&scale, mesh.values) {
        for (triangle, value) in mesh.triangles.iter().zip(values).filter(|(_, v)| !v.is_nan()) {
            fill_triangle(&mut canvas, triangle.map(at), scale.color(scale.bounded(*value)));
        }
    }
    draw_edges(&mut canvas, mesh.triangles, at);
    panel.draw_skin(&mut canvas, corner);
    Ok(canvas)
}

fn check(mesh: &MeshDrawing<'_>) -> Result<(), PictureError> {
    let (nodes, triangles) = (mesh.nodes_m.len(), mesh.triangles.len());
    if let Some(values) = mesh.values.map(<[f64]>::len).filter(|values| *values != triangles) {
        return Err(PictureError::ValueCount { values, triangles });
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&node) = corners.iter().find(|node| **node >= nodes) {
            return Err(PictureError::NodeIndex { triangle, node, nodes });
        }
    }
    for (index, &[x_m, y_m]) in mesh.nodes_m.iter().enumerate() {
        if !(x_m.is_finite() && y_m.is_finite()) {
            return Err(PictureError::Coordinates { what: PointOf::Node, index, x_m, y_m });
        }
    }
    Ok(())
}

/// Draws each edge once.
fn draw_edges(canvas: &mut Canvas, triangles: &[[usize; 3]], at: impl Fn(usize) -> [f64; 2]) {
    let mut edges: Vec<[usize; 2]> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    for [a, b] in edges {
        let (a, b) = (at(a), at(b));
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        // edges shorter than 7 points are paler, so that a fine mesh does not turn black
        canvas.stroke(&[a, b], 0.6, LINE, (length / 7.0).clamp(0.15, 1.0));
    }
}

/// Fills the pixels whose centres lie in a triangle of either orientation. A centre on an edge
/// belongs to both triangles, so that no gap shows.
fn fill_triangle(canvas: &mut Canvas, corners: [[f64; 2]; 3], color: Rgb) {
    let zoom = canvas.zoom() as f64;
    let [a, b, c] = corners.map(|p| p.map(|at| at * zoom));
    let size = canvas.size_px();
    let range = |axis: usize| {
        let low = a[axis].min(b[axis]).min(c[axis]).max(0.0) as usize;
        let high = a[axis].max(b[axis]).max(c[axis]).ceil().max(0.0) as usize;
        low..high.min(size[axis])
    };
    let side = |p: [f64; 2], q: [f64; 2], x: [f64; 2]| {
        (q[0] - p[0]) * (x[1] - p[1]) - (q[1] - p[1]) * (x[0] - p[0])
    };
    for y in range(1) {
        for x in range(0) {
            let at = [x as f64 + 0.5, y as f64 + 0.5];
            let sides = [side(a, b, at), side(b, c, at), side(c, a, at)];
            if sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0) {
                canvas.blend(x as i64, y as i64, color, 1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColorMap, fixtures_for_tests::disc};

    const NODES: [[f64; 2]; 4] = [[-0.1, 0.0], [0.1, 0.0], [0.0, 0.1], [0.0, -0.1]];
    const TRIANGLES: [[usize; 3]; 2] = [[0, 1, 2], [0, 1, 3]];

    fn draw(triangles: &[[usize; 3]], values: Option<&[f64]>) -> Result<Canvas, PictureError> {
        let settings = PictureSettings { zoom: 1, map: ColorMap::Viridis, ..Default::default() };
        draw_mesh(&MeshDrawing { nodes_m: &NODES, triangles, values }, &disc(4), &settings)
    }

    #[test]
    fn triangles_have_the_colors_of_their_values() {
        let canvas = draw(&TRIANGLES, Some(&[1.0, 3.0])).unwrap();
        let count = |color: Rgb| canvas.rgb().chunks_exact(3).filter(|p| *p == color).count();
        let (low, high) =
            (count(ColorMap::Viridis.color(0.0)), count(ColorMap::Viridis.color(1.0)));
        // each is half of a square on the diagonals of a disc of about 225 points; edges,
        // electrodes and anti-aliasing hide up to a tenth
        let area = 225.0 * 225.0;
        for pixels in [low, high] {
            assert!((0.9..1.05).contains(&(pixels as f64 / area)), "{pixels} of {area}");
        }
    }

    #[test]
    fn a_mesh_without_triangles_or_values_is_drawn() {
        draw(&[], None).unwrap();
        draw(&[], Some(&[])).unwrap();
        draw(&TRIANGLES, Some(&[f64::NAN, f64::INFINITY])).unwrap();
        draw(&[[0, 0, 0]], Some(&[1.0])).unwrap();
    }

    #[test]
    fn what_does_not_fit_the_mesh_is_refused() {
        let error = draw(&TRIANGLES, Some(&[1.0])).unwrap_err();
        assert_eq!(error.to_string(), "1 values for 2 triangles; give one for each triangle");
        let error = draw(&[[0, 1, 4]], None).unwrap_err();
        assert!(matches!(error, PictureError::NodeIndex { triangle: 0, node: 4, nodes: 4 }));
    }
}
