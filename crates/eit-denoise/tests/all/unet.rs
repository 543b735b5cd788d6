//! The net against its definition, and everything that happens to a running denoiser.
#![cfg(feature = "unet")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs, reason = "tests")]

use crate::common::{convolutions, direct, disc, touched, weights};
use eit_denoise::{DenoiseError, Denoiser, ImageStack, NetFrame, NetStatus, UnetShape, Weights};
use ndarray::{Array2, Array3, ArrayView2, Axis, ShapeBuilder};
use std::hint::black_box;

const SHAPES: [UnetShape; 4] = [
    UnetShape { history: 1, width: 6, depth: 3, ..UnetShape::ONE_IMAGE },
    UnetShape { history: 3, width: 4, depth: 1, ..UnetShape::ONE_IMAGE },
    UnetShape { history: 2, width: 1, depth: 2, ..UnetShape::ONE_IMAGE },
    UnetShape { history: 1, width: 5, depth: 4, ..UnetShape::ONE_IMAGE },
];

fn same_bits(a: &ImageStack, b: &ImageStack) -> bool {
    a.values().iter().zip(b.values()).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// What the definition makes of the last of some frames.
fn by_definition(weights: &Weights, frames: &Array3<f64>, mask: &Array2<bool>) -> Array2<f64> {
    let (count, rows, columns) = frames.dim();
    let step = 1 << weights.shape.depth;
    let size = (rows.next_multiple_of(step), columns.next_multiple_of(step));
    let frame = |back: usize, r: usize, c: usize| match count.checked_sub(1 + back) {
        Some(f) if r < rows && c < columns && mask[[r, c]] => frames[[f, r, c]],
        _ => 0.0,
    };
    let seen = (0..weights.shape.history).rev();
    let mut planes: Vec<Array2<f64>> =
        seen.map(|back| Array2::from_shape_fn(size, |(r, c)| frame(back, r, c))).collect();
    let scale = planes.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
    planes.iter_mut().for_each(|p| p.mapv_inplace(|v| v / scale));
    planes.push(Array2::from_shape_fn(size, |(r, c)| {
        f64::from(r < rows && c < columns && mask[[r, c]])
    }));
    direct(weights, planes).mapv(|v| v * scale)
}

/// What the net sees of a frame in `by_definition`: three images, of which two follow from the first,
/// one of them beyond the clamp, and two conditions.
fn inputs(images: &Array3<f64>) -> (Vec<Array3<f64>>, Array2<f64>) {
    let count = images.dim().0;
    let others = vec![images.mapv(|v| 0.3 * v.abs() + 1e-7), images.mapv(|v| -3.0 * v)];
    (others, Array2::from_shape_fn((count, 2), |(f, k)| 0.3 + 0.1 * f as f64 - 0.5 * k as f64))
}

/// Nets that see several images and conditions, folded and not, against the definition: which plane is
/// which, what scales them, and where each pixel of a block goes.
#[test]
fn several_images_conditions_and_folding_equal_the_definition() {
    let of = |history, width, depth, fold| UnetShape {
        history,
        width,
        depth,
        images: 3,
        conditions: 2,
        fold,
    };
    for (shape, size) in
        [(of(1, 8, 2, 2), [32, 32]), (of(2, 3, 1, 2), [18, 13]), (of(2, 4, 2, 1), [20, 12])]
    {
        let mask = disc(size[0], size[1]);
        let weights = weights(shape, size);
        assert_eq!(weights.parameters.len(), shape.parameters(), "{shape:?}");
        let raw = touched(3, &mask);
        let (others, conditions) = inputs(&raw);
        let stack = ImageStack::new(raw.clone(), mask.clone()).unwrap();
        let views: Vec<_> = others.iter().map(|o| o.view()).collect();
        let mut net = Denoiser::new(&weights, mask.view()).unwrap();
        let made = net.denoise_with(&stack, &views, Some(conditions.view())).unwrap();
        let padded = size.map(|n| n.next_multiple_of(shape.fold << shape.depth));
        let inside = |r: usize, c: usize| r < size[0] && c < size[1] && mask[[r, c]];
        for last in 0..3_usize {
            let all: Vec<&Array3<f64>> = [&raw].into_iter().chain(&others).collect();
            let mut planes: Vec<Array2<f64>> = Vec::new();
            for back in (0..shape.history).rev() {
                for images in &all {
                    planes.push(Array2::from_shape_fn(padded, |(r, c)| {
                        match last.checked_sub(back) {
                            Some(f) if inside(r, c) => images[[f, r, c]],
                            _ => 0.0,
                        }
                    }));
                }
            }
            let firsts = planes.iter().step_by(all.len()).flatten();
            let scale = firsts.fold(0.0_f64, |m, v| m.max(v.abs()));
            planes.iter_mut().for_each(|p| p.mapv_inplace(|v| (v / scale).clamp(-2.0, 2.0)));
            for condition in conditions.row(last) {
                planes.push(Array2::from_shape_fn(padded, |(r, c)| {
                    if inside(r, c) { *condition } else { 0.0 }
                }));
            }
            planes.push(Array2::from_shape_fn(padded, |(r, c)| f64::from(inside(r, c))));
            let wanted = direct(&weights, planes).mapv(|v| v * scale);
            let most = wanted.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for ((at, value), inside) in made.frame(last).unwrap().indexed_iter().zip(&mask) {
                assert_eq!(value.is_nan(), !inside);
                let off = if *inside { (value - wanted[at]).abs() / most } else { 0.0 };
                assert!(off < 1e-5, "{shape:?} frame {last} {at:?}: {value} {}", wanted[at]);
            }
        }
    }
}

/// Another number of inputs is an error; a first image of zeros gives zero whatever the others are.
#[test]
fn inputs_are_counted_and_zero_gives_zero() {
    let shape =
        UnetShape { width: 4, depth: 1, images: 2, conditions: 1, fold: 2, ..Default::default() };
    let mask = disc(16, 16);
    let mut net = Denoiser::new(&weights(shape, [16, 16]), mask.view()).unwrap();
    let (zero, ones) = (Array2::zeros((16, 16)), mask.mapv(|m| f64::from(u8::from(m))));
    let mut out = Array2::zeros((16, 16));
    let images = [zero.view(), ones.view()];
    let frame = NetFrame { images: &images, conditions: &[0.5] };
    assert_eq!(net.push_frame_into(frame, out.view_mut()).unwrap(), NetStatus::Zero);
    assert!(out.iter().zip(&mask).all(|(v, inside)| !inside || *v == 0.0));
    let refused = net.push_into(ones.view(), out.view_mut()).unwrap_err().to_string();
    assert_eq!(refused, "1 images per frame where 2 are wanted");
    let frame = NetFrame { images: &images, conditions: &[] };
    let refused = net.push_frame_into(frame, out.view_mut()).unwrap_err().to_string();
    assert_eq!(refused, "0 conditions per frame where 1 are wanted");
    let images = [ones.view(), zero.view()];
    let frame = NetFrame { images: &images, conditions: &[f64::NAN] };
    assert!(net.push_frame_into(frame, out.view_mut()).is_err());
}

/// Files of nets of any shape come back; another version of the format is rejected.
#[test]
fn files_come_back() {
    for [images, conditions, fold] in [[1, 0, 1], [1, 1, 2], [3, 1, 2]] {
        let shape = UnetShape { images, conditions, fold, ..UnetShape::ONE_IMAGE };
        let weights = weights(shape, [16, 16]);
        let mut bytes = weights.to_bytes().unwrap();
        assert_eq!(Weights::from_bytes(&bytes).unwrap(), weights);
        let version = b"\"format_version\":\"3\"";
        let at = bytes.windows(version.len()).position(|part| part == version).unwrap();
        bytes[at + version.len() - 2] = b'2';
        let refused = Weights::from_bytes(&bytes).unwrap_err().to_string();
        assert!(refused.contains("version 2 of the format"), "{refused}");
    }
}

/// Rounding of `f32`: sums of at most 700 terms of about unit size in eleven layers, each off by
/// 1e-7 of its size; 1e-5 leaves a factor of ten.
#[test]
fn equals_its_definition() {
    for (shape, size) in SHAPES.into_iter().zip([(64, 64), (20, 33), (17, 9), (32, 48)]) {
        let mask = disc(size.0, size.1);
        let weights = weights(shape, [size.0, size.1]);
        assert_eq!(weights.parameters.len(), shape.parameters(), "{shape:?}");
        let frames = touched(4, &mask);
        let stack = ImageStack::new(frames.clone(), mask.clone()).unwrap();
        let made = Denoiser::new(&weights, mask.view()).unwrap().denoise(&stack).unwrap();
        for last in 0..4 {
            let seen = frames.select(Axis(0), &(0..=last).collect::<Vec<_>>());
            let wanted = by_definition(&weights, &seen, &mask);
            let size = wanted.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            assert!(size > 0.0, "{shape:?}");
            for ((place, value), inside) in made.frame(last).unwrap().indexed_iter().zip(&mask) {
                assert_eq!(value.is_nan(), !inside);
                let off = if *inside { (value - wanted[place]).abs() / size } else { 0.0 };
                assert!(off < 1e-5, "{shape:?} frame {last} {place:?}: {value} {}", wanted[place]);
            }
        }
    }
}

#[test]
fn frame_by_frame_and_whole_give_the_same_bits() {
    let shape = UnetShape { history: 3, width: 4, depth: 2, ..UnetShape::ONE_IMAGE };
    let mask = disc(32, 32);
    let stack = ImageStack::new(touched(7, &mask), mask.clone()).unwrap();
    let mut net = Denoiser::new(&weights(shape, [32, 32]), mask.view()).unwrap();
    let whole = net.denoise(&stack).unwrap();
    let again = net.denoise(&stack).unwrap();
    assert!(same_bits(&whole, &again), "a sequence leaves nothing behind");
    net.reset();
    let mut single = stack.values().to_owned();
    for (image, out) in stack.iter().zip(single.axis_iter_mut(Axis(0))) {
        net.push_into(image, out).unwrap();
    }
    assert!(same_bits(&whole, &ImageStack::new(single, mask).unwrap()));
}

/// Powers of two change no rounding.
#[test]
fn scale_passes_through_and_zero_stays_zero() {
    let mask = disc(24, 24);
    let frames = touched(3, &mask);
    let mut net = Denoiser::new(&weights(UnetShape::default(), [24, 24]), mask.view()).unwrap();
    let plain = net.denoise(&ImageStack::new(frames.clone(), mask.clone()).unwrap()).unwrap();
    let large = net.denoise(&ImageStack::new(frames * 1024.0, mask.clone()).unwrap()).unwrap();
    let scaled = ImageStack::new(plain.values().to_owned() * 1024.0, mask.clone()).unwrap();
    assert!(same_bits(&large, &scaled));
    let zero = ImageStack::new(Array3::zeros((2, 24, 24)), mask).unwrap();
    assert_eq!(net.denoise(&zero).unwrap().max_abs(), 0.0);
}

/// Zeros that are told at a glance, and zeros that take the long way (an array by columns): the same
/// bits and the same sequence after them. A net with a history looks at zeros as long as it remembers
/// anything else.
#[test]
fn zeros_cost_no_net_and_change_no_bit() {
    let mask = disc(24, 24);
    let frames = touched(4, &mask);
    let shape = UnetShape { history: 3, width: 4, depth: 2, ..UnetShape::ONE_IMAGE };
    let mut net = Denoiser::new(&weights(shape, [24, 24]), mask.view()).unwrap();
    let mut other = net.clone();
    // whatever stands outside is not looked at
    let mut zero = mask.mapv(|inside| if inside { -0.0 } else { 7.0 });
    zero[[12, 12]] = 0.0;
    let mut by_columns = Array2::zeros((24, 24).f());
    let bits = |image: ArrayView2<'_, f64>| image.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let images = [0, 1, 9, 9, 9, 9, 2, 9, 3];
    let mut found = Vec::new();
    for k in images {
        let image = if k == 9 { zero.view() } else { frames.index_axis(Axis(0), k) };
        let mut out = Array2::from_elem((24, 24), 5.0);
        let status = net.push_into(image, out.view_mut()).unwrap();
        by_columns.assign(&image);
        let mut long_way = Array2::from_elem((24, 24).f(), 5.0);
        let other = other.push_into(by_columns.view(), long_way.view_mut()).unwrap();
        assert_eq!(status, other);
        assert_eq!(bits(out.view()), bits(long_way.view()));
        let all_zero = out.iter().zip(&mask).all(|(v, inside)| !inside || v.to_bits() == 0);
        assert_eq!(status == NetStatus::Zero, all_zero, "image {k}");
        found.push(status == NetStatus::Zero);
    }
    assert_eq!(found, [false, false, false, false, true, true, false, false, false]);
    net.reset();
    let mut out = Array2::zeros((24, 24));
    assert_eq!(net.push_into(zero.view(), out.view_mut()).unwrap(), NetStatus::Zero);
    zero[[12, 12]] = f64::NAN;
    let refused = net.push_into(zero.view(), out.view_mut()).unwrap_err();
    assert!(refused.to_string().contains("frame 1 holds NaN at row 12, column 12"), "{refused}");
}

#[test]
fn allocates_nothing_after_set_up() {
    let mask = disc(64, 64);
    let frames = touched(8, &mask);
    let shape = UnetShape { history: 2, ..Default::default() };
    let mut net = Denoiser::new(&weights(shape, [64, 64]), mask.view()).unwrap();
    let mut out = Array2::zeros((64, 64));
    let counted = allocation_counter::measure(|| {
        for image in frames.outer_iter() {
            net.push_into(image, out.view_mut()).unwrap();
        }
    });
    assert_eq!(counted.count_total, 0);
    // the counter counts
    assert!(allocation_counter::measure(|| drop(black_box(vec![0_u8; 100]))).count_total > 0);
}

#[test]
fn bad_images_are_refused_and_leave_the_sequence_as_it_was() {
    let mask = disc(16, 16);
    let frames = touched(3, &mask);
    let shape = UnetShape { history: 2, width: 2, depth: 2, ..UnetShape::ONE_IMAGE };
    let mut net = Denoiser::new(&weights(shape, [16, 16]), mask.view()).unwrap();
    let frame = |f: usize| frames.index_axis(Axis(0), f);
    let mut out = Array2::zeros((16, 16));
    net.push_into(frame(0), out.view_mut()).unwrap();
    let mut undisturbed = net.clone();
    let mut wanted = out.clone();
    undisturbed.push_into(frame(1), wanted.view_mut()).unwrap();

    let says = |result: Result<NetStatus, DenoiseError>, text: &str| {
        let message = result.unwrap_err().to_string();
        assert!(message.contains(text), "{message}");
    };
    let small = Array2::zeros((16, 12));
    says(net.push_into(small.view(), out.view_mut()), "16 rows and 12 columns");
    let mut bad = frame(1).to_owned();
    bad[[8, 9]] = f64::INFINITY;
    says(net.push_into(bad.view(), out.view_mut()), "frame 1 holds inf at row 8, column 9");
    let flat = Array2::from_elem((16, 16), 2.5);
    says(
        net.push_into(flat.view(), out.view_mut()),
        "frame 1: the image is 2.5 everywhere on the skin",
    );
    let other = ImageStack::new(Array3::zeros((1, 16, 16)), Array2::from_elem((16, 16), true));
    says(net.denoise(&other.unwrap()).map(|_| NetStatus::Zero), "of another skin");

    // in a stack the flat frame stays as it is, and the net does not see it
    let mut three = frames.clone();
    three.index_axis_mut(Axis(0), 1).fill(2.5);
    three.index_axis_mut(Axis(0), 2).assign(&frame(1));
    let stack = ImageStack::new(three, mask.clone()).unwrap();
    let made = net.clone().denoise(&stack).unwrap();
    let inside = |f: usize| {
        let image = made.frame(f).unwrap();
        let pixels = image.iter().zip(&mask).filter(|(_, inside)| **inside);
        pixels.map(|(value, _)| value.to_bits()).collect::<Vec<_>>()
    };
    assert!(inside(1).iter().all(|bits| f64::from_bits(*bits) == 2.5));
    let pixels = wanted.iter().zip(&mask).filter(|(_, inside)| **inside);
    assert_eq!(inside(2), pixels.map(|(value, _)| value.to_bits()).collect::<Vec<_>>());

    net.push_into(frame(1), out.view_mut()).unwrap();
    let bits = |a: &Array2<f64>| a.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&out), bits(&wanted));
}

#[test]
fn weights_come_back_from_their_file_bit_by_bit() {
    for shape in SHAPES {
        let mut weights = weights(shape, [64, 48]);
        weights.about.insert("seed".to_owned(), "7".to_owned());
        let bytes = weights.to_bytes().unwrap();
        assert_eq!(Weights::from_bytes(&bytes).unwrap(), weights);
        // the same bytes again: nothing depends on the order of a hash map
        assert_eq!(weights.to_bytes().unwrap(), bytes);
    }
}

#[test]
fn bad_weights_are_refused() {
    let shape = UnetShape { history: 1, width: 2, depth: 1, ..UnetShape::ONE_IMAGE };
    let good = weights(shape, [16, 16]);
    let bytes = good.to_bytes().unwrap();
    // a cut at any place, and foreign files
    for end in 0..bytes.len() {
        let error = Weights::from_bytes(&bytes[..end]).unwrap_err();
        assert!(matches!(error, DenoiseError::Format { .. }), "{end}: {error}");
    }
    for foreign in [&b"PK\x03\x04 not weights at all"[..], &[0; 64], &[255; 64]] {
        assert!(matches!(Weights::from_bytes(foreign), Err(DenoiseError::Format { .. })));
    }
    let says = |weights: Weights, text: &str| {
        let message = weights.to_bytes().unwrap_err().to_string();
        assert!(message.contains(text), "{message}");
    };
    let mut bad = good.clone();
    bad.parameters[4] = f32::NAN;
    says(bad, "weight 4 is NaN");
    let mut bad = good.clone();
    bad.parameters.pop();
    let count = good.parameters.len();
    says(bad, &format!("{} weights where {count} are wanted", count - 1));
    let mut bad = good.clone();
    bad.shape.depth = 9;
    says(bad, "depth is 9: it must be 1 to 6");
    let mut bad = good.clone();
    bad.about.insert("width".to_owned(), "3".to_owned());
    says(bad, "\"width\" belongs to the format");

    assert!(good.check_skin("test", [16, 16]).is_ok());
    let error = good.check_skin("arm", [16, 16]).unwrap_err().to_string();
    assert!(
        error.contains("for skin test at 16 x 16 pixels, these images are of skin arm"),
        "{error}"
    );
    assert!(good.check_skin("test", [32, 16]).is_err());
    assert!(Denoiser::new(&good, Array2::from_elem((8, 8), false).view()).is_err());
}

/// The sizes of the definition and of the crate.
#[test]
fn shapes_count_alike() {
    for shape in SHAPES {
        let count: usize =
            convolutions(shape).iter().map(|c| c[0] * c[1] * c[2] * c[2] + c[0]).sum();
        assert_eq!(shape.parameters(), count);
    }
    // Ronneberger's net with equal padding, two inputs and one output: 31 million with the
    // convolutions that double the image, which repetition does without
    let paper = UnetShape { history: 1, width: 64, depth: 4, ..UnetShape::ONE_IMAGE };
    assert!((2.5e7..4e7).contains(&(paper.parameters() as f64)), "{}", paper.parameters());
}

#[test]
fn the_shipped_weights_are_whole_and_small() {
    let weights = Weights::paper_disc().unwrap();
    assert_eq!(weights.pixels, [64, 64]);
    assert!(4 * weights.parameters.len() < 2_000_000, "{}", weights.parameters.len());
    assert!(weights.about["recipe"].starts_with("st-tv"), "{:?}", weights.about);
}
