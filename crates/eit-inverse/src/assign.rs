//! Optimal assignment of rows to columns: touches to blobs, tracks to touches.

/// Workspace for assignments up to a given size; solving does not allocate.
#[derive(Debug, Clone)]
pub(crate) struct Assignment {
    columns: usize,
    /// Row-major, `columns` per row.
    costs: Vec<f64>,
    row_potential: Vec<f64>,
    column_potential: Vec<f64>,
    /// Row assigned to each column, 1-based; 0 if none.
    row_of: Vec<usize>,
    way: Vec<usize>,
    least: Vec<f64>,
    used: Vec<bool>,
    column_of: Vec<usize>,
}

impl Assignment {
    /// Allocates for at most this many rows and columns.
    pub(crate) fn new(rows: usize, columns: usize) -> Self {
        Self {
            columns: 0,
            costs: vec![0.0; rows * columns],
            row_potential: vec![0.0; rows + 1],
            column_potential: vec![0.0; columns + 1],
            row_of: vec![0; columns + 1],
            way: vec![0; columns + 1],
            least: vec![0.0; columns + 1],
            used: vec![false; columns + 1],
            column_of: vec![0; rows],
        }
    }

    /// Returns the column of each row that minimises the sum of `cost(row, column)`.
    ///
    /// All costs must be finite, and there must be at least as many columns as rows.
    ///
    /// Shortest augmenting paths with potentials, `rows^2 columns` steps (Kuhn 1955; Jonker, Volgenant,
    /// *Computing* 38 (1987), 325-340). Column 0 holds the row that is being assigned.
    pub(crate) fn solve(
        &mut self,
        rows: usize,
        columns: usize,
        cost: impl Fn(usize, usize) -> f64,
    ) -> &[usize] {
        self.columns = columns;
        for row in 0..rows {
            (0..columns).for_each(|c| self.costs[row * columns + c] = cost(row, c));
        }
        self.row_potential.fill(0.0);
        self.column_potential.fill(0.0);
        self.row_of.fill(0);
        for row in 1..=rows {
            self.row_of[0] = row;
            let mut free = self.path(columns);
            while free != 0 {
                let before = self.way[free];
                self.row_of[free] = self.row_of[before];
                free = before;
            }
        }
        for column in 1..=columns {
            if self.row_of[column] > 0 {
                self.column_of[self.row_of[column] - 1] = column - 1;
            }
        }
        &self.column_of[..rows]
    }

    /// Finds the shortest path from the row at column 0 to a free column and returns that column.
    fn path(&mut self, columns: usize) -> usize {
        self.least[..=columns].fill(f64::INFINITY);
        self.used[..=columns].fill(false);
        let mut at = 0;
        while self.row_of[at] != 0 {
            self.used[at] = true;
            let row = self.row_of[at];
            let (mut delta, mut next) = (f64::INFINITY, 0);
            for column in (1..=columns).filter(|&c| !self.used[c]) {
                let reduced = self.costs[(row - 1) * self.columns + column - 1]
                    - self.row_potential[row]
                    - self.column_potential[column];
                if reduced < self.least[column] {
                    self.least[column] = reduced;
                    self.way[column] = at;
                }
                if self.least[column] < delta {
                    delta = self.least[column];
                    next = column;
                }
            }
            for column in 0..=columns {
                if self.used[column] {
                    self.row_potential[self.row_of[column]] += delta;
                    self.column_potential[column] -= delta;
                } else {
                    self.least[column] -= delta;
                }
            }
            at = next;
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    /// Least sum over all assignments, by exhaustive search.
    fn by_trial(costs: &[Vec<f64>], row: usize, taken: &mut Vec<bool>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for column in 0..taken.len() {
            if !std::mem::replace(&mut taken[column], true) {
                best = best.min(costs[row][column] + by_trial(costs, row + 1, taken));
                taken[column] = false;
            }
        }
        best
    }

    #[test]
    fn every_small_assignment_is_the_best_of_all() {
        let mut random = Random::new(7);
        let mut assignment = Assignment::new(5, 7);
        for _ in 0..300 {
            let rows = random.below(5) + 1;
            let columns = (rows + random.below(3)).min(7);
            let costs: Vec<Vec<f64>> =
                (0..rows).map(|_| (0..columns).map(|_| random.below(8) as f64).collect()).collect();
            let found = assignment.solve(rows, columns, |r, c| costs[r][c]).to_vec();
            let mut seen = vec![false; columns];
            found.iter().for_each(|&c| assert!(!std::mem::replace(&mut seen[c], true)));
            let sum: f64 = found.iter().enumerate().map(|(r, &c)| costs[r][c]).sum();
            // small integers: sums are exact
            assert_eq!(sum, by_trial(&costs, 0, &mut vec![false; columns]));
        }
    }
}
