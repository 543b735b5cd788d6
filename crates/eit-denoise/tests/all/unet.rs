//! The net against its definition, and everything that happens to a running denoiser.
#![cfg(feature = "unet")]

use crate::common::{CASES, direct_f64, disc, touched, weights};
use crate::says;
use eit_denoise::{Denoiser, ImageStack, NetFrame, NetStatus, UnetShape, Weights};
use ndarray::{Array2, Array3, ArrayView2, Axis, ShapeBuilder};
use std::hint::black_box;

fn bits<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<u64> {
    values.into_iter().map(|v| v.to_bits()).collect()
}

fn inside(image: ArrayView2<'_, f64>, mask: &Array2<bool>) -> Vec<u64> {
    bits(image.iter().zip(mask).filter(|(_, inside)| **inside).map(|(value, _)| value))
}

/// What the definition makes of a frame. The first image, with those of earlier frames, sets the scale.
fn by_definition(
    weights: &Weights,
    images: &[&Array3<f64>],
    conditions: &Array2<f64>,
    mask: &Array2<bool>,
    last: usize,
) -> Array2<f64> {
    let (rows, columns) = mask.dim();
    let step = weights.shape.fold << weights.shape.depth;
    let size = (rows.next_multiple_of(step), columns.next_multiple_of(step));
    let plane = |value: &dyn Fn(usize, usize) -> f64| {
        let inside = |r: usize, c: usize| r < rows && c < columns && mask[[r, c]];
        Array2::from_shape_fn(size, |(r, c)| if inside(r, c) { value(r, c) } else { 0.0 })
    };
    let mut planes: Vec<Array2<f64>> = Vec::new();
    for back in (0..weights.shape.history).rev() {
        let frame = last.checked_sub(back);
        let of = |images: &Array3<f64>| plane(&|r, c| frame.map_or(0.0, |f| images[[f, r, c]]));
        planes.extend(images.iter().map(|images| of(images)));
    }
    let firsts = planes.iter().step_by(images.len()).flatten();
    let scale = firsts.fold(0.0_f64, |m, v| m.max(v.abs()));
    planes.iter_mut().for_each(|p| p.mapv_inplace(|v| (v / scale).clamp(-2.0, 2.0)));
    planes.extend(conditions.row(last).iter().map(|condition| plane(&|_, _| *condition)));
    planes.push(plane(&|_, _| 1.0));
    let parameters: Vec<f64> = weights.parameters.iter().map(|w| f64::from(*w)).collect();
    direct_f64(weights.shape, &parameters, planes).mapv(|v| v * scale)
}

/// Nets that see one or several images and conditions, folded and not, against the definition: which plane is
/// which, what scales them, and where each pixel of a block goes. Two images follow from the first, one of them beyond
/// the clamp.
///
/// Rounding of `f32`: sums of at most 700 terms of about unit size in eleven layers, each off by
/// 1e-7 of its size; 1e-5 leaves a factor of ten.
#[test]
fn equals_its_definition() {
    let several = UnetShape { images: 3, conditions: 2, ..UnetShape::ONE_IMAGE };
    let of = |history, width, depth, fold| UnetShape { history, width, depth, fold, ..several };
    let more = [(of(1, 8, 2, 2), [32, 32]), (of(2, 3, 1, 2), [18, 13]), (of(2, 4, 2, 1), [20, 12])];
    for (shape, size) in CASES.into_iter().chain(more) {
        let (mask, weights) = (disc(size[0], size[1]), weights(shape, size));
        assert_eq!(weights.parameters.len(), shape.parameters(), "{shape:?}");
        let raw = touched(4, &mask);
        let others = [raw.mapv(|v| 0.3 * v.abs() + 1e-7), raw.mapv(|v| -3.0 * v)];
        let others = &others[..shape.images - 1];
        let condition = |(f, k)| 0.3 + 0.1 * f as f64 - 0.5 * k as f64;
        let conditions = Array2::from_shape_fn((4, shape.conditions), condition);
        let stack = ImageStack::new(raw.clone(), mask.clone()).unwrap();
        let mut net = Denoiser::new(&weights, mask.view()).unwrap();
        let made = if shape.images == 1 {
            net.denoise(&stack).unwrap()
        } else {
            let views: Vec<_> = others.iter().map(|o| o.view()).collect();
            net.denoise_with(&stack, &views, Some(conditions.view())).unwrap()
        };
        let images: Vec<&Array3<f64>> = [&raw].into_iter().chain(others).collect();
        for last in 0..4 {
            let wanted = by_definition(&weights, &images, &conditions, &mask, last);
            let most = wanted.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            assert!(most > 0.0, "{shape:?}");
            for ((at, value), inside) in made.frame(last).unwrap().indexed_iter().zip(&mask) {
                assert_eq!(value.is_nan(), !inside);
                let off = if *inside { (value - wanted[at]).abs() / most } else { 0.0 };
                assert!(off < 1e-5, "{shape:?} frame {last} {at:?}: {value} {}", wanted[at]);
            }
        }
    }
    // Ronneberger's net has 31 million with the convolutions that double the image
    let paper = UnetShape { history: 1, width: 64, depth: 4, ..UnetShape::ONE_IMAGE };
    assert!((2.5e7..4e7).contains(&(paper.parameters() as f64)), "{}", paper.parameters());
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
    let mut push = |images: &[ArrayView2<'_, f64>], conditions: &[f64]| {
        net.push_frame_into(NetFrame { images, conditions }, out.view_mut())
    };
    let refused = push(&images, &[]).unwrap_err().to_string();
    assert_eq!(refused, "0 conditions per frame where 1 are wanted");
    assert!(push(&[ones.view(), zero.view()], &[f64::NAN]).is_err());
}

#[test]
fn frame_by_frame_and_whole_give_the_same_bits() {
    let shape = UnetShape { history: 3, width: 4, depth: 2, ..UnetShape::ONE_IMAGE };
    let mask = disc(32, 32);
    let stack = ImageStack::new(touched(7, &mask), mask.clone()).unwrap();
    let mut net = Denoiser::new(&weights(shape, [32, 32]), mask.view()).unwrap();
    let (whole, again) = (net.denoise(&stack).unwrap(), net.denoise(&stack).unwrap());
    assert_eq!(bits(whole.values()), bits(again.values()), "a sequence leaves nothing behind");
    net.reset();
    let mut single = stack.values().to_owned();
    for (image, out) in stack.iter().zip(single.axis_iter_mut(Axis(0))) {
        net.push_into(image, out).unwrap();
    }
    assert_eq!(bits(whole.values()), bits(ImageStack::new(single, mask).unwrap().values()));
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
    assert_eq!(bits(large.values()), bits(scaled.values()));
    let zero = ImageStack::new(Array3::zeros((2, 24, 24)), mask).unwrap();
    assert_eq!(net.denoise(&zero).unwrap().max_abs(), 0.0);
}

/// Zeros told at a glance and those that take the long way (an array by columns) give the same bits and
/// sequence. A net with a history looks at zeros as long as it remembers anything else.
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
    let mut found = Vec::new();
    for k in [0, 1, 9, 9, 9, 9, 2, 9, 3] {
        let image = if k == 9 { zero.view() } else { frames.index_axis(Axis(0), k) };
        let mut out = Array2::from_elem((24, 24), 5.0);
        let status = net.push_into(image, out.view_mut()).unwrap();
        let mut by_columns = Array2::zeros((24, 24).f());
        by_columns.assign(&image);
        let mut long_way = Array2::from_elem((24, 24).f(), 5.0);
        let other = other.push_into(by_columns.view(), long_way.view_mut()).unwrap();
        assert_eq!((status, bits(&out)), (other, bits(&long_way)));
        let all_zero = inside(out.view(), &mask).iter().all(|bits| *bits == 0);
        assert_eq!(status == NetStatus::Zero, all_zero, "image {k}");
        found.push(all_zero);
    }
    assert_eq!(found, [false, false, false, false, true, true, false, false, false]);
    net.reset();
    let mut out = Array2::zeros((24, 24));
    assert_eq!(net.push_into(zero.view(), out.view_mut()).unwrap(), NetStatus::Zero);
    zero[[12, 12]] = f64::NAN;
    says(net.push_into(zero.view(), out.view_mut()), "frame 1 holds NaN at row 12, column 12");
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
    let mut wanted = out.clone();
    net.clone().push_into(frame(1), wanted.view_mut()).unwrap();

    let (mut bad, small) = (frame(1).to_owned(), Array2::zeros((16, 12)));
    bad[[8, 9]] = f64::INFINITY;
    let flat = Array2::from_elem((16, 16), 2.5);
    for (image, wanted) in [
        (small, "16 rows and 12 columns"),
        (bad, "frame 1 holds inf at row 8, column 9"),
        (flat, "frame 1: the image is 2.5 everywhere on the skin"),
    ] {
        says(net.push_into(image.view(), out.view_mut()), wanted);
    }
    let other = ImageStack::new(Array3::zeros((1, 16, 16)), Array2::from_elem((16, 16), true));
    says(net.denoise(&other.unwrap()), "of another skin");

    // in a stack the flat frame stays as it is, and the net does not see it
    let mut three = frames.clone();
    three.index_axis_mut(Axis(0), 1).fill(2.5);
    three.index_axis_mut(Axis(0), 2).assign(&frame(1));
    let made = net.clone().denoise(&ImageStack::new(three, mask.clone()).unwrap()).unwrap();
    let inside = |f: usize| inside(made.frame(f).unwrap(), &mask);
    assert!(inside(1).iter().all(|bits| f64::from_bits(*bits) == 2.5));
    assert_eq!(inside(2), self::inside(wanted.view(), &mask));

    net.push_into(frame(1), out.view_mut()).unwrap();
    assert_eq!(bits(&out), bits(&wanted));
}

#[test]
fn weights_come_back_from_their_file_bit_by_bit() {
    let (one, more) = (UnetShape::ONE_IMAGE, [[1, 1, 2], [3, 1, 2]]);
    let more = more.map(|[images, conditions, fold]| UnetShape { images, conditions, fold, ..one });
    for shape in CASES.map(|(shape, _)| shape).into_iter().chain(more) {
        let mut weights = weights(shape, [64, 48]);
        weights.about.insert("seed".to_owned(), "7".to_owned());
        let mut bytes = weights.to_bytes().unwrap();
        assert_eq!(Weights::from_bytes(&bytes).unwrap(), weights);
        // the same bytes again: nothing depends on the order of a hash map
        assert_eq!(weights.to_bytes().unwrap(), bytes);
        let version = b"\"format_version\":\"3\"";
        let at = bytes.windows(version.len()).position(|part| part == version).unwrap();
        bytes[at + version.len() - 2] = b'2';
        says(Weights::from_bytes(&bytes), "version 2 of the format");
    }
}

#[test]
fn bad_weights_are_refused() {
    let shape = UnetShape { history: 1, width: 2, depth: 1, ..UnetShape::ONE_IMAGE };
    let good = weights(shape, [16, 16]);
    let bytes = good.to_bytes().unwrap();
    // a cut at any place, and foreign files
    for end in 0..bytes.len() {
        refused!(Weights::from_bytes(&bytes[..end]), Format { .. });
    }
    for foreign in [&b"PK\x03\x04 not weights at all"[..], &[0; 64], &[255; 64]] {
        refused!(Weights::from_bytes(foreign), Format { .. });
    }
    let count = good.parameters.len();
    type Change = fn(&mut Weights);
    let changes: [(&str, Change); 4] = [
        ("weight 4 is NaN", |bad| bad.parameters[4] = f32::NAN),
        (&format!("{} weights where {count} are wanted", count - 1), |bad| {
            bad.parameters.pop();
        }),
        ("depth is 9: it must be 1 to 6", |bad| bad.shape.depth = 9),
        ("\"width\" belongs to the format", |bad| {
            bad.about.insert("width".to_owned(), "3".to_owned());
        }),
    ];
    for (wanted, change) in changes {
        let mut bad = good.clone();
        change(&mut bad);
        says(bad.to_bytes(), wanted);
    }
    assert!(good.check_skin("test", [16, 16]).is_ok());
    let wanted = "for skin test at 16 x 16 pixels, these images are of skin arm";
    says(good.check_skin("arm", [16, 16]), wanted);
    assert!(good.check_skin("test", [32, 16]).is_err());
    assert!(Denoiser::new(&good, Array2::from_elem((8, 8), false).view()).is_err());
}

#[test]
fn the_shipped_weights_are_whole_and_small() {
    let weights = Weights::paper_disc().unwrap();
    assert_eq!(weights.pixels, [64, 64]);
    assert!(4 * weights.parameters.len() < 2_000_000, "{}", weights.parameters.len());
    assert!(weights.about["recipe"].starts_with("st-tv"), "{:?}", weights.about);
}
