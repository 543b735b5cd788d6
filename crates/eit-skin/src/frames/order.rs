//! Checks by reciprocity whether the data is in the scene's order; never reorders anything.

use crate::arrangement::{Arrangement, arrangements};
use crate::error::SkinError;
use crate::skin::Skin;
use eit_hw::OrderVerdict;

/// Compares the order of the data with other orders; returns the reciprocity error in the scene's order.
pub(crate) fn check(
    skin: &Skin,
    ordered_by_file: bool,
    mean: &[f64],
    notes: &mut Vec<String>,
) -> Result<Option<f64>, SkinError> {
    let Some(quadruples) = skin.protocol.quadruples() else { return Ok(None) };
    let own = eit_hw::reciprocity_error(quadruples, mean);
    let (false, Some(pairs)) = (ordered_by_file, &skin.pairs) else { return Ok(own) };
    if is_consistent(quadruples, mean) {
        return Ok(own);
    }
    if let Some(advice) = of_zeros(skin, mean).filter(|_| skin.check_order) {
        return Err(SkinError::input(format!(
            "the values are not measurements of pairs: {advice}; or set [protocol] check_order = false to continue"
        )));
    }
    let Some(ours) = own else { return Ok(own) };
    let others = arrangements(skin.mesh.electrodes().len(), mean.len(), Some(&pairs.drive));
    let others = others.into_iter().filter(|other| other.ground.is_none());
    let others: Vec<_> = others.filter_map(|other| Some((other.keys(pairs)?, other))).collect();
    let named: Vec<_> =
        others.iter().map(|(keys, other)| (keys.as_str(), other.quadruples.clone())).collect();
    let better = match eit_hw::recognise_order(mean, quadruples, &named) {
        OrderVerdict::Other { .. } if !skin.check_order => return Ok(own),
        OrderVerdict::Other { better, .. } => better,
        _ => Vec::new(),
    };
    let explains = (!better.is_empty()).then(|| explains(skin, mean));
    let fits = |setting: &str| {
        let other = others.iter().find(|(keys, _)| keys == setting);
        other.zip(explains.as_ref()).is_some_and(|((_, other), explains)| explains(other))
    };
    match better.iter().find(|other| fits(&other.setting)) {
        Some(best) => Err(SkinError::input(format!(
            "the data is not in the scene's order: reciprocity error {:.0} % in the scene's \
             order, {:.1} % with {}; set that, or [protocol] check_order = false to continue",
            100.0 * ours,
            100.0 * best.error,
            best.setting
        ))),
        None => {
            notes.push(format!(
                "reciprocity error {:.0} %: the order of the data may be wrong, or an electrode off",
                100.0 * ours
            ));
            Ok(own)
        }
    }
}

/// Whether a frame is reciprocal in this order.
pub(crate) fn is_consistent(quadruples: &[[u32; 4]], mean: &[f64]) -> bool {
    matches!(eit_hw::recognise_order(mean, quadruples, &[]), OrderVerdict::Consistent { .. })
}

/// Whether the untouched skin has such levels: reciprocity alone also holds for orders that are merely as symmetric.
#[cfg(feature = "first-scene")]
fn explains<'a>(skin: &'a Skin, mean: &'a [f64]) -> impl Fn(&Arrangement) -> bool + use<'a> {
    let judge = crate::arrangement::Judge::new(skin);
    move |other| judge.as_ref().is_none_or(|judge| judge.correlation(other, mean) >= super::ALIKE)
}

/// What to set where zeros in the frame show that values are potentials.
#[cfg(feature = "first-scene")]
fn of_zeros(skin: &Skin, mean: &[f64]) -> Option<String> {
    crate::arrangement::of_zeros(skin, mean)
}

#[cfg(not(feature = "first-scene"))]
fn of_zeros(_: &Skin, _: &[f64]) -> Option<String> {
    None
}

#[cfg(not(feature = "first-scene"))]
fn explains(_: &Skin, _: &[f64]) -> impl Fn(&Arrangement) -> bool {
    |_| true
}
