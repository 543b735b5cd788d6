//! Unknowns of a solve with electrodes eliminated, and vectors of them.

use super::network::{Combination, Network};
use crate::error::FemError;
use crate::sparse::graph::Adjacency;
use crate::sparse::ldl::Rows;
use crate::sparse::ordering::fill_reducing;
use crate::sparse::real::Real;

/// Position of each variable in the elimination order: deviations and nodes, then means.
pub(super) struct Places {
    /// `None` if the variable is fixed at zero (held deviations, and the ground).
    of_variable: Vec<Option<u32>>,
    pub count: usize,
    /// Number of unknowns before the means.
    pub inner: usize,
}

impl Places {
    pub(crate) fn new<T: Real>(network: &Network<T>) -> Result<Self, FemError> {
        let variables = network.nodes.len();
        let mut last = vec![false; variables];
        network.means.iter().for_each(|&m| last[m as usize] = true);
        let free = (0..variables).filter(|&v| !last[v] && !network.held[v]);
        let inner_of: Vec<usize> = free.collect();
        let mut of_variable: Vec<Option<u32>> = vec![None; variables];
        inner_of.iter().enumerate().for_each(|(k, &v)| of_variable[v] = Some(k as u32));
        let mut links = Vec::new();
        for branch in &network.branches {
            let ends: Vec<u32> =
                branch.difference.iter().filter_map(|t| of_variable[t.0 as usize]).collect();
            for &i in &ends {
                links.extend(ends.iter().filter(|j| **j != i).map(|&j| (i, j)));
            }
        }
        let new_from_old = fill_reducing(&Adjacency::from_links(inner_of.len(), links), &[])?;
        for (k, &v) in inner_of.iter().enumerate() {
            of_variable[v] = Some(new_from_old[k]);
        }
        // the mean of the last electrode is the ground
        let inner = inner_of.len();
        let grounded = network.means.len() - 1;
        for (k, &m) in network.means[..grounded].iter().enumerate() {
            of_variable[m as usize] = Some((inner + k) as u32);
        }
        Ok(Self { of_variable, count: inner + grounded, inner })
    }

    /// Terms of a combination that are unknowns.
    pub(crate) fn terms<'a, T: Real>(
        &'a self,
        of: &'a Combination<T>,
    ) -> impl Iterator<Item = (usize, T)> + 'a {
        of.iter().filter_map(|&(v, c)| Some((self.of_variable[v as usize]? as usize, c)))
    }

    pub(crate) fn matrix<T: Real>(&self, network: &Network<T>) -> Rows<T> {
        let mut entries = Vec::new();
        for branch in &network.branches {
            for (i, a) in self.terms(&branch.difference) {
                let weighted = branch.weight * a;
                let before = self.terms(&branch.difference).filter(|(j, _)| *j <= i);
                entries.extend(before.map(|(j, b)| ((i as u32, j as u32), weighted * b)));
            }
        }
        Rows::new(self.count, entries)
    }
}

/// Several vectors, [unknown, column], row-major.
pub(super) struct Columns<T> {
    pub values: Vec<T>,
    pub count: usize,
}

impl<T: Real> Columns<T> {
    /// Right-hand sides for one ampere into the mean of each electrode except the last.
    pub(crate) fn unit_currents(places: &Places, network: &Network<T>) -> Self {
        let count = network.means.len() - 1;
        let mut values = vec![T::of(0.0); places.count * count];
        (0..count).for_each(|k| values[(places.inner + k) * count + k] = T::of(1.0));
        Self { values, count }
    }

    pub(crate) fn row(&self, place: usize) -> &[T] {
        &self.values[place * self.count..][..self.count]
    }
}
