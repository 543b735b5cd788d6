//! Electrodes on the page: their arcs and the positions of their numbers.

use crate::{ElectrodeDrawing, text::Font};

/// Em of the electrode numbers, in points.
pub(crate) const NUMBER_EM: f64 = 10.0;
/// Distance from the rim to the box of a number, in points: half the electrode's arc width and some
/// space.
pub(crate) const NUMBER_GAP: f64 = 5.0;
/// Height of a number's box relative to its em.
pub(crate) const NUMBER_HEIGHT: f64 = 0.8;

/// The number of an electrode and its position.
#[derive(Clone, Debug)]
pub(crate) struct Number {
    pub(crate) number: usize,
    pub(crate) middle: [f64; 2],
    /// Width of the text, in points.
    pub(crate) width: f64,
    /// Whether it lies on the skin rather than beside it.
    pub(crate) on_skin: bool,
}

impl Number {
    /// Whether the boxes of two numbers are too close.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let apart = |axis: usize| (self.middle[axis] - other.middle[axis]).abs();
        apart(0) < (self.width + other.width) / 2.0 + 2.0
            && apart(1) < NUMBER_EM * NUMBER_HEIGHT + 1.0
    }
}

/// Returns the x coordinates where a horizontal line crosses closed curves.
pub(crate) fn crossings(outlines: &[Vec<[f64; 2]>], y: f64) -> Vec<f64> {
    let edges = outlines.iter().flat_map(|curve| curve.windows(2));
    edges
        .filter(|edge| (edge[0][1] > y) != (edge[1][1] > y))
        .map(|e| e[0][0] + (y - e[0][1]) / (e[1][1] - e[0][1]) * (e[1][0] - e[0][0]))
        .collect()
}

/// Places numbers next to the middles of the electrodes, outside the skin if one side is outside.
/// If they would overlap, only every second, third, ... is kept, starting with number 1.
pub(crate) fn place_numbers<'a>(
    electrodes: impl Iterator<Item = &'a ElectrodeDrawing>,
    curves: &[Vec<[f64; 2]>],
    outlines: &[Vec<[f64; 2]>],
    size: [f64; 2],
    font: &Font,
) -> Vec<Number> {
    let is_outside = |p: [f64; 2]| {
        crossings(outlines, p[1]).iter().filter(|x| **x > p[0]).count().is_multiple_of(2)
    };
    let mut numbers = Vec::new();
    for (electrode, curve) in electrodes.zip(curves) {
        let Some((middle, [tx, ty])) = middle_of(curve) else { continue };
        let number = electrode.number;
        let width = font.width(&number.to_string(), NUMBER_EM);
        let normal = [ty, -tx];
        let beside =
            |distance: f64| [middle[0] + distance * normal[0], middle[1] + distance * normal[1]];
        let sides = [2.0, -2.0].map(|distance| is_outside(beside(distance)));
        let outward = match sides {
            [true, false] => 1.0,
            [false, true] => -1.0,
            // both sides are alike, as for a patch in the skin: place it away from what the curve
            // surrounds
            _ => away_from_centre(curve, middle, normal, size),
        };
        let half_box =
            (normal[0].abs() * width + normal[1].abs() * NUMBER_EM * NUMBER_HEIGHT) / 2.0;
        let middle = beside(outward * (NUMBER_GAP + half_box));
        numbers.push(Number { number, middle, width, on_skin: sides == [false; 2] });
    }
    // more than 200 numbers fill a panel anyway, and comparing all pairs would take long
    let mut every = numbers.len() / 200 + 1;
    loop {
        let kept: Vec<Number> = numbers
            .iter()
            .filter(|n| n.number.saturating_sub(1).is_multiple_of(every))
            .cloned()
            .collect();
        let overlap = |(i, a): (usize, &Number)| kept[..i].iter().any(|b| a.overlaps(b));
        if every > numbers.len() || !kept.iter().enumerate().any(overlap) {
            return kept;
        }
        every += 1;
    }
}

/// Sign of the normal that points away from the mean of a curve's points or, for a straight curve,
/// away from the middle of the panel.
fn away_from_centre(curve: &[[f64; 2]], middle: [f64; 2], normal: [f64; 2], size: [f64; 2]) -> f64 {
    let along = |centre: [f64; 2]| {
        normal[0] * (middle[0] - centre[0]) + normal[1] * (middle[1] - centre[1])
    };
    let count = curve.len().max(1) as f64;
    let own = along([0, 1].map(|axis| curve.iter().map(|p| p[axis]).sum::<f64>() / count));
    // below half a point, the sign is only the rounding of a straight electrode
    if own.abs() > 0.5 { own.signum() } else { along(size.map(|s| s / 2.0)).signum() }
}

/// Shortens a polyline by `length` at both ends, at most to half; closed ones are unchanged.
pub(crate) fn trimmed(mut curve: Vec<[f64; 2]>, length: f64) -> Vec<[f64; 2]> {
    if curve.first() == curve.last() {
        return curve;
    }
    let length = length.min(lengths(&curve).iter().sum::<f64>() / 4.0);
    for _ in 0..2 {
        let mut left = length;
        let lengths = lengths(&curve);
        let whole = lengths.iter().take_while(|edge| {
            let passed = **edge <= left;
            left -= if passed { **edge } else { 0.0 };
            passed
        });
        let cut = whole.count();
        if let (Some(edge), Some(start), Some(end)) =
            (lengths.get(cut), curve.get(cut), curve.get(cut + 1))
        {
            let share = left / edge;
            let point = [0, 1].map(|axis| start[axis] + share * (end[axis] - start[axis]));
            curve.splice(..=cut, [point]);
        }
        curve.reverse();
    }
    curve
}

/// Lengths of the segments of a polyline.
fn lengths(curve: &[[f64; 2]]) -> Vec<f64> {
    curve.windows(2).map(|edge| (edge[1][0] - edge[0][0]).hypot(edge[1][1] - edge[0][1])).collect()
}

/// The midpoint of a polyline by length, or the rightmost position of a closed one, and the unit
/// direction there.
fn middle_of(curve: &[[f64; 2]]) -> Option<([f64; 2], [f64; 2])> {
    if curve.len() > 1 && curve.first() == curve.last() {
        let right = curve.iter().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max);
        let height = curve.iter().map(|p| p[1]).sum::<f64>() / curve.len() as f64;
        return Some(([right, height], [0.0, 1.0]));
    }
    let lengths = lengths(curve);
    let mut left = lengths.iter().sum::<f64>() / 2.0;
    for (edge, &length) in curve.windows(2).zip(&lengths) {
        if length > 0.0 && left <= length {
            let tangent = [(edge[1][0] - edge[0][0]) / length, (edge[1][1] - edge[0][1]) / length];
            let middle = [edge[0][0] + left * tangent[0], edge[0][1] + left * tangent[1]];
            return Some((middle, tangent));
        }
        left -= length;
    }
    curve.first().map(|point| (*point, [1.0, 0.0]))
}
