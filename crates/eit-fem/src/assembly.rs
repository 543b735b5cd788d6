//! The system matrix: sparsity once, values per conductivity.
//!
//! Unknowns are the node potentials, then all electrode potentials but the last, which is the
//! ground (0 V). Unknowns stand in elimination order from the start, so that nothing is permuted
//! per solve. The matrix is kept as its lower triangle by columns.
//!
//! Cost of new values: 9 multiply-adds and 6 scattered additions a linear triangle (45 and 21 a
//! quadratic one), after copying the constant electrode part; 20 000 nodes, linear: 0.3 MFLOP,
//! 1.5 MB read, 1 MB scattered.

use crate::electrode_model::Contact;
use crate::element::{Elements, pair};
use crate::geometry::Geometry;
use crate::scalar::Scalar;

/// Lower triangle by columns, and where each element's entries go.
#[derive(Debug)]
pub(crate) struct Assembly {
    /// Start of each column.
    pub column_starts: Vec<u32>,
    /// Row of each entry, ascending within a column.
    pub rows: Vec<u32>,
    elements: Elements,
    /// For each element: entries of its pairs of nodes in the order of [`pair`], then diagonals.
    entries: Vec<u32>,
    /// Entry of each electrode term, in the order of `Contact::values`.
    contact_entries: Vec<u32>,
}

impl Assembly {
    /// Builds the pattern. `element_nodes` (element after element) and `contacts` name unknowns in
    /// elimination order.
    pub fn new(
        unknowns: usize,
        elements: Elements,
        element_nodes: &[u32],
        contacts: &[Contact],
    ) -> Self {
        let element_pairs = || element_nodes.chunks_exact(elements.nodes()).flat_map(pairs);
        // a pair as (column, row) of the lower triangle
        let lower = |[i, j]: [u32; 2]| (i.min(j), i.max(j));
        let count = element_nodes.len() / elements.nodes() * (elements.pairs() + elements.nodes());
        let mut places: Vec<(u32, u32)> = Vec::with_capacity(count);
        element_pairs().map(lower).for_each(|place| places.push(place));
        places.extend(contacts.iter().flat_map(|c| c.pairs()).map(lower));
        places.sort_unstable();
        places.dedup();
        let mut column_starts = vec![0u32; unknowns + 1];
        for &(column, _) in &places {
            column_starts[column as usize + 1] += 1;
        }
        for k in 0..unknowns {
            column_starts[k + 1] += column_starts[k];
        }
        let find = |pair: [u32; 2]| -> u32 {
            let place = lower(pair);
            let from = column_starts[place.0 as usize];
            let to = column_starts[place.0 as usize + 1];
            let column = &places[from as usize..to as usize];
            // present by construction: both lists went into `places`
            from + column.partition_point(|p| *p < place) as u32
        };
        let mut entries = Vec::with_capacity(count);
        element_pairs().map(find).for_each(|entry| entries.push(entry));
        let contact_entries = contacts.iter().flat_map(|c| c.pairs()).map(find).collect();
        let rows = places.iter().map(|p| p.1).collect();
        Self { column_starts, rows, elements, entries, contact_entries }
    }

    /// Adds up the electrode part of the values: it does not change with the conductivity.
    ///
    /// `positions` holds the place of each unknown that is a node.
    pub fn fill_contacts(
        &self,
        contacts: &[Contact],
        positions: &[[f64; 3]],
        contact_impedance: &[f64],
        constant: &mut [f64],
    ) {
        constant.fill(0.0);
        let mut entries = self.contact_entries.iter();
        for (contact, &impedance) in contacts.iter().zip(contact_impedance) {
            contact.values(positions, impedance, |value| {
                if let Some(&entry) = entries.next() {
                    constant[entry as usize] += value;
                }
            });
        }
    }

    /// Number of stored entries.
    pub fn entry_count(&self) -> usize {
        self.rows.len()
    }

    /// Writes the values for one conductivity per triangle, siemens.
    pub fn fill(&self, geometry: &Geometry, conductivity_s: &[f64], values: &mut [f64]) {
        values.copy_from_slice(&geometry.constant);
        match self.elements {
            Elements::Linear => self.add::<3, 3, 6>(geometry, conductivity_s, values),
            Elements::Quadratic => self.add::<6, 15, 21>(geometry, conductivity_s, values),
        }
    }

    /// Adds elements of `NODES` nodes, `PAIRS` pairs of them and `ENTRIES` matrix entries.
    fn add<const NODES: usize, const PAIRS: usize, const ENTRIES: usize>(
        &self,
        geometry: &Geometry,
        conductivity_s: &[f64],
        values: &mut [f64],
    ) {
        let (entries, _) = self.entries.as_chunks::<ENTRIES>();
        let (stiffness, _) = geometry.stiffness.as_chunks::<PAIRS>();
        for ((entry, stiffness), sigma) in entries.iter().zip(stiffness).zip(conductivity_s) {
            let mut sums = [0.0; NODES];
            for j in 1..NODES {
                for i in 0..j {
                    let k = sigma * stiffness[pair(i, j)];
                    values[entry[pair(i, j)] as usize] += k;
                    sums[i] += k;
                    sums[j] += k;
                }
            }
            for (diagonal, sum) in entry[PAIRS..].iter().zip(sums) {
                values[*diagonal as usize] -= sum;
            }
        }
    }

    /// `y = A x` and `z = |A| |x|` for one vector, the whole symmetric matrix.
    pub fn multiply<T: Scalar>(&self, values: &[T], x: &[T], y: &mut [T], z: &mut [f64]) {
        y.fill(T::from(0.0));
        z.fill(0.0);
        for column in 0..self.column_starts.len() - 1 {
            let from = self.column_starts[column] as usize;
            let to = self.column_starts[column + 1] as usize;
            for (&row, &value) in self.rows[from..to].iter().zip(&values[from..to]) {
                let row = row as usize;
                y[row] += value * x[column];
                z[row] += (value * x[column]).modulus();
                if row != column {
                    y[column] += value * x[row];
                    z[column] += (value * x[row]).modulus();
                }
            }
        }
    }

    /// Neighbour lists of the whole symmetric pattern among the first `count` unknowns, without
    /// the diagonal: what a fill-reducing ordering reads.
    pub fn adjacency(
        elements: Elements,
        element_nodes: &[u32],
        contacts: &[Contact],
        count: usize,
    ) -> Adjacency {
        let triangles = element_nodes.len() / elements.nodes();
        let mut links: Vec<(u32, u32)> = Vec::with_capacity(2 * elements.pairs() * triangles);
        let mut join = |i: u32, j: u32| {
            if i != j && (i.max(j) as usize) < count {
                links.push((i, j));
                links.push((j, i));
            }
        };
        let element_pairs = element_nodes.chunks_exact(elements.nodes()).flat_map(pairs);
        element_pairs.for_each(|[i, j]| join(i, j));
        contacts.iter().flat_map(|c| c.pairs()).for_each(|[i, j]| join(i, j));
        Adjacency::from_links(count, links)
    }
}

/// Pairs of an element's nodes: different ones in the order of [`pair`], then each with itself.
fn pairs(nodes: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    let different = (1..nodes.len()).flat_map(move |j| (0..j).map(move |i| [nodes[i], nodes[j]]));
    different.chain(nodes.iter().map(|&n| [n, n]))
}

/// A graph in compressed form.
pub(crate) struct Adjacency {
    /// Start of each node's list.
    pub starts: Vec<u32>,
    /// Neighbours, ascending within a list.
    pub neighbours: Vec<u32>,
}

impl Adjacency {
    /// Neighbours of one node.
    pub fn list(&self, node: usize) -> &[u32] {
        &self.neighbours[self.starts[node] as usize..self.starts[node + 1] as usize]
    }

    /// From links in both directions; a link may come several times.
    pub fn from_links(count: usize, mut links: Vec<(u32, u32)>) -> Self {
        links.sort_unstable();
        links.dedup();
        let mut starts = vec![0u32; count + 1];
        links.iter().for_each(|l| starts[l.0 as usize + 1] += 1);
        (0..count).for_each(|k| starts[k + 1] += starts[k]);
        Self { starts, neighbours: links.into_iter().map(|l| l.1).collect() }
    }
}
