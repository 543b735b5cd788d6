//! Checks by reciprocity whether the data is in the scene's order; never reorders anything.

use super::load::Loaded;
use crate::error::SkinError;
use crate::skin::Skin;
use eit_fem::{DrivenElectrodes, Order, PairPattern, PairProtocol};
use eit_hw::OrderVerdict;

/// Compares the order of the data with other orders; returns the reciprocity error in the scene's order.
pub(crate) fn check(
    skin: &Skin,
    loaded: &Loaded,
    mean: &[f64],
    notes: &mut Vec<String>,
) -> Result<Option<f64>, SkinError> {
    let Some(quadruples) = skin.protocol.quadruples() else { return Ok(None) };
    let own = eit_hw::reciprocity_error(quadruples, mean);
    let (false, Some(pairs)) = (loaded.ordered_by_file, &skin.pairs) else { return Ok(own) };
    let alternatives = alternatives(pairs, mean.len());
    let named: Vec<(&str, Vec<[u32; 4]>)> =
        alternatives.iter().map(|(name, q)| (name.as_str(), q.clone())).collect();
    match eit_hw::recognise_order(mean, quadruples, &named) {
        OrderVerdict::Other { better, ours } if skin.check_order => {
            let best = &better[0];
            Err(SkinError::input(format!(
                "the data is not in the scene's order: reciprocity error {:.0} % in the scene's \
                 order, {:.1} % with {}; set that, or [protocol] check_order = false to continue",
                100.0 * ours,
                100.0 * best.error,
                best.setting
            )))
        }
        OrderVerdict::Unclear { ours: Some(error), .. } => {
            notes.push(format!(
                "reciprocity error {:.0} %: the order of the data may be wrong, or an electrode off",
                100.0 * error
            ));
            Ok(own)
        }
        _ => Ok(own),
    }
}

/// Other pair protocols with as many measurements, named by the keys that select them.
fn alternatives(scene: &PairProtocol, count: usize) -> Vec<(String, Vec<[u32; 4]>)> {
    let drives = [
        ("adjacent", PairPattern::Adjacent),
        ("opposite", PairPattern::Opposite),
        ("skip-1", PairPattern::Skip(1)),
        ("skip-2", PairPattern::Skip(2)),
        ("skip-3", PairPattern::Skip(3)),
    ];
    let mut found = Vec::new();
    for (drive_name, drive) in &drives {
        for (order_name, order) in [("rotated", Order::Rotated), ("ascending", Order::Ascending)] {
            for (driven_name, driven) in
                [("drop", DrivenElectrodes::Drop), ("keep", DrivenElectrodes::Keep)]
            {
                let other = PairProtocol {
                    drive: drive.clone(),
                    order,
                    driven_electrodes: driven,
                    ..scene.clone()
                };
                let mut keys = Vec::new();
                if other.drive != scene.drive {
                    keys.push(format!("drive = \"{drive_name}\""));
                }
                if other.order != scene.order {
                    keys.push(format!("order = \"{order_name}\""));
                }
                if other.driven_electrodes != scene.driven_electrodes {
                    keys.push(format!("driven_electrodes = \"{driven_name}\""));
                }
                if let (false, Ok(quadruples)) = (keys.is_empty(), other.quadruples())
                    && quadruples.len() == count
                {
                    found.push((format!("[protocol] {}", keys.join(", ")), quadruples));
                }
            }
        }
    }
    found
}
