//! Fills the interior of the rim with nodes: frontal Delaunay insertion that follows the size
//! field, then refinement to an angle limit.

use super::rim::Rim;
use crate::MeshError;
use crate::geometry::distance;
use crate::size_field::SizeField;
use spade::handles::{FaceHandle, FixedFaceHandle, FixedVertexHandle, InnerTag};
use spade::{
    AngleLimit, ConstrainedDelaunayTriangulation, Point2, PositionInTriangulation,
    RefinementParameters, Triangulation as _,
};
use std::collections::VecDeque;

pub(crate) type Cdt = ConstrainedDelaunayTriangulation<Point2<f64>>;
type Face<'a> = FaceHandle<'a, InnerTag, Point2<f64>, (), spade::CdtEdge<()>, ()>;

/// Points and triangles; rim nodes come first.
#[derive(Debug, Clone)]
pub(crate) struct Triangulation {
    pub points: Vec<[f64; 2]>,
    /// Counter-clockwise.
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle is small enough when its circumradius is below this multiple of that of the
/// equilateral triangle with the requested edge length.
const RADIUS_SLACK: f64 = 1.2;
/// Minimum distance of a new node from every other, as a fraction of the requested edge length.
const CLEARANCE: f64 = 0.7;
/// Above 28 degrees, Delaunay refinement inserts many nodes for little gain; above 30 degrees it
/// may not terminate.
const ANGLE_LIMIT_DEG: f64 = 28.0;

/// Computes the Delaunay triangulation of points, keeping the rim edges.
pub(crate) fn triangulate(points: &[[f64; 2]], edges: &[[u32; 2]]) -> Result<Cdt, MeshError> {
    let vertices =
        points.iter().map(|p| spade::mitigate_underflow(Point2::new(p[0], p[1]))).collect();
    let constraints = edges.iter().map(|e| e.map(|n| n as usize)).collect();
    let mut conflict = None;
    let cdt = Cdt::try_bulk_load_cdt(vertices, constraints, |e| conflict = Some(e));
    let place =
        |at: [f64; 2], problem| Err(MeshError::BadOutline { x_m: at[0], y_m: at[1], problem });
    match (cdt, conflict) {
        (Ok(cdt), None) if cdt.num_vertices() == points.len() => Ok(cdt),
        (Ok(_), Some([node, _])) => {
            place(points.get(node).copied().unwrap_or_default(), "rim edges cross here")
        }
        _ => place(points.first().copied().unwrap_or_default(), "two nodes are at the same place"),
    }
}

/// Finds for each inner face of the triangulation (by index) whether it lies inside the rim:
/// starting from outside, crossing a rim edge changes sides.
fn inside(cdt: &Cdt) -> Vec<bool> {
    let mut inside = vec![false; cdt.num_all_faces()];
    let mut seen = vec![false; cdt.num_all_faces()];
    let outer = cdt.outer_face();
    seen[outer.index()] = true;
    let mut queue = Vec::new();
    let hull = cdt.convex_hull().map(|edge| (edge.rev().face().fix(), edge.is_constraint_edge()));
    for (face, crossed) in hull {
        if !std::mem::replace(&mut seen[face.index()], true) {
            inside[face.index()] = crossed;
            queue.push(face);
        }
    }
    while let Some(face) = queue.pop() {
        let from = inside[face.index()];
        let Some(face) = cdt.face(face).as_inner() else { continue };
        for edge in face.adjacent_edges() {
            let next = edge.rev().face().fix();
            if !std::mem::replace(&mut seen[next.index()], true) {
                inside[next.index()] = from != edge.is_constraint_edge();
                queue.push(next);
            }
        }
    }
    inside
}

/// Returns the points and the triangles inside the rim.
pub(crate) fn extract(cdt: &Cdt) -> Triangulation {
    let inside = inside(cdt);
    let points = cdt.vertices().map(|v| [v.position().x, v.position().y]).collect();
    let triangles = cdt
        .inner_faces()
        .filter(|face| inside[face.index()])
        .map(|face| face.vertices().map(|v| v.index() as u32))
        .collect();
    Triangulation { points, triangles }
}

/// Fills the interior of the rim.
pub(crate) fn fill(
    rim: &Rim,
    field: &SizeField,
    node_limit: usize,
) -> Result<Triangulation, MeshError> {
    let mut cdt = triangulate(&rim.points, &rim.edges)?;
    advance(&mut cdt, field, node_limit);
    let spare = node_limit.saturating_sub(cdt.num_vertices());
    let parameters = RefinementParameters::new()
        .exclude_outer_faces(true)
        .keep_constraint_edges()
        .with_angle_limit(AngleLimit::from_deg(ANGLE_LIMIT_DEG))
        .with_max_additional_vertices(spare);
    if !cdt.refine(parameters).refinement_complete {
        let nodes = cdt.num_vertices();
        return Err(MeshError::RefinementIncomplete { nodes, limit: node_limit });
    }
    Ok(extract(&cdt))
}

/// Where the next node goes.
enum Next {
    /// The triangle is small enough.
    Done,
    /// Too large, but not yet adjacent to an accepted triangle or the rim; processed later.
    Waiting,
    /// Opposite the front edge, or at the circumcentre if that is nearer.
    Insert(Point2<f64>),
}

/// Inserts nodes layer by layer from the rim until every triangle has the requested size, stopping
/// at `node_limit`.
///
/// Each new node forms a triangle of the requested size with an edge of an accepted triangle or of
/// the rim (frontal Delaunay, Rebay 1993; "off-centres", Erten and Uengoer 2009). This leaves far
/// fewer badly shaped triangles than inserting circumcentres.
fn advance(cdt: &mut Cdt, field: &SizeField, node_limit: usize) {
    let outside: Vec<bool> = inside(cdt).iter().map(|i| !i).collect();
    let is_outside = |face: usize| outside.get(face).copied().unwrap_or(false);
    let mut queue: VecDeque<FixedFaceHandle<InnerTag>> = cdt.fixed_inner_faces().collect();
    while let Some(face) = queue.pop_front() {
        if is_outside(face.index()) || cdt.num_vertices() >= node_limit {
            continue;
        }
        let handle = cdt.face(face);
        let hint = handle.vertices()[0].fix();
        let Next::Insert(point) = next_node(handle, field) else { continue };
        if !is_clear(cdt, point, hint, field, &is_outside) {
            continue;
        }
        // the position is finite and of similar magnitude to its neighbours, so spade accepts it
        let Ok(vertex) = cdt.insert_with_hint(point, hint) else { continue };
        for edge in cdt.vertex(vertex).out_edges() {
            queue.extend(edge.face().fix().as_inner());
            queue.extend(edge.next().rev().face().fix().as_inner());
        }
    }
}

fn is_small(face: Face<'_>, field: &SizeField) -> bool {
    let (_, radius_squared) = face.circumcircle();
    let c = face.center();
    let wanted = RADIUS_SLACK / 3f64.sqrt() * field.at([c.x, c.y]);
    radius_squared <= wanted * wanted
}

fn next_node(face: Face<'_>, field: &SizeField) -> Next {
    if is_small(face, field) {
        return Next::Done;
    }
    let front = face
        .adjacent_edges()
        .into_iter()
        .filter(|edge| {
            edge.is_constraint_edge()
                || edge.rev().face().as_inner().is_some_and(|across| is_small(across, field))
        })
        .min_by(|a, b| a.length_2().total_cmp(&b.length_2()));
    let Some(edge) = front else { return Next::Waiting };
    let [a, b] = edge.positions();
    let length = distance([a.x, a.y], [b.x, b.y]);
    let middle = [0.5 * (a.x + b.x), 0.5 * (a.y + b.y)];
    // the face lies on the left of its edges
    let normal = [-(b.y - a.y) / length, (b.x - a.x) / length];
    let (centre, _) = face.circumcircle();
    let to_centre = (centre.x - middle[0]) * normal[0] + (centre.y - middle[1]) * normal[1];
    let equilateral = 0.75f64.sqrt() * length;
    let ahead = [middle[0] + equilateral * normal[0], middle[1] + equilateral * normal[1]];
    let side = field.at(ahead).clamp(0.75 * length, 1.5 * length);
    let height = (side * side - 0.25 * length * length).sqrt();
    if height >= to_centre {
        return Next::Insert(centre);
    }
    Next::Insert(Point2::new(middle[0] + height * normal[0], middle[1] + height * normal[1]))
}

/// Whether a point is inside the rim and far enough from the corners of the triangle that contains
/// it.
fn is_clear(
    cdt: &Cdt,
    point: Point2<f64>,
    hint: FixedVertexHandle,
    field: &SizeField,
    is_outside: &impl Fn(usize) -> bool,
) -> bool {
    let clearance = CLEARANCE * field.at([point.x, point.y]);
    let away = |p: Point2<f64>| distance([p.x, p.y], [point.x, point.y]) >= clearance;
    match cdt.locate_with_hint(point, hint) {
        PositionInTriangulation::OnFace(face) => {
            !is_outside(face.index()) && cdt.face(face).positions().into_iter().all(away)
        }
        PositionInTriangulation::OnEdge(edge) => {
            let edge = cdt.directed_edge(edge);
            !edge.is_constraint_edge() && edge.positions().into_iter().all(away)
        }
        _ => false,
    }
}
