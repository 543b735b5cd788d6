//! Nested dissection by coordinates (George 1973; Heath and Raghavan 1995), for large meshes.
//!
//! A set of nodes is cut across its longest axis at the median. The nodes on one side with
//! neighbours on the other form the separator and are eliminated last. A straight cut through a
//! planar mesh has about as few nodes as any. Fill grows as `n log n`, the work as `n^1.5`. Minimum
//! degree, which orders the small sets here, needs less work on small meshes and more on large
//! ones.

use crate::sparse::graph::Adjacency;
use eit_core::vector::dot;

/// Largest set of nodes that is ordered by minimum degree.
const LEAF: usize = 400;

/// Power iterations for the longest axis, which need not be exact.
const AXIS_STEPS: usize = 20;

/// Computes the elimination order `new_from_old`; `order` orders the leaves.
pub(super) fn order<E>(
    graph: &Adjacency,
    positions_m: &[[f64; 3]],
    order: impl Fn(&Adjacency) -> Result<Vec<u32>, E>,
) -> Result<Vec<u32>, E> {
    let count = graph.vertices();
    let mut dissection = Dissection {
        graph,
        positions_m,
        order,
        side: vec![Side::Outside; count],
        local: vec![0; count],
        new_from_old: vec![0; count],
    };
    let mut nodes: Vec<u32> = (0..count as u32).collect();
    dissection.number(&mut nodes, 0)?;
    Ok(dissection.new_from_old)
}

/// Side of a cut.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// Not in the set.
    Outside,
    Left,
    Right,
}

struct Dissection<'a, F> {
    graph: &'a Adjacency,
    positions_m: &'a [[f64; 3]],
    order: F,
    side: Vec<Side>,
    /// Index of a node within a leaf.
    local: Vec<u32>,
    new_from_old: Vec<u32>,
}

impl<E, F: Fn(&Adjacency) -> Result<Vec<u32>, E>> Dissection<'_, F> {
    /// Numbers a set of nodes from `first` on. The recursion depth is logarithmic in the number of
    /// nodes.
    fn number(&mut self, nodes: &mut [u32], first: u32) -> Result<(), E> {
        if nodes.len() <= LEAF {
            return self.leaf(nodes, first);
        }
        let middle = nodes.len() / 2;
        let [principal, coordinate] = self.axes(nodes);
        let by_coordinate = self.cut(nodes, coordinate);
        let mut on_cut = self.cut(nodes, principal);
        if by_coordinate.iter().min() < on_cut.iter().min() {
            on_cut = self.cut(nodes, coordinate);
        }
        let (left, right) = nodes.split_at_mut(middle);
        let touches = |n: u32, other: Side| self.touches(n, other);
        // move the separator's nodes to the end of their side
        let (cut, other) =
            if on_cut[0] < on_cut[1] { (left, Side::Right) } else { (right, Side::Left) };
        cut.sort_by_cached_key(|&n| touches(n, other));
        let separator = on_cut[0].min(on_cut[1]);
        nodes.iter().for_each(|&n| self.side[n as usize] = Side::Outside);
        // turn [left, separator, right] into [left, right, separator] if needed
        let rest = nodes.len() - separator;
        let inner_left = if on_cut[0] < on_cut[1] {
            nodes[middle - separator..].rotate_left(separator);
            middle - separator
        } else {
            middle
        };
        let (inner, last) = nodes.split_at_mut(rest);
        for (n, place) in last.iter().zip(first + rest as u32..) {
            self.new_from_old[*n as usize] = place;
        }
        let (left, right) = inner.split_at_mut(inner_left);
        let middle = first + left.len() as u32;
        self.number(left, first)?;
        self.number(right, middle)
    }

    /// Splits nodes at their median along an axis and marks the two sides. Returns the number of
    /// nodes on each side with neighbours on the other.
    fn cut(&mut self, nodes: &mut [u32], axis: [f64; 3]) -> [usize; 2] {
        let along = |n: u32| dot(self.positions_m[n as usize], axis);
        let middle = nodes.len() / 2;
        nodes.select_nth_unstable_by(middle, |&a, &b| {
            along(a).total_cmp(&along(b)).then_with(|| a.cmp(&b))
        });
        let (left, right) = nodes.split_at(middle);
        left.iter().for_each(|&n| self.side[n as usize] = Side::Left);
        right.iter().for_each(|&n| self.side[n as usize] = Side::Right);
        [
            left.iter().filter(|n| self.touches(**n, Side::Right)).count(),
            right.iter().filter(|n| self.touches(**n, Side::Left)).count(),
        ]
    }

    /// Whether a node has a neighbour on the given side.
    fn touches(&self, node: u32, side: Side) -> bool {
        self.graph.list(node as usize).iter().any(|&n| self.side[n as usize] == side)
    }

    /// Numbers a small set by minimum degree.
    fn leaf(&mut self, nodes: &[u32], first: u32) -> Result<(), E> {
        for (&n, local) in nodes.iter().zip(0..) {
            (self.side[n as usize], self.local[n as usize]) = (Side::Left, local);
        }
        let mut links = Vec::new();
        for &n in nodes {
            let own = self.graph.list(n as usize).iter();
            let inside = own.filter(|m| self.side[**m as usize] == Side::Left);
            links.extend(inside.map(|&m| (self.local[n as usize], self.local[m as usize])));
        }
        let new_from_local = (self.order)(&Adjacency::from_links(nodes.len(), links))?;
        for (&n, new) in nodes.iter().zip(new_from_local) {
            self.new_from_old[n as usize] = first + new;
            self.side[n as usize] = Side::Outside;
        }
        Ok(())
    }

    /// Candidate directions to cut across: the direction of the set's largest extent (the first
    /// eigenvector of its covariance) and the coordinate axis of the largest extent. (In a square
    /// all directions have equal variance, but an oblique cut is longer.)
    fn axes(&self, nodes: &[u32]) -> [[f64; 3]; 2] {
        let count = nodes.len() as f64;
        let place = |n: &u32| self.positions_m[*n as usize];
        let mut mean = [0.0; 3];
        nodes.iter().map(place).for_each(|p| (0..3).for_each(|k| mean[k] += p[k] / count));
        let mut covariance = [[0.0; 3]; 3];
        for p in nodes.iter().map(place) {
            for (row, a) in covariance.iter_mut().zip(0..) {
                (0..3).for_each(|b| row[b] += (p[a] - mean[a]) * (p[b] - mean[b]));
            }
        }
        let longest =
            (1..3).fold(0, |m, k| if covariance[k][k] > covariance[m][m] { k } else { m });
        let coordinate = std::array::from_fn(|k| if k == longest { 1.0 } else { 0.0 });
        let mut principal = [0.61, 0.55, 0.57];
        for _ in 0..AXIS_STEPS {
            let next = covariance.map(|row| dot(row, principal));
            let size = dot(next, next).sqrt();
            // all nodes at one point
            if size == 0.0 || !size.is_finite() {
                return [coordinate; 2];
            }
            principal = next.map(|x| x / size);
        }
        [principal, coordinate]
    }
}
