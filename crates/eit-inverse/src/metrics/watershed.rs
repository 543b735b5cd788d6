//! Hills of an image: connected parts above a floor, parted where two tops are worth it.

use super::Cells;

/// No hill.
pub(crate) const NONE: u32 = u32::MAX;

/// Memory for the hills of images on the same cells; allocates nothing once made.
///
/// Cells are taken from the highest down. One without a labelled neighbour starts a hill; one
/// between hills is their saddle, and the lower hill falls to the higher one unless its top stands
/// out. (Watershed by flooding with persistence: Edelsbrunner, Letscher, Zomorodian, *Discrete
/// Comput. Geom.* 28 (2002), 511-533.)
#[derive(Debug, Clone)]
pub(crate) struct Watershed {
    /// Cells above the floor, the highest first.
    order: Vec<u32>,
    label: Vec<u32>,
    parent: Vec<u32>,
    tops: Vec<u32>,
}

impl Watershed {
    /// Memory for images of so many cells.
    pub(crate) fn new(cells: usize) -> Self {
        let empty = || Vec::with_capacity(cells);
        Self { order: empty(), label: vec![NONE; cells], parent: empty(), tops: empty() }
    }

    /// Finds the hills. `above` says which cells belong to any; `stands_out(top, saddle)` whether
    /// the lower of two hills that meet in `saddle` stays a hill of its own, and must stay true for
    /// lower saddles. Heights of cells above the floor must be numbers.
    pub(crate) fn run<const D: usize>(
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

    /// Forgets the hills.
    pub(crate) fn clear(&mut self) {
        for cell in self.order.drain(..) {
            self.label[cell as usize] = NONE;
        }
        self.parent.clear();
        self.tops.clear();
    }

    /// Whether no cell is above the floor.
    pub(crate) fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    fn root(&self, mut hill: u32) -> u32 {
        while self.parent[hill as usize] != hill {
            hill = self.parent[hill as usize];
        }
        hill
    }

    /// Cells of all hills, the highest first.
    pub(crate) fn cells(&self) -> impl Iterator<Item = usize> {
        self.order.iter().map(|&k| k as usize)
    }

    /// Hills with their top cell, the highest first.
    pub(crate) fn hills(&self) -> impl Iterator<Item = (u32, usize)> {
        let own = |hill: &u32| self.parent[*hill as usize] == *hill;
        (0..self.tops.len() as u32).filter(own).map(|h| (h, self.tops[h as usize] as usize))
    }

    /// Hill of a cell, [`NONE`] below the floor.
    pub(crate) fn hill(&self, cell: usize) -> u32 {
        self.label[cell]
    }
}
