//! Cuts an outline into rim edges that follow the size field.

use crate::MeshError;
use crate::geometry::{Loop, Outline, distance};
use crate::rim_electrodes::RimInterval;
use crate::settings::MeshSettings;
use crate::size_field::{SizeField, Source};

/// The outline cut into edges.
#[derive(Default)]
pub(crate) struct Rim {
    /// Rim nodes, loop by loop.
    pub points: Vec<[f64; 2]>,
    /// Rim edges, with the skin on their left.
    pub edges: Vec<[u32; 2]>,
    /// Rim edges of each electrode, in the order of their loop.
    pub electrodes: Vec<Vec<[u32; 2]>>,
    /// First node of each loop, followed by the number of nodes.
    pub starts: Vec<usize>,
    /// Edges that approximate arcs, with the midpoints of the arcs.
    pub arc_midpoints: Vec<([u32; 2], [f64; 2])>,
}

/// Longest allowed edge relative to the distance to the opposite part of the outline: the triangles
/// between them keep angles of about 35 degrees.
const NARROW: f64 = 1.25;
/// Rounds of cutting at narrow places. Along a strip, each round divides the distance between
/// sources by at least four; six rounds leave at most a few slightly long edges.
const NARROW_ROUNDS: usize = 6;

/// Minimum number of sides of the polygon that approximates a round patch.
const FEWEST_CHORDS: f64 = 12.0;

/// A place on a loop that must become a node.
#[derive(Clone, Copy)]
struct Breakpoint {
    s_m: f64,
    /// Requested edge length at an electrode end or a re-entrant corner; `None` at other corners.
    end_size_m: Option<f64>,
}

/// Cuts the outline and builds the size field for the interior.
///
/// Where two parts of the outline are closer than the edge length requested there, the field is
/// lowered to their distance and the outline is cut again. The last loops are the outlines of
/// patches; `patch_edges_m` gives the edge length for each.
pub(crate) fn cut(
    outline: &Outline,
    electrodes: &[RimInterval],
    settings: &MeshSettings,
    edge_m: f64,
    patch_edges_m: &[f64],
) -> Result<(Rim, SizeField), MeshError> {
    let skin_loops = outline.loops().len() - patch_edges_m.len();
    let end_m = |width_m: f64| settings.electrode_edge_m.unwrap_or(width_m / 6.0).min(edge_m);
    // as fine as the finest electrode
    let ends_m = electrodes.iter().map(|e| end_m(e.width_m)).chain(patch_edges_m.iter().copied());
    let corner_m = ends_m.fold(edge_m, f64::min);
    let mut sources = Vec::new();
    let mut breakpoints = Vec::new();
    for (index, l) in outline.loops().iter().enumerate() {
        let on_loop: Vec<_> = electrodes.iter().filter(|e| e.loop_index == index).collect();
        let places = match index.checked_sub(skin_loops).and_then(|k| patch_edges_m.get(k)) {
            Some(&patch_edge_m) => patch_places(l, patch_edge_m),
            None => breakpoints_of(l, &on_loop, &end_m, corner_m, outline.resolution_m()),
        };
        for (k, place) in places.iter().enumerate() {
            let shorter = span(&places, k + places.len() - 1, l).min(span(&places, k, l));
            // a gap between electrodes carries a potential step and needs at least two edges
            let size = place.end_size_m.map_or(shorter, |size| size.min(0.5 * shorter));
            sources.push((l.point_at(place.s_m), size));
        }
        breakpoints.push(places);
    }
    let chord_m =
        outline.loops()[..skin_loops].iter().map(Loop::largest_chord_m).fold(edge_m, f64::min);
    let bounds = outline.bounds_m();
    let mut field = SizeField::new(chord_m, settings.grading, bounds, &sources);
    for _ in 0..NARROW_ROUNDS {
        let cuts = cut_loops(outline, &breakpoints, &field, settings.node_limit)?;
        let narrow = narrow_places(outline, &cuts, &field, settings.grading);
        if narrow.is_empty() {
            break;
        }
        sources.extend(narrow);
        field = SizeField::new(chord_m, settings.grading, bounds, &sources);
    }
    let cuts = cut_loops(outline, &breakpoints, &field, settings.node_limit)?;
    Ok((number(outline, &cuts, electrodes), field))
}

/// Computes the arc lengths of the nodes on each loop.
fn cut_loops(
    outline: &Outline,
    breakpoints: &[Vec<Breakpoint>],
    field: &SizeField,
    node_limit: usize,
) -> Result<Vec<Vec<f64>>, MeshError> {
    let mut nodes = 0;
    let mut cuts = Vec::with_capacity(breakpoints.len());
    for (l, places) in outline.loops().iter().zip(breakpoints) {
        let mut cut = Vec::new();
        for (k, place) in places.iter().enumerate() {
            let limit = node_limit.saturating_sub(nodes);
            let steps = steps(l, place.s_m, span(places, k, l), field, limit)
                .ok_or(MeshError::RefinementIncomplete { nodes, limit: node_limit })?;
            nodes += steps.len();
            cut.extend(steps);
        }
        cuts.push(cut);
    }
    Ok(cuts)
}

/// Returns a source for each rim node that is closer to another part of the outline than the
/// requested edge length allows.
fn narrow_places(
    outline: &Outline,
    cuts: &[Vec<f64>],
    field: &SizeField,
    grading: f64,
) -> Vec<Source> {
    let mut sources: Vec<Source> = Vec::new();
    for (index, (l, cut)) in outline.loops().iter().zip(cuts).enumerate() {
        for &s_m in cut {
            let point = l.point_at(s_m);
            let clearance_m = outline.clearance_m(index, s_m.rem_euclid(l.length_m()));
            // the previous source along the loop may be enough here too
            let served = sources.last().map(|s| s.1 + grading * distance(s.0, point));
            let wanted = field.at(point).min(served.unwrap_or(f64::INFINITY));
            if wanted > NARROW * clearance_m {
                sources.push((point, clearance_m));
            }
        }
    }
    sources
}

/// Numbers the nodes and collects the edges.
fn number(outline: &Outline, cuts: &[Vec<f64>], electrodes: &[RimInterval]) -> Rim {
    let electrode_edges = vec![Vec::new(); electrodes.len()];
    let mut rim = Rim {
        points: Vec::new(),
        edges: Vec::new(),
        electrodes: electrode_edges,
        arc_midpoints: Vec::new(),
        starts: vec![0],
    };
    for (index, (l, cut)) in outline.loops().iter().zip(cuts).enumerate() {
        let first = rim.points.len();
        let on_loop: Vec<_> =
            electrodes.iter().enumerate().filter(|(_, e)| e.loop_index == index).collect();
        for (k, &s_m) in cut.iter().enumerate() {
            let next = (k + 1) % cut.len();
            let edge = [first + k, first + next].map(|node| node as u32);
            rim.points.push(l.point_at(s_m));
            rim.edges.push(edge);
            let middle = s_m + 0.5 * (cut[next] - s_m).rem_euclid(l.length_m());
            if l.bends_at(middle) {
                rim.arc_midpoints.push((edge, l.point_at(middle)));
            }
            let covers =
                |e: &RimInterval| (middle - e.start_m).rem_euclid(l.length_m()) < e.width_m;
            if let Some(&(electrode, _)) = on_loop.iter().find(|(_, e)| covers(e)) {
                rim.electrodes[electrode].push(edge);
            }
        }
        rim.starts.push(rim.points.len());
    }
    rim
}

/// Returns the corners and electrode ends of one loop in order, starting with the start of an
/// electrode if there is one, so that no electrode wraps around the end of the list.
fn breakpoints_of(
    l: &Loop,
    electrodes: &[&RimInterval],
    end_m: &dyn Fn(f64) -> f64,
    corner_m: f64,
    resolution_m: f64,
) -> Vec<Breakpoint> {
    let length_m = l.length_m();
    let apart = |a: f64, b: f64| {
        let d = (a - b).rem_euclid(length_m);
        d.min(length_m - d)
    };
    let corner = |(k, &s_m): (usize, &f64)| Breakpoint {
        s_m,
        end_size_m: l.reaches_in(k).then_some(corner_m),
    };
    let mut places: Vec<_> = l.corners_m().iter().enumerate().map(corner).collect();
    let corners = places.len();
    for e in electrodes {
        let size = end_m(e.width_m);
        for s_m in [e.start_m, (e.start_m + e.width_m).rem_euclid(length_m)] {
            let near = places[..corners].iter_mut().find(|p| apart(p.s_m, s_m) <= resolution_m);
            match near {
                Some(corner) => {
                    corner.end_size_m = Some(corner.end_size_m.map_or(size, |own| own.min(size)));
                }
                None => places.push(Breakpoint { s_m, end_size_m: Some(size) }),
            }
        }
    }
    if places.is_empty() {
        places.push(Breakpoint { s_m: 0.0, end_size_m: None });
    }
    places.sort_by(|a, b| a.s_m.total_cmp(&b.s_m));
    if let Some(e) = electrodes.first() {
        let start = places.iter().position(|p| apart(p.s_m, e.start_m) <= resolution_m);
        places.rotate_left(start.unwrap_or(0));
    }
    places
}

/// Returns equally spaced nodes on the outline of a patch.
fn patch_places(l: &Loop, edge_m: f64) -> Vec<Breakpoint> {
    let count = (l.length_m() / edge_m).ceil().max(FEWEST_CHORDS);
    let at = |k: usize| Breakpoint { s_m: l.length_m() * k as f64 / count, end_size_m: None };
    (0..count as usize).map(at).collect()
}

/// Arc length from breakpoint `k` (cyclic) to the next.
fn span(places: &[Breakpoint], k: usize, l: &Loop) -> f64 {
    let [a, b] = [k, k + 1].map(|k| places[k % places.len()].s_m);
    // a single breakpoint spans the whole loop
    if places.len() == 1 { l.length_m() } else { (b - a).rem_euclid(l.length_m()) }
}

/// Returns the arc lengths of the nodes from `start` up to but excluding `start + length`: equal
/// steps of the integral of ds / h, none longer than requested. `None` if there would be more than
/// `limit`.
fn steps(l: &Loop, start: f64, length: f64, field: &SizeField, limit: usize) -> Option<Vec<f64>> {
    // h changes by at most grading / 10 of itself within a tenth of h
    let mut integral = vec![(0.0, 0.0)];
    let (mut s, mut sum) = (0.0, 0.0);
    while s < length {
        let step = (0.1 * field.at(l.point_at(start + s))).min(length - s);
        let middle = field.at(l.point_at(start + s + 0.5 * step));
        sum += step / middle;
        // rounding may swallow the last step; the interval still ends
        s = if s + step > s { s + step } else { length };
        integral.push((s, sum));
        if sum > limit as f64 {
            return None;
        }
    }
    // a sum that is above a whole number only by rounding counts as that number
    let count = (sum - 1e-6).ceil().max(1.0) as usize;
    let mut nodes = Vec::with_capacity(count);
    let mut k = 0;
    for node in 0..count {
        let wanted = sum * node as f64 / count as f64;
        while integral[k + 1].1 < wanted {
            k += 1;
        }
        let ((s0, i0), (s1, i1)) = (integral[k], integral[k + 1]);
        nodes.push(start + s0 + (s1 - s0) * (wanted - i0) / (i1 - i0));
    }
    Some(nodes)
}
