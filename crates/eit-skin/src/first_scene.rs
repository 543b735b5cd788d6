//! Writes the first scene of a new skin, from its measured size and the values that its board prints.
//!
//! 1. [`fitting_protocols`]: finds pair protocols with as many measurements as the board prints values,
//!    sorted by reciprocity and by the correlation of the untouched frame with the model.
//! 2. [`PressWatch`]: detects when the skin is pressed and held, and when it is released.
//! 3. [`find_numbering`]: finds which electrode is the first and in which direction they are counted, from
//!    presses at known places, whether a touch raises or lowers the conductivity, and whether two neighbouring
//!    electrodes have exchanged their wires.
//!
//! [`FirstScene::to_toml`] writes the result, with comments. Unknown values are those assumed for `paper-disc`:
//! normalised differences do not depend on the conductivity, and hardly on the contact impedance.
//!
//! ```
//! use eit_skin::first_scene::{FirstScene, Outline};
//! let scene = FirstScene::new(Outline::Rectangle { width_m: 0.12, height_m: 0.08 }, 16);
//! assert_eq!(scene.scene()?.skin.width_m, Some(0.12));
//! # Ok::<(), eit_skin::SkinError>(())
//! ```

mod numbering;
mod protocols;
mod transfer;

pub use crate::press_watch::{PressState, PressWatch};
pub use numbering::{KnownPress, Numbering, find_numbering};
pub(crate) use protocols::likeness;
pub use protocols::{FittingProtocol, OffPlace, fitting_protocols, is_frame};
pub(crate) use transfer::PairMatrix;

use crate::arrangement;
use crate::error::SkinError;
use crate::scene::{ChangeSign, Direction, Scene, ValueKind, from_toml};
use eit_fem::{DrivenElectrodes, PairProtocol};

/// Conductivity that `paper-disc` assumes, siemens per square.
const CONDUCTIVITY_S: f64 = 1e-5;
/// Contact impedance that `paper-disc` assumes, ohm metre.
const CONTACT_IMPEDANCE_OHM_M: f64 = 1e3;
/// Largest electrode width assumed where it was not measured, metres.
const WIDEST_M: f64 = 0.01;

/// Outline of a flat skin around the origin.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Outline {
    /// A disc, centred at the origin.
    Disc {
        /// Its radius, metres.
        radius_m: f64,
    },
    /// A rectangle, centred at the origin.
    Rectangle {
        /// Extent along x, metres.
        width_m: f64,
        /// Extent along y, metres.
        height_m: f64,
    },
}

impl Outline {
    /// Returns the length of the rim, metres.
    pub(crate) fn rim_m(&self) -> f64 {
        match *self {
            Self::Disc { radius_m } => std::f64::consts::TAU * radius_m,
            Self::Rectangle { width_m, height_m } => 2.0 * (width_m + height_m),
        }
    }

    /// Returns half of the extent along x and y, metres.
    pub(crate) fn half_extent_m(&self) -> [f64; 2] {
        match *self {
            Self::Disc { radius_m } => [radius_m, radius_m],
            Self::Rectangle { width_m, height_m } => [width_m / 2.0, height_m / 2.0],
        }
    }

    /// Returns where to press so that the electrode numbering can be determined: seven tenths of the way from
    /// the centre to the right rim, and to the upper rim. No rotation or reflection leaves both places fixed.
    pub fn press_places_m(&self) -> [[f64; 2]; 2] {
        let [x, y] = self.half_extent_m();
        [[0.7 * x, 0.0], [0.0, 0.7 * y]]
    }
}

/// What is known about a new skin. Electrodes are equally spaced along the rim.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FirstScene {
    /// Shape and size of the skin.
    pub outline: Outline,
    /// Number of electrodes on the rim.
    pub electrodes: usize,
    /// Length of rim that each electrode covers, metres.
    pub electrode_width_m: f64,
    /// Position of electrode 1, counter-clockwise from +x as seen from the centre, degrees.
    pub first_angle_deg: f64,
    /// Direction in which electrodes are counted.
    pub direction: Direction,
    /// The board's measurement protocol; of one that measures against a common electrode, of the pairs formed from its potentials.
    pub protocol: PairProtocol,
    /// Of a board that measures against a common electrode: whether it sends the potentials of driven electrodes, too.
    pub ground: Option<DrivenElectrodes>,
    /// "csv", "eits1" or a board's name.
    pub driver: String,
    /// Serial port or `tcp:HOST:PORT`.
    pub port: Option<String>,
    /// Baud rate of the serial line, if it is not the driver's default.
    pub baud: Option<u32>,
    /// Whether touches raise or lower the conductivity.
    pub sign: ChangeSign,
    /// What the board's values are.
    pub values: ValueKind,
}

impl FirstScene {
    /// Creates a first scene with default settings: electrodes cover half of the rim, at most 10 mm each; the
    /// first is at +x, counted counter-clockwise; adjacent drive and measurement; a board that prints lines
    /// of numbers.
    pub fn new(outline: Outline, electrodes: usize) -> Self {
        let spacing_m = outline.rim_m() / electrodes.max(1) as f64;
        Self {
            outline,
            electrodes,
            electrode_width_m: (0.5 * spacing_m).min(WIDEST_M),
            first_angle_deg: 0.0,
            direction: Direction::Counterclockwise,
            protocol: PairProtocol { electrodes, ..PairProtocol::default() },
            ground: None,
            driver: "csv".to_owned(),
            port: None,
            baud: None,
            sign: ChangeSign::Increase,
            values: ValueKind::Voltage,
        }
    }

    /// Returns the scene after checking it.
    ///
    /// # Errors
    /// Sizes that are not above zero; electrodes that overlap; a protocol that does not fit the electrodes.
    pub fn scene(&self) -> Result<Scene, SkinError> {
        if self.electrodes < 4 {
            return Err(SkinError::input(format!(
                "{} electrodes: two drive and two others measure, so 4 or more are needed",
                self.electrodes
            )));
        }
        let [x, y] = self.outline.half_extent_m();
        if let Some(size_m) =
            [x, y, self.electrode_width_m].iter().find(|s| !(s.is_finite() && **s > 0.0))
        {
            let message =
                format!("a size of the skin is {size_m} m: it must be finite and above 0");
            return Err(SkinError::input(message));
        }
        let place = "the new skin";
        let mut scene: Scene = from_toml(&self.to_toml(&[]), place)?;
        place.clone_into(&mut scene.place);
        place.clone_into(&mut scene.name);
        scene.check()?;
        let spacing_m = self.outline.rim_m() / self.electrodes as f64;
        if self.electrode_width_m >= spacing_m {
            return Err(SkinError::input(format!(
                "electrodes of {:.1} mm overlap: {} of them on this rim are {:.1} mm apart",
                self.electrode_width_m * 1e3,
                self.electrodes,
                spacing_m * 1e3
            )));
        }
        Ok(scene)
    }

    /// Returns the text of the scene file, with comments; `notes` come first.
    pub fn to_toml(&self, notes: &[String]) -> String {
        let mut text = String::new();
        for note in notes.iter().flat_map(|note| note.lines()) {
            text += &format!("# {note}\n");
        }
        let shape = match self.outline {
            Outline::Disc { radius_m } => format!("shape = \"disc\"\nradius_m = {radius_m}"),
            Outline::Rectangle { width_m, height_m } => format!(
                "shape = \"rectangle\"            # centred at the origin, x to the right, y up\n\
                 width_m = {width_m}\nheight_m = {height_m}"
            ),
        };
        let direction = match self.direction {
            Direction::Counterclockwise => "counterclockwise",
            Direction::Clockwise => "clockwise",
        };
        text += &format!(
            "[skin]\n{shape}\n\
             # the sheet was not measured. Touches and normalised images are relative to it, so the\n\
             # assumed value suffices; `eit calibrate` fits it if absolute images are needed\n\
             conductivity_s = {CONDUCTIVITY_S:e}\n\n\
             [electrodes]                   # equally spaced along the rim\n\
             count = {}\n\
             width_m = {}                 # length of rim that each covers\n\
             first_angle_deg = {}         # where electrode 1 is, counter-clockwise from +x\n\
             direction = \"{direction}\"\n\
             contact_impedance_ohm_m = {CONTACT_IMPEDANCE_OHM_M}   # hardly matters for adjacent pairs\n\n",
            self.electrodes,
            self.electrode_width_m,
            rounded(self.first_angle_deg),
        );
        text += &self.protocol_toml();
        text += &self.instrument_toml();
        if self.values != ValueKind::Voltage {
            let (name, meaning) = self.values.name();
            text += &format!(
                "\n[recording]\nvalues = \"{name}\"          # the board reports {meaning}\n"
            );
        }
        if self.sign == ChangeSign::Decrease {
            text +=
                "\n[touch]\nsign = \"decrease\"             # a touch lowers the conductivity\n";
        }
        text
    }

    fn protocol_toml(&self) -> String {
        let measure = match self.ground {
            Some(_) => "ground".to_owned(),
            None => arrangement::name(&self.protocol.measure),
        };
        let driven = self.ground.unwrap_or(self.protocol.driven_electrodes);
        let driven = arrangement::driven_name(driven);
        let order = arrangement::order_name(self.protocol.order);
        format!(
            "[protocol]\ndrive = \"{}\"\nmeasure = \"{measure}\"\n\
             driven_electrodes = \"{driven}\"      # \"keep\": current-carrying electrodes are measured, too\n\
             order = \"{order}\"              # \"rotated\" or \"ascending\": docs/SCENE.md\n\
             current_a = {:e}               # normalised differences do not depend on it\n\n",
            arrangement::name(&self.protocol.drive),
            self.protocol.current_a,
        )
    }

    fn instrument_toml(&self) -> String {
        let mut text = format!("[instrument]\ndriver = \"{}\"\n", self.driver);
        if let Some(port) = &self.port {
            text += &format!("port = {}\n", toml::Value::String(port.clone()));
        }
        if let Some(baud) = self.baud {
            text += &format!("baud = {baud}\n");
        }
        text
    }
}

/// Rounds to a thousandth of a degree.
fn rounded(angle_deg: f64) -> f64 {
    (angle_deg * 1e3).round() / 1e3 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skin::Skin;
    use eit_fem::{Order, PairPattern};

    #[test]
    fn what_is_written_is_read_back() {
        let outline = Outline::Rectangle { width_m: 0.12, height_m: 0.08 };
        let scene = FirstScene {
            first_angle_deg: 135.0,
            direction: Direction::Clockwise,
            protocol: PairProtocol {
                electrodes: 12,
                drive: PairPattern::Skip(2),
                driven_electrodes: DrivenElectrodes::Keep,
                order: Order::Ascending,
                ..PairProtocol::default()
            },
            port: Some("/dev/tty\"0".to_owned()),
            baud: Some(9600),
            sign: ChangeSign::Decrease,
            ..FirstScene::new(outline, 12)
        };
        let read = scene.scene().unwrap();
        assert_eq!(read.electrodes.first_angle_deg, Some(135.0));
        assert_eq!(read.electrodes.direction, Direction::Clockwise);
        assert_eq!(read.touch.sign, ChangeSign::Decrease);
        assert_eq!(read.instrument.as_ref().unwrap().port.as_deref(), Some("/dev/tty\"0"));
        let skin = Skin::from_scene(read).unwrap();
        assert_eq!(skin.protocol.quadruples().unwrap(), scene.protocol.quadruples().unwrap());
        let text = scene.to_toml(&["one\ntwo".to_owned()]);
        assert!(text.starts_with("# one\n# two\n[skin]\n"), "{text}");
    }

    #[test]
    fn sizes_that_cannot_be_are_refused() {
        for radius_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let scene = FirstScene::new(Outline::Disc { radius_m }, 16);
            assert!(scene.scene().is_err(), "{radius_m}");
        }
        let wide = FirstScene {
            electrode_width_m: 0.1,
            ..FirstScene::new(Outline::Disc { radius_m: 0.1 }, 16)
        };
        let said = wide.scene().unwrap_err().to_string();
        assert_eq!(
            said,
            "electrodes of 100.0 mm overlap: 16 of them on this rim are 39.3 mm apart"
        );
    }
}
