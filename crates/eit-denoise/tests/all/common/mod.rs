//! A U-net written down as its definition, in `f64` and without any cleverness.

use eit_denoise::{ImageStack, UnetShape, Weights};
use fixtures::Random;
use ndarray::{Array2, Array3};
use std::collections::BTreeMap;

/// Pixels of a disc.
pub fn disc(rows: usize, columns: usize) -> Array2<bool> {
    Array2::from_shape_fn((rows, columns), |(r, c)| {
        let at = |i: usize, n: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        at(r, rows).hypot(at(c, columns)) < 1.0
    })
}

/// Sizes that halving divides, and sizes that it does not.
pub const CASES: [(UnetShape, [usize; 2]); 4] = [
    (UnetShape { history: 1, width: 6, depth: 3, ..UnetShape::ONE_IMAGE }, [64, 64]),
    (UnetShape { history: 3, width: 4, depth: 1, ..UnetShape::ONE_IMAGE }, [20, 33]),
    (UnetShape { history: 2, width: 1, depth: 2, ..UnetShape::ONE_IMAGE }, [17, 9]),
    (UnetShape { history: 1, width: 5, depth: 4, ..UnetShape::ONE_IMAGE }, [32, 48]),
];

/// A bell in frame `f` that moves over an image of this size.
fn bell((f, r, c): (usize, usize, usize), (_, rows, columns): (usize, usize, usize)) -> f64 {
    let [y, x] = [r as f64 / rows as f64 - 0.4, c as f64 / columns as f64 - 0.3];
    let x = x - 0.03 * f as f64;
    (-(x * x + y * y) / 0.01).exp()
}

/// Frames of a bell that moves over noise, NaN outside the mask.
pub fn touched(frames: usize, mask: &Array2<bool>) -> Array3<f64> {
    let mut random = Random::new(5);
    let size = (frames, mask.nrows(), mask.ncols());
    Array3::from_shape_fn(size, |(f, r, c)| {
        let noise = 0.05 * random.between(-1.0, 1.0);
        if mask[[r, c]] { 1e-6 * (bell((f, r, c), size) + noise) } else { f64::NAN }
    })
}

/// Bells under noise and the bells alone, twice as large.
#[cfg(feature = "base")]
pub fn shard(frames: usize, pixels: usize) -> eit_denoise::Shard {
    let mask = disc(pixels, pixels);
    let noisy = touched(frames, &mask);
    let clean = Array3::from_shape_fn(noisy.dim(), |at| 2e-6 * bell(at, noisy.dim()));
    let stack = |images: Array3<f64>| ImageStack::new(images, mask.clone()).unwrap();
    eit_denoise::Shard::new(&stack(noisy), &stack(clean)).unwrap()
}

/// Random weights of about unit gain.
pub fn weights(shape: UnetShape, pixels: [usize; 2]) -> Weights {
    let mut random = Random::new(11);
    let mut parameters = Vec::new();
    for c in convolutions(shape) {
        let gain = (3.0 / (c[1] * c[2] * c[2]) as f64).sqrt();
        parameters.extend((0..c[0] * c[1] * c[2] * c[2]).map(|_| random.between(-gain, gain)));
        parameters.extend((0..c[0]).map(|_| random.between(-0.1, 0.1)));
    }
    let parameters = parameters.into_iter().map(|w| w as f32).collect();
    let (skin, about) = ("test".to_owned(), BTreeMap::new());
    Weights { shape, parameters, skin, pixels, about, model_error: None }
}

/// [outputs, inputs, side] of all convolutions.
pub fn convolutions(shape: UnetShape) -> Vec<[usize; 3]> {
    let channels = |level: usize| shape.width * 2_usize.pow(level as u32);
    let block = shape.fold * shape.fold;
    let inputs = block * (shape.history * shape.images + shape.conditions + 1);
    let mut list = vec![[channels(0), inputs, 3], [channels(0), channels(0), 3]];
    for l in 1..=shape.depth {
        list.extend([[channels(l), channels(l - 1), 3], [channels(l), channels(l), 3]]);
    }
    for l in (0..shape.depth).rev() {
        list.push([channels(l), channels(l) + channels(l + 1), 3]);
        list.push([channels(l), channels(l), 3]);
    }
    list.push([block, channels(0), 1]);
    list
}

/// Names of the tensors in files, in the order of the parameters.
#[cfg(feature = "burn")]
pub fn names(shape: UnetShape) -> Vec<String> {
    let down = (0..shape.depth).map(|level| format!("down.{level}"));
    let up = (0..shape.depth).rev().map(|level| format!("up.{level}"));
    let pairs = down.chain(["bottom".to_owned()]).chain(up);
    let all = pairs.flat_map(|pair| [format!("{pair}.0"), format!("{pair}.1")]);
    let all = all.chain(["head".to_owned()]);
    all.flat_map(|name| [format!("{name}.weight"), format!("{name}.bias")]).collect()
}

/// Channels.
pub type Planes = Vec<Array2<f64>>;

fn convolve(weights: &[f64], [outputs, inputs, side]: [usize; 3], from: &Planes) -> Planes {
    let (rows, columns) = from[0].dim();
    let biases = &weights[outputs * inputs * side * side..];
    let reach = side as i64 / 2;
    let pixel = |o: usize, r: usize, c: usize| {
        let mut sum = biases[o];
        for i in 0..inputs {
            for y in 0..side {
                for x in 0..side {
                    let [r, c] = [r as i64 + y as i64 - reach, c as i64 + x as i64 - reach];
                    if (0..rows as i64).contains(&r) && (0..columns as i64).contains(&c) {
                        let w = weights[((o * inputs + i) * side + y) * side + x];
                        sum += w * from[i][[r as usize, c as usize]];
                    }
                }
            }
        }
        sum
    };
    (0..outputs).map(|o| Array2::from_shape_fn((rows, columns), |(r, c)| pixel(o, r, c))).collect()
}

/// A plane as one plane for each place in blocks of `fold` x `fold` pixels.
fn blocks(plane: &Array2<f64>, fold: usize) -> Planes {
    let (rows, columns) = (plane.nrows() / fold, plane.ncols() / fold);
    let of = |k: usize| {
        Array2::from_shape_fn((rows, columns), |(r, c)| {
            plane[[fold * r + k / fold, fold * c + k % fold]]
        })
    };
    (0..fold * fold).map(of).collect()
}

/// The net on normalised frames (oldest first) and mask, all of padded size.
pub fn direct_f64(shape: UnetShape, parameters: &[f64], inputs: Planes) -> Array2<f64> {
    let mut rest = parameters.to_vec();
    let mut list = convolutions(shape).into_iter();
    let mut apply = |from: &Planes, least: f64| {
        let c = list.next().unwrap();
        let count = c[0] * c[1] * c[2] * c[2] + c[0];
        let own: Vec<f64> = rest.drain(..count).collect();
        let made = convolve(&own, c, from);
        made.into_iter().map(|p| p.mapv_into(|v| v.max(least))).collect::<Planes>()
    };
    let fold = shape.fold;
    let mut now: Planes = inputs.iter().flat_map(|plane| blocks(plane, fold)).collect();
    let mut skips = Vec::new();
    for level in 0..=shape.depth {
        now = apply(&now, 0.0);
        now = apply(&now, 0.0);
        if level < shape.depth {
            skips.push(now.clone());
            let halve = |p: &Array2<f64>| {
                Array2::from_shape_fn((p.nrows() / 2, p.ncols() / 2), |(r, c)| {
                    let four = [[0, 0], [0, 1], [1, 0], [1, 1]];
                    four.map(|[y, x]| p[[2 * r + y, 2 * c + x]])
                        .into_iter()
                        .fold(f64::MIN, f64::max)
                })
            };
            now = now.iter().map(halve).collect();
        }
    }
    while let Some(mut joined) = skips.pop() {
        let double = |p: &Array2<f64>| {
            Array2::from_shape_fn((2 * p.nrows(), 2 * p.ncols()), |(r, c)| p[[r / 2, c / 2]])
        };
        joined.extend(now.iter().map(double));
        now = apply(&joined, 0.0);
        now = apply(&now, 0.0);
    }
    let made = apply(&now, f64::NEG_INFINITY);
    let (rows, columns) = made[0].dim();
    let made = Array2::from_shape_fn((fold * rows, fold * columns), |(r, c)| {
        made[(r % fold) * fold + c % fold][[r / fold, c / fold]]
    });
    // a net of several images corrects the first of the last frame
    let UnetShape { history, images, .. } = shape;
    if images > 1 { made + &inputs[(history - 1) * images] } else { made }
}
