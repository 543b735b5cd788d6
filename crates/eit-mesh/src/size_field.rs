//! Requested edge length at a point: short at the electrode ends, where the current density is
//! singular, and growing linearly with the distance from them.

use crate::geometry::distance;

/// A point and the edge length requested there, metres.
pub(crate) type Source = ([f64; 2], f64);

/// `h(x) = min(edge_m, min_i(size_i + grading |x - x_i|))` over point sources `i`.
///
/// `h` is Lipschitz continuous with constant `grading`. Each quadtree cell keeps the few sources
/// that can be the smallest somewhere in it, so the evaluation time does not grow with the number
/// of sources.
#[derive(Debug, Clone)]
pub(crate) struct SizeField {
    edge_m: f64,
    grading: f64,
    root: Square,
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy)]
struct Square {
    low: [f64; 2],
    side: f64,
}

#[derive(Debug, Clone)]
enum Cell {
    /// Index of the first of four children: lower left, lower right, upper left, upper right.
    Split(usize),
    Leaf(Vec<Source>),
}

/// A leaf with at most this many sources is not split: scanning them costs about as much as one
/// more level.
const FEW: usize = 4;
/// A cell no longer than this many requested edges is not split: it will hold about one node, and
/// far from a row of sources all are about equally distant, however small the cell.
const FINEST: f64 = 1.0;

impl SizeField {
    /// Creates a field over the box from `low` to `high`, metres.
    pub(crate) fn new(
        edge_m: f64,
        grading: f64,
        [low, high]: [[f64; 2]; 2],
        sources: &[Source],
    ) -> Self {
        let root = Square { low, side: (high[0] - low[0]).max(high[1] - low[1]) };
        let mut field = Self { edge_m, grading, root, cells: vec![Cell::Leaf(Vec::new())] };
        field.build(0, root, sources);
        field
    }

    fn build(&mut self, cell: usize, square: Square, sources: &[Source]) {
        let (kept, size) = self.can_be_smallest(square, sources);
        if kept.len() <= FEW || square.side <= FINEST * size {
            self.cells[cell] = Cell::Leaf(kept);
            return;
        }
        let first = self.cells.len();
        self.cells[cell] = Cell::Split(first);
        self.cells.resize(first + 4, Cell::Leaf(Vec::new()));
        for child in 0..4 {
            self.build(first + child, square.child(child), &kept);
        }
    }

    /// Returns the sources that can be below `edge_m` and below every other source somewhere in a
    /// square, and `h` at its centre.
    fn can_be_smallest(&self, square: Square, sources: &[Source]) -> (Vec<Source>, f64) {
        let side = square.side;
        let centre = square.low.map(|x| x + 0.5 * side);
        let most_above = self.grading * 0.5 * side * 2f64.sqrt();
        // inside the square, h exceeds its value at the centre by at most this, and a source falls
        // below its own by at most this
        let at_centre = |s: &Source| s.1 + self.grading * distance(s.0, centre);
        let smallest = sources.iter().map(at_centre).fold(self.edge_m, f64::min);
        let limit = (smallest + most_above).min(self.edge_m);
        let kept = sources.iter().copied().filter(|s| at_centre(s) - most_above < limit).collect();
        (kept, smallest)
    }

    /// Returns the requested edge length, metres.
    pub(crate) fn at(&self, point: [f64; 2]) -> f64 {
        let (mut square, mut cell) = (self.root, 0);
        loop {
            match &self.cells[cell] {
                Cell::Split(first) => {
                    let child = square.child_of(point);
                    cell = first + child;
                    square = square.child(child);
                }
                Cell::Leaf(sources) => {
                    return sources
                        .iter()
                        .map(|&(at, size)| size + self.grading * distance(at, point))
                        .fold(self.edge_m, f64::min);
                }
            }
        }
    }
}

impl Square {
    fn child_of(self, point: [f64; 2]) -> usize {
        let upper = |k: usize| usize::from(point[k] >= self.low[k] + 0.5 * self.side);
        upper(0) + 2 * upper(1)
    }

    fn child(self, index: usize) -> Self {
        let side = 0.5 * self.side;
        let low =
            [self.low[0] + side * (index % 2) as f64, self.low[1] + side * (index / 2) as f64];
        Self { low, side }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(fixtures::cases(256))]

        /// The tree drops no relevant source: it equals brute force, bit for bit.
        #[test]
        fn equals_brute_force(
            sources in prop::collection::vec((prop::array::uniform2(-1.0..1.0f64), 1e-4..0.3f64), 0..60),
            points in prop::collection::vec(prop::array::uniform2(-1.0..1.0f64), 20),
            grading in 0.05..1.0f64,
        ) {
            let field = SizeField::new(0.2, grading, [[-1.0; 2], [1.0; 2]], &sources);
            for p in points {
                let wanted = sources
                    .iter()
                    .map(|&(at, size)| size + grading * distance(at, p))
                    .fold(0.2, f64::min);
                prop_assert_eq!(field.at(p), wanted);
            }
        }
    }
}
