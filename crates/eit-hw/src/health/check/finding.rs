//! Problems that a health check can find, and their descriptions.

use std::fmt;

use crate::frame::Quadruple;

/// A touch that changes values by fewer converter steps than this is invisible.
const LEAST_STEPS: f64 = 1.0;

/// Whether a skin is fit for use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Verdict {
    /// No problem was found.
    Good,
    /// Images will be worse than they could be.
    Usable,
    /// Images will be wrong.
    Faulty,
}

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Severity {
    /// Images are worse than they could be.
    Warning,
    /// Images are wrong.
    Fault,
}

/// What is wrong with the skin or its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Trouble {
    /// More than half of the electrode's values are flagged.
    Open {
        /// Fraction of its values with a flag.
        flagged_share: f64,
    },
    /// Reciprocity holds only without this electrode.
    Contact {
        /// Error of all measurements.
        with: f64,
        /// Error without the electrode.
        without: f64,
    },
    /// Measurements of this electrode contradict their reciprocals, or are dead.
    Contradicts,
    /// Measurements of this electrode repeat themselves exactly while others change.
    Repeats,
    /// Measurements at this electrode are noisier than the rest.
    Noisy {
        /// Noise relative to the rest.
        ratio: f64,
    },
    /// Reciprocity does not hold, and no single electrode explains it.
    Reciprocity {
        /// Reciprocity error.
        error: f64,
    },
    /// Values are at the end of the range.
    Saturation {
        /// Fraction of values.
        share: f64,
    },
    /// Frames or values were lost.
    Loss {
        /// Fraction of the data.
        share: f64,
    },
    /// Values stay constant while others change.
    Stuck {
        /// Number of such measurements.
        measurements: usize,
        /// The first of them.
        first: Quadruple,
        /// The second of them, if there is one.
        second: Option<Quadruple>,
    },
    /// The steps of the converter are too coarse for touches.
    Coarse {
        /// Smallest step, in the unit of the values.
        step: f64,
        /// Number of steps in a touch that changes the median voltage by 1 %.
        steps_per_touch: f64,
        /// Number of measurements that never change.
        still: usize,
        /// Number of all measurements.
        measurements: usize,
    },
    /// The frame rate differs from the requested one.
    Rate {
        /// Measured rate, in hertz.
        found_hz: f64,
        /// Requested rate, in hertz.
        wanted_hz: f64,
    },
    /// All measurements drift.
    Drift {
        /// Median change over the recording, in multiples of the noise of one value.
        over_noise: f64,
    },
    /// All values are 0.
    Silent,
    /// Every frame has the same values.
    Frozen {
        /// Number of frames, all equal.
        frames: usize,
    },
    /// The model of the untouched skin has other voltages.
    Model {
        /// Cosine of the angle between measured and modelled voltages.
        correlation: f64,
    },
    /// Touches in different places have the same voltages.
    Twins {
        /// Share of the skin whose touches cannot be told from touches elsewhere.
        share: f64,
    },
}

/// A problem and what to try.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Finding {
    /// Severity of the problem.
    pub severity: Severity,
    /// Electrode at fault, from 0; `None` if the problem is not that of one electrode.
    pub electrode: Option<u32>,
    /// Kind of problem.
    pub trouble: Trouble,
}

impl Finding {
    /// Creates the finding of a problem with one electrode, from 0.
    pub fn of_electrode(electrode: u32, trouble: Trouble) -> Self {
        let severity = match trouble {
            Trouble::Noisy { .. } => Severity::Warning,
            _ => Severity::Fault,
        };
        Self { severity, electrode: Some(electrode), trouble }
    }

    /// Creates the finding of a problem that is not that of one electrode.
    pub fn of_whole(trouble: Trouble) -> Self {
        let severity = match trouble {
            Trouble::Reciprocity { .. } | Trouble::Silent | Trouble::Model { .. } => {
                Severity::Fault
            }
            Trouble::Coarse { steps_per_touch, .. } if steps_per_touch < LEAST_STEPS => {
                Severity::Fault
            }
            _ => Severity::Warning,
        };
        Self { severity, electrode: None, trouble }
    }

    /// Returns what to try.
    pub fn advice(&self) -> &'static str {
        match self.trouble {
            Trouble::Open { .. } => "fasten its wire, and clean or press its contact",
            Trouble::Contact { .. } => {
                "its contact is bad or its wire is swapped: fasten it, and check its number"
            }
            Trouble::Contradicts => {
                "clean its contact, fasten its wire, and look for a bridge to its neighbours"
            }
            Trouble::Repeats => "check its wire and its channel of the multiplexer",
            Trouble::Noisy { .. } => "press its contact, and keep its wire away from motors",
            Trouble::Reciprocity { .. } => {
                "check `[protocol] order`, the numbering of the electrodes, and that nothing moves"
            }
            Trouble::Saturation { .. } => "lower the gain or the current",
            Trouble::Loss { .. } => {
                "use a shorter cable, a higher baud rate, or a lower frame rate"
            }
            Trouble::Stuck { .. } => "check the multiplexer channel of this measurement",
            Trouble::Coarse { .. } => {
                "raise the gain or the current, or use a converter with more bits"
            }
            Trouble::Rate { .. } => "request a rate that the instrument can sustain",
            Trouble::Drift { .. } => "let it warm up, and check that nothing rests on the skin",
            Trouble::Silent => "check the current source and the cable of the skin",
            Trouble::Frozen { .. } => {
                "press the skin and see whether anything changes: the board repeats an old frame, or its converter \
                 is too coarse for its noise"
            }
            Trouble::Model { .. } => {
                "check `[protocol]`, and the number, order and places of the electrodes"
            }
            Trouble::Twins { .. } => {
                "drive or measure pairs of other electrodes, such as adjacent ones"
            }
        }
    }
}

/// A measurement in words; electrodes are numbered from 1.
fn description(quadruple: Quadruple) -> String {
    let [a, b, m, n] = quadruple.map(|electrode| electrode + 1);
    format!("drive ({a}, {b}), pair ({m}, {n})")
}

impl fmt::Display for Finding {
    /// Formats the finding as one line; electrodes are numbered from 1.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(electrode) = self.electrode {
            write!(f, "electrode {}: ", electrode + 1)?;
        }
        match self.trouble {
            Trouble::Open { flagged_share } => {
                write!(f, "{:.0} % of its values are bad", 100.0 * flagged_share)
            }
            Trouble::Contact { with, without } => {
                write!(f, "reciprocity error {with:.2}, {without:.2} without it")
            }
            Trouble::Contradicts => {
                f.write_str("contradicts the others: it is open, shorted or noisy")
            }
            Trouble::Repeats => f.write_str("is stuck: its measurements repeat themselves"),
            Trouble::Noisy { ratio } => write!(f, "{ratio:.0} times as noisy as the rest"),
            Trouble::Reciprocity { error } => write!(f, "reciprocity error {error:.2}"),
            Trouble::Saturation { share } => {
                write!(f, "{:.1} % of the values are saturated", 100.0 * share)
            }
            Trouble::Loss { share } => write!(f, "{:.1} % of the data are lost", 100.0 * share),
            Trouble::Stuck { measurements, first, second } => {
                let Some(second) = second else {
                    return write!(f, "{} does not change; {}", description(first), self.advice());
                };
                let which = if measurements > 2 { ", the first two are" } else { ":" };
                let [first, second] = [first, second].map(description);
                write!(f, "{measurements} measurements do not change{which} {first} and {second}")
            }
            Trouble::Coarse { step, steps_per_touch, still, measurements } => write!(
                f,
                "converter steps of {step:.2e}: a touch of 1 % has {steps_per_touch:.1}, and {still} of \
                 {measurements} measurements never change"
            ),
            Trouble::Rate { found_hz, wanted_hz } => {
                write!(f, "{found_hz:.2} frames per second instead of {wanted_hz:.2}")
            }
            Trouble::Drift { over_noise } => {
                write!(f, "values drift by {over_noise:.0} times their noise")
            }
            Trouble::Silent => f.write_str("all values are 0"),
            Trouble::Frozen { frames } => write!(f, "all {frames} frames are equal"),
            Trouble::Model { correlation } => write!(
                f,
                "the voltages are not those of this skin's electrodes (correlation {correlation:.2})"
            ),
            Trouble::Twins { share } => write!(
                f,
                "touches on {:.0} % of the skin give the same voltages as touches elsewhere, and are not valid",
                (100.0 * share).max(1.0)
            ),
        }?;
        write!(f, "; {}", self.advice())
    }
}
