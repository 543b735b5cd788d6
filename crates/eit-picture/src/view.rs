//! The direction from which a mesh in space is drawn.

use eit_core::vector::{cross, dot, norm, normal, unit};
use eit_mesh::Surface;

/// A parallel projection: unit axes to the right, upwards and towards the viewer.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    right: [f64; 3],
    up: [f64; 3],
    eye: [f64; 3],
}

impl View {
    /// The view from +z, as in images.
    pub const TOP: Self =
        Self { right: [1.0, 0.0, 0.0], up: [0.0, 1.0, 0.0], eye: [0.0, 0.0, 1.0] };

    /// Chooses the direction that the surface faces on average; a closed surface is seen from
    /// above, in front and the right.
    pub fn of(surface: &Surface) -> Self {
        let mut mean = [0.0; 3];
        for t in 0..surface.triangles().len() {
            let n = normal(surface.corners(t));
            mean = [0, 1, 2].map(|k| mean[k] + n[k]);
        }
        // each normal is twice as long as its triangle's area
        let area_m2: f64 = surface.areas_m2().iter().sum();
        // a surface with a shorter mean normal is closed or nearly so, and faces no direction
        let eye = match norm(mean) > 2.0 * 0.05 * area_m2 {
            true => unit(mean),
            false => unit([1.0, -1.0, 1.0]),
        };
        // so that mesh and images of a flat skin coincide
        if eye[0].hypot(eye[1]) < 1e-6 && eye[2] > 0.0 {
            return Self::TOP;
        }
        let upwards = if eye[2].abs() > 0.9 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let right = unit(cross(upwards, eye));
        Self { right, up: cross(eye, right), eye }
    }

    /// Projects a point to the page.
    pub fn flat(&self, point: [f64; 3]) -> [f64; 2] {
        [dot(self.right, point), dot(self.up, point)]
    }

    /// Returns the triangles that face the viewer, the furthest first.
    pub fn visible(&self, surface: &Surface) -> Vec<usize> {
        let towards = |&t: &usize| dot(normal(surface.corners(t)), self.eye) > 0.0;
        let mut visible: Vec<usize> = (0..surface.triangles().len()).filter(towards).collect();
        let height = |t: usize| surface.corners(t).iter().map(|&p| dot(p, self.eye)).sum::<f64>();
        // stable sort: on a flat skin the order is kept
        visible.sort_by(|&a, &b| height(a).total_cmp(&height(b)));
        visible
    }

    /// Returns a description for a picture's title; empty for a flat surface seen from +z.
    pub fn description(&self, surface: &Surface) -> String {
        let [low, high] = surface.bounds_m();
        if *self == Self::TOP {
            return if low[2] == high[2] { String::new() } else { ", seen from +z".to_owned() };
        }
        let [x, y, z] = self.eye;
        format!(", seen from [{x:.2}, {y:.2}, {z:.2}]")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(nodes: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Surface {
        Surface::new(nodes, triangles).unwrap()
    }

    /// Lengths in the picture are those of the skin, whatever its orientation.
    #[test]
    fn an_upright_plate_is_seen_from_its_front() {
        let nodes = vec![[0., 0., 0.], [0., 3., 0.], [0., 3., 2.], [0., 0., 2.]];
        let plate = surface(nodes, vec![[0, 1, 2], [0, 2, 3]]);
        let view = View::of(&plate);
        let corners: Vec<[f64; 2]> = plate.nodes().iter().map(|&p| view.flat(p)).collect();
        let apart = |a: usize, b: usize| {
            (corners[a][0] - corners[b][0]).hypot(corners[a][1] - corners[b][1])
        };
        assert!((apart(0, 1) - 3.0).abs() < 1e-12 && (apart(1, 2) - 2.0).abs() < 1e-12);
        assert!(corners[3][1] > corners[0][1], "z points upwards");
        assert_eq!(view.visible(&plate), [0, 1]);
        assert!(view.description(&plate).contains("seen from ["));
    }

    #[test]
    fn flat_skins_are_seen_as_their_images() {
        let flat = surface(vec![[0., 0., 0.], [3., 0., 0.], [0., 2., 0.]], vec![[0, 1, 2]]);
        assert_eq!(View::of(&flat), View::TOP);
        assert_eq!(View::TOP.description(&flat), "");
        assert_eq!(View::TOP.flat([3.0, 2.0, 7.0]), [3.0, 2.0]);
    }

    #[test]
    fn of_a_closed_surface_the_far_side_is_left_out() {
        let corners = vec![[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]];
        let link = surface(corners, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
        let view = View::of(&link);
        let visible = view.visible(&link);
        assert!(!visible.is_empty() && visible.len() < 4, "{visible:?}");
    }
}
