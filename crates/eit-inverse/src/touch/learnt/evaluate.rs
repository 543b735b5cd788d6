//! Strength and score of one more touch at many places: all that a frame costs.

use super::basis::{LANES, minus2};
use super::search::Skin;
use pulp::{Simd, WithSimd};

/// Strength and -2 ln L of one more touch at each of some places.
pub(super) struct Evaluate<'a> {
    pub(super) skin: Skin<'a>,
    pub(super) places: &'a [usize],
    pub(super) rest: &'a [f64],
    pub(super) variance: &'a [f64],
    pub(super) first: f64,
    pub(super) rounds: usize,
    pub(super) freedom: f64,
    pub(super) strengths: &'a mut [f64],
    pub(super) scores: &'a mut [f64],
}

impl WithSimd for Evaluate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { skin, places, rest, variance, first, rounds, freedom, .. } = self;
        let Skin { basis, of_places, .. } = skin;
        let outs = self.strengths.iter_mut().zip(self.scores.iter_mut());
        for (&place, (strength, score)) in places.iter().zip(outs) {
            let response = basis.response(place);
            *strength = first;
            for _ in 0..rounds {
                let weight = *strength * *strength * of_places[place];
                let (mut product, mut square) = ([0.0; LANES], [0.0; LANES]);
                for (((g, r), v), l) in lanes(response, rest, variance, &basis.lambda) {
                    for i in 0..LANES {
                        let part = g[i] / (v[i] + weight * l[i]);
                        product[i] += part * r[i];
                        square[i] += part * g[i];
                    }
                }
                let square = square.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                *strength = (product.iter().sum::<f64>() / square).max(0.0);
            }
            let weight = *strength * *strength * of_places[place];
            let (mut square, mut determinant) = ([0.0; LANES], [1.0; LANES]);
            let mut logarithm = 0.0;
            for (chunk, (((g, r), v), l)) in
                lanes(response, rest, variance, &basis.lambda).enumerate()
            {
                for i in 0..LANES {
                    let variance = v[i] + weight * l[i];
                    let left = r[i] - *strength * g[i];
                    square[i] += left * left / variance;
                    determinant[i] *= variance;
                }
                // products of eight stay below 1e308 for variances up to 1e38
                if chunk % 8 == 7 {
                    logarithm += determinant.iter().map(|d| d.ln()).sum::<f64>();
                    determinant = [1.0; LANES];
                }
            }
            logarithm += determinant.iter().map(|d| d.ln()).sum::<f64>();
            *score = minus2(square.iter().sum(), logarithm, basis.channels.len(), freedom);
        }
    }
}

type Lanes<'a> = (((&'a [f64; LANES], &'a [f64; LANES]), &'a [f64; LANES]), &'a [f64; LANES]);

#[inline(always)]
fn lanes<'a>(
    response: &'a [f64],
    rest: &'a [f64],
    variance: &'a [f64],
    lambda: &'a [f64],
) -> impl Iterator<Item = Lanes<'a>> {
    let [response, rest, variance, lambda] =
        [response, rest, variance, lambda].map(|values| values.as_chunks::<LANES>().0);
    response.iter().zip(rest).zip(variance).zip(lambda)
}
