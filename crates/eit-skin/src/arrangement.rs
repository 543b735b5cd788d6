//! How boards arrange a frame: pair protocols in their orders, and potentials against a common electrode.

#[cfg(feature = "first-scene")]
mod advice;

#[cfg(feature = "first-scene")]
pub(crate) use advice::{Judge, of_zeros};

use eit_fem::{DrivenElectrodes, Order, PairPattern, PairProtocol};
use eit_hw::Layout;

/// Most electrodes whose skip-N patterns are tried: half as many patterns of their square of quadruples, 2 MB for each order.
const MOST_SKIPPED: usize = 64;

/// One way to arrange a frame.
#[derive(Debug, Clone)]
pub(crate) struct Arrangement {
    /// The protocol; with potentials, of the pairs that are formed from them.
    pub protocol: PairProtocol,
    /// Where values are potentials against a common electrode: whether those of driven ones are among them.
    pub ground: Option<DrivenElectrodes>,
    pub quadruples: Vec<[u32; 4]>,
}

impl Arrangement {
    fn new(protocol: PairProtocol, ground: Option<DrivenElectrodes>) -> Option<Self> {
        // for example four electrodes with opposite drive: nothing is left to measure
        let quadruples = protocol.quadruples().ok()?;
        Some(Self { protocol, ground, quadruples })
    }

    fn layout(&self) -> Layout {
        layout(&self.quadruples, self.protocol.electrodes, self.ground)
    }

    /// The keys of `[protocol]` that differ from those of a scene whose frames are measurements of pairs.
    pub(crate) fn keys(&self, scene: &PairProtocol) -> Option<String> {
        let Self { protocol, ground, .. } = self;
        let mut keys = Vec::new();
        let mut set = |is_other: bool, key: &str, value: String| {
            keys.extend(is_other.then(|| format!("{key} = {value}")));
        };
        match &protocol.drive {
            PairPattern::Pairs(pairs) => {
                set(protocol.drive != scene.drive, "pairs", format!("{pairs:?}"))
            }
            drive => set(*drive != scene.drive, "drive", format!("\"{}\"", name(drive))),
        }
        let driven = ground.unwrap_or(protocol.driven_electrodes);
        match ground {
            Some(_) => set(true, "measure", "\"ground\"".to_owned()),
            None => {
                let measure = format!("\"{}\"", name(&protocol.measure));
                set(protocol.measure != scene.measure, "measure", measure);
            }
        }
        let is_other = ground.is_none() && protocol.order != scene.order;
        set(is_other, "order", format!("\"{}\"", order_name(protocol.order)));
        let is_other = driven != scene.driven_electrodes;
        set(is_other, "driven_electrodes", format!("\"{}\"", driven_name(driven)));
        (!keys.is_empty()).then(|| format!("[protocol] {}", keys.join(", ")))
    }
}

/// What a frame holds where its source does not name electrodes.
pub(crate) fn layout(
    quadruples: &[[u32; 4]],
    electrodes: usize,
    ground: Option<DrivenElectrodes>,
) -> Layout {
    let Some(driven) = ground else { return Layout::ProtocolOrder };
    let drives = quadruples.chunk_by(|p, q| p[..2] == q[..2]).map(|of| [of[0][0], of[0][1]]);
    let driven = driven == DrivenElectrodes::Keep;
    Layout::Potentials { drives: drives.collect(), electrodes, driven }
}

/// Arrangements of `values` values, from the usual to the rare, each order once: of the scene's own drive, if there is one, and
/// of adjacent, skip-N and opposite drive; measured on adjacent pairs, on pairs like the driven ones or against a common electrode;
/// with and without current-carrying electrodes.
pub(crate) fn arrangements(
    electrodes: usize,
    values: usize,
    own: Option<&PairPattern>,
) -> Vec<Arrangement> {
    let mut drives: Vec<PairPattern> = own.cloned().into_iter().collect();
    drives.push(PairPattern::Adjacent);
    // skip-N beyond half of the electrodes equals skip-M from the other side; half is "opposite"
    let is_other = |between: &usize| 2 * (between + 1) < electrodes && electrodes <= MOST_SKIPPED;
    drives.extend((1..).take_while(is_other).map(PairPattern::Skip));
    drives.extend(electrodes.is_multiple_of(2).then_some(PairPattern::Opposite));
    let mut found: Vec<Arrangement> = Vec::new();
    let either = [DrivenElectrodes::Drop, DrivenElectrodes::Keep];
    let current_a = PairProtocol::default().current_a;
    for drive in &drives {
        for measure in [&PairPattern::Adjacent, drive] {
            for driven_electrodes in either {
                for order in [Order::Rotated, Order::Ascending] {
                    let (drive, measure) = (drive.clone(), measure.clone());
                    let protocol = PairProtocol {
                        electrodes,
                        drive,
                        measure,
                        driven_electrodes,
                        order,
                        current_a,
                    };
                    let new = Arrangement::new(protocol, None);
                    let is_new = |new: &Arrangement| {
                        let known = |known: &Arrangement| known.quadruples == new.quadruples;
                        new.quadruples.len() == values && !found.iter().any(known)
                    };
                    found.extend(new.filter(is_new));
                }
            }
        }
    }
    let of_ground = drives.iter().flat_map(|drive| either.map(|driven| (drive.clone(), driven)));
    found.extend(
        of_ground.filter_map(|(drive, driven)| against_ground(electrodes, values, drive, driven)),
    );
    found
}

/// Potentials against a common electrode, if they are as many.
fn against_ground(
    electrodes: usize,
    values: usize,
    drive: PairPattern,
    driven: DrivenElectrodes,
) -> Option<Arrangement> {
    let protocol = PairProtocol { electrodes, drive, ..PairProtocol::default() };
    let new = Arrangement::new(protocol, Some(driven))?;
    (new.layout().value_count() == Some(values)).then_some(new)
}

/// The name of a pattern in a scene. Lists of pairs have no name.
pub(crate) fn name(pattern: &PairPattern) -> String {
    match pattern {
        PairPattern::Adjacent | PairPattern::Pairs(_) => "adjacent".to_owned(),
        PairPattern::Opposite => "opposite".to_owned(),
        PairPattern::Skip(between) => format!("skip-{between}"),
    }
}

pub(crate) fn order_name(order: Order) -> &'static str {
    match order {
        Order::Rotated => "rotated",
        Order::Ascending => "ascending",
    }
}

pub(crate) fn driven_name(driven: DrivenElectrodes) -> &'static str {
    match driven {
        DrivenElectrodes::Drop => "drop",
        DrivenElectrodes::Keep => "keep",
    }
}
