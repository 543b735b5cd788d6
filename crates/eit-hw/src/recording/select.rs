//! The measurements of a protocol out of a recording.

use std::collections::HashMap;

use ndarray::Array2;

use super::{CountHint, Layout, Recording, Unit};
use crate::error::HwError;
use crate::frame::{Frame, Quadruple, Quality};
use crate::health::unsigned;

/// Which real number is taken of each complex value z = x + i y.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Component {
    /// x.
    #[default]
    Real,
    /// y.
    Imaginary,
    /// sqrt(x^2 + y^2); it has no sign.
    Magnitude,
    /// Re(z exp(-i theta)) with one theta = arg(sum z^2) / 2 in (-pi/2, pi/2] over all good values
    /// of all frames: the projection on the axis that holds most of the signal. The squares make
    /// it blind to the signs of the measurements; the range keeps the sign of Re z where it is not
    /// small.
    Phased,
}

/// Frames as real numbers in protocol order.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredFrames {
    /// Values, [frame, measurement]. A value that is not good may be NaN.
    pub values: Array2<f64>,
    /// Flags of each value, [frame, measurement].
    pub quality: Array2<Quality>,
    /// Unit of the values.
    pub unit: Unit,
    /// The instrument's time of each frame in seconds since the first one.
    pub device_time_s: Option<Vec<f64>>,
}

impl MeasuredFrames {
    /// The frames one by one, as a stream would bring them: `sequence` counts them from 0 in
    /// epoch 0, without host time.
    pub fn frames(&self) -> impl Iterator<Item = Frame> + '_ {
        self.values.rows().into_iter().zip(self.quality.rows()).zip(0_u64..).map(
            |((values, quality), sequence)| Frame {
                values: values.to_vec(),
                quality: quality.to_vec(),
                sequence,
                epoch: 0,
                device_time_s: usize::try_from(sequence)
                    .ok()
                    .and_then(|frame| self.device_time_s.as_ref()?.get(frame).copied()),
                host_time_s: None,
            },
        )
    }

    /// Mean of the good values of each measurement over all frames, NaN where there is none.
    pub fn mean_frame(&self) -> Vec<f64> {
        let mean = |(values, quality): (ndarray::ArrayView1<f64>, ndarray::ArrayView1<Quality>)| {
            let good = || values.iter().zip(quality).filter(|(_, quality)| quality.is_good());
            good().map(|(value, _)| value).sum::<f64>() / good().count() as f64
        };
        self.values.columns().into_iter().zip(self.quality.columns()).map(mean).collect()
    }
}

/// One measurement as a signed difference of recorded values.
#[derive(Clone, Copy)]
struct Pick {
    plus: usize,
    minus: Option<usize>,
    sign: f64,
}

impl Recording {
    /// The `count` measurements of a protocol, in its order.
    ///
    /// `quadruples` are those of the protocol, `None` if it has general current patterns; only a
    /// recording with [`Layout::AsScene`] fits then.
    ///
    /// # Errors
    /// [`HwError::CountMismatch`] with both counts where the file has another number of values;
    /// [`HwError::MissingDrive`], [`HwError::MissingMeasurement`] or [`HwError::MissingElectrode`]
    /// where it lacks some; [`HwError::NeedsQuadruples`], [`HwError::NoImaginaryPart`],
    /// [`HwError::QuadrupleCount`] and [`HwError::Inconsistent`] as they say.
    pub fn frames_for(
        &self,
        quadruples: Option<&[Quadruple]>,
        count: usize,
        component: Component,
    ) -> Result<MeasuredFrames, HwError> {
        self.check()?;
        let picks = self.picks(quadruples, count)?;
        let quality = Array2::from_shape_fn((self.frame_count(), count), |(frame, index)| {
            let pick = picks[index];
            let minus = pick.minus.map_or(Quality::GOOD, |minus| self.quality[[frame, minus]]);
            self.quality[[frame, pick.plus]] | minus
        });
        let real = picked(&self.real, &picks);
        let imaginary = self.imaginary.as_ref().map(|imaginary| picked(imaginary, &picks));
        let values = match (component, imaginary) {
            (Component::Real, _) | (Component::Phased, None) => real,
            (Component::Imaginary, Some(imaginary)) => imaginary,
            (Component::Imaginary, None) => {
                return Err(HwError::NoImaginaryPart { place: self.place() });
            }
            (Component::Magnitude, Some(imaginary)) => {
                ndarray::Zip::from(&real).and(&imaginary).map_collect(|x, y| x.hypot(*y))
            }
            (Component::Magnitude, None) => real.mapv(f64::abs),
            (Component::Phased, Some(imaginary)) => phased(&real, &imaginary, &quality),
        };
        Ok(MeasuredFrames {
            values,
            quality,
            unit: self.unit,
            device_time_s: self.device_time_s.clone(),
        })
    }

    /// Where each measurement stands in a recorded frame.
    fn picks(&self, quadruples: Option<&[Quadruple]>, count: usize) -> Result<Vec<Pick>, HwError> {
        if let Some(quadruples) = quadruples
            && quadruples.len() != count
        {
            return Err(HwError::QuadrupleCount { quadruples: quadruples.len(), count });
        }
        let needed = || quadruples.ok_or_else(|| HwError::NeedsQuadruples { place: self.place() });
        match &self.layout {
            Layout::AsScene if self.value_count() == count => {
                Ok((0..count).map(|plus| Pick { plus, minus: None, sign: 1.0 }).collect())
            }
            Layout::AsScene => Err(HwError::CountMismatch {
                place: self.place(),
                found: self.value_count(),
                frames: self.frame_count(),
                wanted: count,
                hint: CountHint::of(self.value_count(), self.frame_count(), count),
            }),
            Layout::Quadruples(recorded) => self.by_quadruple(recorded, needed()?),
            Layout::Potentials { drives, electrodes } => {
                self.by_potential(drives, *electrodes, needed()?)
            }
        }
    }

    fn by_quadruple(
        &self,
        recorded: &[Quadruple],
        wanted: &[Quadruple],
    ) -> Result<Vec<Pick>, HwError> {
        let mut place_of = HashMap::with_capacity(recorded.len());
        for (index, &quadruple) in recorded.iter().enumerate() {
            let (key, sign) = unsigned(quadruple);
            place_of.entry(key).or_insert((index, sign));
        }
        let missing = |quadruple: Quadruple| {
            let drive = |[a, b, ..]: Quadruple| [a.min(b), a.max(b)];
            match recorded.first() {
                Some(&[first_a, first_b, ..])
                    if !recorded.iter().any(|&other| drive(other) == drive(quadruple)) =>
                {
                    let [a, b, ..] = quadruple;
                    HwError::MissingDrive { place: self.place(), a, b, first_a, first_b }
                }
                _ => HwError::MissingMeasurement { place: self.place(), quadruple },
            }
        };
        wanted
            .iter()
            .map(|&quadruple| {
                let (key, sign) = unsigned(quadruple);
                let (plus, recorded_sign) =
                    *place_of.get(&key).ok_or_else(|| missing(quadruple))?;
                Ok(Pick { plus, minus: None, sign: sign * recorded_sign })
            })
            .collect()
    }

    fn by_potential(
        &self,
        drives: &[[u32; 2]],
        electrodes: usize,
        wanted: &[Quadruple],
    ) -> Result<Vec<Pick>, HwError> {
        let mut number_of = HashMap::with_capacity(drives.len());
        for (number, &drive) in drives.iter().enumerate() {
            number_of.entry(drive).or_insert(number);
        }
        let checked = |electrode: u32| {
            let index = electrode as usize;
            if index < electrodes {
                Ok(index)
            } else {
                Err(HwError::MissingElectrode { place: self.place(), electrode, count: electrodes })
            }
        };
        wanted
            .iter()
            .map(|&[a, b, m, n]| {
                for driven in [a, b] {
                    checked(driven)?;
                }
                let (m, n) = (checked(m)?, checked(n)?);
                let (number, sign) = match (number_of.get(&[a, b]), number_of.get(&[b, a])) {
                    (Some(&number), _) => (number, 1.0),
                    (None, Some(&number)) => (number, -1.0),
                    (None, None) => {
                        let [first_a, first_b] = drives.first().copied().unwrap_or_default();
                        let place = self.place();
                        return Err(HwError::MissingDrive { place, a, b, first_a, first_b });
                    }
                };
                let first = number * electrodes;
                Ok(Pick { plus: first + m, minus: Some(first + n), sign })
            })
            .collect()
    }
}

/// `values` [frame, recorded value] as [frame, measurement].
fn picked(values: &Array2<f64>, picks: &[Pick]) -> Array2<f64> {
    Array2::from_shape_fn((values.nrows(), picks.len()), |(frame, index)| {
        let Pick { plus, minus, sign } = picks[index];
        sign * (values[[frame, plus]] - minus.map_or(0.0, |minus| values[[frame, minus]]))
    })
}

/// [`Component::Phased`].
fn phased(real: &Array2<f64>, imaginary: &Array2<f64>, quality: &Array2<Quality>) -> Array2<f64> {
    let (mut square_real, mut square_imaginary) = (0.0, 0.0);
    ndarray::Zip::from(real).and(imaginary).and(quality).for_each(|x, y, quality| {
        if quality.is_good() {
            square_real += x * x - y * y;
            square_imaginary += 2.0 * x * y;
        }
    });
    let (sine, cosine) = (0.5 * f64::atan2(square_imaginary, square_real)).sin_cos();
    ndarray::Zip::from(real).and(imaginary).map_collect(|x, y| x * cosine + y * sine)
}
