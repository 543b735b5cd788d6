//! Hills of an image: connected parts above a floor, split where two peaks stand out.

use super::Cells;

/// Label of cells without a hill.
const NONE: u32 = u32::MAX;

/// Workspace for the hills of images on the same cells; [`run`](Self::run) does not allocate.
///
/// Cells are processed from the highest down. A cell without a labelled neighbour starts a hill. A cell
/// between hills is their saddle; there the lower hill joins the higher one unless its peak stands out.
/// (Watershed by flooding with persistence: Edelsbrunner, Letscher, Zomorodian, *Discrete Comput. Geom.* 28
/// (2002), 511-533.)
#[derive(Debug, Clone)]
pub(super) struct Watershed {
    /// Cells above the floor, highest first.
    order: Vec<u32>,
    label: Vec<u32>,
    parent: Vec<u32>,
    tops: Vec<u32>,
}

impl Watershed {
    /// Allocates for images of the given number of cells.
    pub(super) fn new(cells: usize) -> Self {
        let empty = || Vec::with_capacity(cells);
        Self { order: empty(), label: vec![NONE; cells], parent: empty(), tops: empty() }
    }

    /// Finds the hills.
    ///
    /// `above` says which cells belong to any hill. `stands_out(top, saddle)` says whether the lower of two
    /// hills that meet at `saddle` remains separate; it must stay true for lower saddles. Heights of cells
    /// above the floor must not be NaN.
    pub(super) fn run<const D: usize>(
        &mut self,
        heights: &[f64],
        cells: &Cells<D>,
        above: impl Fn(usize) -> bool,
        stands_out: impl Fn(usize, usize) -> bool,
    ) {
        self.clear();
        self.order.extend((0..heights.len() as u32).filter(|&k| above(k as usize)));
        self.order.sort_unstable_by(|&a, &b| {
            heights[b as usize].total_cmp(&heights[a as usize]).then(a.cmp(&b))
        });
        for at in 0..self.order.len() {
            let cell = self.order[at] as usize;
            let mut home = NONE;
            for neighbour in cells.neighbours(cell) {
                if self.label[neighbour] == NONE {
                    continue;
                }
                let other = self.root(self.label[neighbour]);
                // hills are numbered from the highest down
                let (high, low) = (home.min(other), home.max(other));
                if low != NONE && high != low && !stands_out(self.tops[low as usize] as usize, cell)
                {
                    self.parent[low as usize] = high;
                }
                home = high;
            }
            if home == NONE {
                home = self.tops.len() as u32;
                self.tops.push(cell as u32);
                self.parent.push(home);
            }
            self.label[cell] = home;
        }
        for &cell in &self.order {
            let label = self.root(self.label[cell as usize]);
            self.label[cell as usize] = label;
        }
    }

    /// Clears the hills.
    pub(super) fn clear(&mut self) {
        for cell in self.order.drain(..) {
            self.label[cell as usize] = NONE;
        }
        self.parent.clear();
        self.tops.clear();
    }

    /// Returns whether no cell is above the floor.
    pub(super) fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    fn root(&self, mut hill: u32) -> u32 {
        while self.parent[hill as usize] != hill {
            hill = self.parent[hill as usize];
        }
        hill
    }

    /// Returns the cells of all hills, highest first.
    pub(super) fn cells(&self) -> impl Iterator<Item = usize> {
        self.order.iter().map(|&k| k as usize)
    }

    /// Returns the hills with their peak cell, highest first.
    pub(super) fn hills(&self) -> impl Iterator<Item = (u32, usize)> {
        let own = |hill: &u32| self.parent[*hill as usize] == *hill;
        (0..self.tops.len() as u32).filter(own).map(|h| (h, self.tops[h as usize] as usize))
    }

    /// Returns the hill of a cell; [`NONE`] below the floor.
    pub(super) fn hill(&self, cell: usize) -> u32 {
        self.label[cell]
    }
}
