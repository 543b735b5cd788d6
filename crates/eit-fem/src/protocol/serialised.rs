//! Serialised form of a [`Protocol`], read through the constructors that check it.

use super::Protocol;
use crate::error::FemError;
use ndarray::Array2;

/// What a [`Protocol`] is made from.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ProtocolParts {
    /// One measurement per quadruple `[a, b, m, n]`, 0-based.
    Quadruples { electrodes: usize, current_a: f64, quadruples: Vec<[u32; 4]> },
    /// Every measurement pattern under every stimulation pattern, both [electrode, pattern].
    Patterns { stimulations_a: Array2<f64>, measurement_patterns: Array2<f64> },
}

impl From<Protocol> for ProtocolParts {
    fn from(protocol: Protocol) -> Self {
        match protocol.quadruples() {
            Some(quadruples) => Self::Quadruples {
                electrodes: protocol.electrodes(),
                // every stimulation of such a protocol is plus and minus this current
                current_a: protocol.stimulations_a().iter().fold(0.0, |most, &i| i.max(most)),
                quadruples: quadruples.to_vec(),
            },
            None => Self::Patterns {
                stimulations_a: protocol.stimulations_a().t().to_owned(),
                measurement_patterns: protocol.measurement_patterns().t().to_owned(),
            },
        }
    }
}

impl TryFrom<ProtocolParts> for Protocol {
    type Error = FemError;

    fn try_from(parts: ProtocolParts) -> Result<Self, FemError> {
        match parts {
            ProtocolParts::Quadruples { electrodes, current_a, quadruples } => {
                Self::from_quadruples(electrodes, &quadruples, current_a)
            }
            ProtocolParts::Patterns { stimulations_a, measurement_patterns } => {
                Self::from_patterns(stimulations_a.view(), measurement_patterns.view())
            }
        }
    }
}
