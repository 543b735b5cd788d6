//! Adjacency graph of a symmetric matrix.

/// Undirected graph in compressed form.
pub(crate) struct Adjacency {
    /// Start of each vertex's list.
    starts: Vec<u32>,
    /// Neighbours, ascending within a list.
    neighbours: Vec<u32>,
}

impl Adjacency {
    /// Builds a graph from links in both directions; links may be repeated.
    pub(crate) fn from_links(vertices: usize, mut links: Vec<(u32, u32)>) -> Self {
        links.sort_unstable();
        links.dedup();
        let mut starts = vec![0u32; vertices + 1];
        links.iter().for_each(|l| starts[l.0 as usize + 1] += 1);
        (0..vertices).for_each(|k| starts[k + 1] += starts[k]);
        Self { starts, neighbours: links.into_iter().map(|l| l.1).collect() }
    }

    /// Number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.starts.len() - 1
    }

    /// Start of each vertex's list in [`Adjacency::neighbours`], and the end of the last.
    pub(crate) fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// Concatenated neighbour lists of all vertices.
    pub(crate) fn neighbours(&self) -> &[u32] {
        &self.neighbours
    }

    /// Neighbours of one vertex.
    pub(crate) fn list(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }
}
