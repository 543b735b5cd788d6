//! Converts voltages of one protocol to those of another, where they follow from each other.

use eit_hw::Quadruple;
use ndarray::Array2;
use std::collections::{HashMap, VecDeque};

/// Measurements under one drive: index, electrodes, and the sign for the drive in ascending order.
type Known = Vec<(usize, [u32; 2], f64)>;

/// Computes wanted voltages from those measured under the same drive, as differences of potentials. A driven
/// electrode without any measurement gets a potential beyond all others, as on a real skin: above them where
/// current enters, below them where it leaves.
pub(crate) fn arranged(
    own: &[Quadruple],
    values: &Array2<f64>,
    wanted: &[Quadruple],
) -> Result<Array2<f64>, String> {
    let mut by_drive: HashMap<[u32; 2], Known> = HashMap::new();
    for (index, &[a, b, m, n]) in own.iter().enumerate() {
        let sign = if a < b { 1.0 } else { -1.0 };
        by_drive.entry([a.min(b), a.max(b)]).or_default().push((index, [m, n], sign));
    }
    let mut arranged = Array2::zeros((values.nrows(), wanted.len()));
    for (column, &[a, b, m, n]) in wanted.iter().enumerate() {
        let known = by_drive.get(&[a.min(b), a.max(b)]).ok_or_else(|| {
            format!("it drives ({a}, {b}) (electrodes counted from 0), but the scene does not")
        })?;
        let sign = if a < b { 1.0 } else { -1.0 };
        let path = path(known, m, n);
        for (row, frame) in values.rows().into_iter().enumerate() {
            let value = match &path {
                Some(steps) => steps.iter().map(|&(index, s)| s * frame[index]).sum(),
                None => {
                    let reach: f64 = known.iter().map(|&(index, ..)| frame[index].abs()).sum();
                    let end = |e: u32| f64::from(u8::from(e == a)) - f64::from(u8::from(e == b));
                    sign * reach * (end(m) - end(n))
                }
            };
            arranged[[row, column]] = sign * value;
        }
    }
    Ok(arranged)
}

/// Signed measurements whose sum is u(m) - u(n) under a drive from its smaller electrode to its larger. The
/// search is breadth-first, so a pair that was measured directly is one step.
fn path(known: &[(usize, [u32; 2], f64)], m: u32, n: u32) -> Option<Vec<(usize, f64)>> {
    let mut came: HashMap<u32, (u32, usize, f64)> = HashMap::new();
    let mut queue = VecDeque::from([m]);
    while let Some(at) = queue.pop_front() {
        if at == n {
            break;
        }
        for &(index, [p, q], sign) in known {
            let (next, step) = match () {
                () if p == at => (q, sign),
                () if q == at => (p, -sign),
                () => continue,
            };
            if next != m && !came.contains_key(&next) {
                came.insert(next, (at, index, step));
                queue.push_back(next);
            }
        }
    }
    let (mut steps, mut at) = (Vec::new(), n);
    while at != m {
        let &(before, index, step) = came.get(&at)?;
        steps.push((index, step));
        at = before;
    }
    Some(steps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Potentials of a drive follow from the measurements, with their signs.
    #[test]
    fn potentials_follow_from_differences() {
        // u = 0, 5, 3, 4, 1 under the drive (0, 1), which also appears reversed
        let own = [[0, 1, 1, 2], [1, 0, 3, 2], [0, 1, 4, 3]];
        let values = array![[2.0, -1.0, -3.0]];
        let wanted = [[0, 1, 1, 4], [1, 0, 1, 4], [0, 1, 2, 3]];
        let found = arranged(&own, &values, &wanted).unwrap();
        assert_eq!(found, array![[4.0, -4.0, -1.0]]);
        // of electrode 0 it is only known that current enters there
        let driven = arranged(&own, &values, &[[0, 1, 0, 2], [1, 0, 0, 2]]).unwrap();
        assert!(driven[[0, 0]] > 2.0 && driven[[0, 1]] == -driven[[0, 0]], "{driven}");
        assert!(arranged(&own, &values, &[[0, 2, 3, 4]]).is_err());
    }
}
