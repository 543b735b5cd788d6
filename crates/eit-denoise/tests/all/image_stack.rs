//! What a stack accepts, refuses, and gives back.

use eit_denoise::{DenoiseError, ImageStack};
use ndarray::{Array2, Array3, array};
use proptest::prelude::*;

#[test]
fn refusals_name_sizes_and_places() {
    let ones = |frames| Array3::<f64>::ones((frames, 3, 2));
    let mask = |rows, columns, value| Array2::from_elem((rows, columns), value);
    let holding = |value| {
        let mut images = ones(4);
        images[[2, 1, 0]] = value;
        images
    };
    let other =
        "the images have 3 rows and 2 columns, but the mask has 2 and 3: draw both on one raster";
    let [small, none] = ["3 rows and 2", "0 rows and 0"].map(|size| {
        format!("the mask of {size} columns has no pixel inside the skin: use more pixels")
    });
    for (images, mask, wanted) in [
        (ones(4), mask(2, 3, true), other),
        (ones(4), mask(3, 2, false), &small),
        (Array3::ones((0, 0, 0)), mask(0, 0, true), &none),
        (holding(f64::NAN), mask(3, 2, true), NAN),
        (holding(f64::NEG_INFINITY), mask(3, 2, true), &NAN.replace("NaN", "-inf")),
    ] {
        assert_eq!(ImageStack::new(images, mask).unwrap_err().to_string(), wanted);
    }
    let stack = ImageStack::new(ones(4), mask(3, 2, true)).unwrap();
    let error = stack.frame(4).unwrap_err();
    assert_eq!(error, DenoiseError::UnknownFrame { frame: 4, frames: 4 });
    assert_eq!(error.to_string(), "frame 4 does not exist: the stack has 4 frames, counted from 0");
    // a stack without frames is a stack
    let stack = ImageStack::new(Array3::zeros((0, 1, 2)), array![[true, false]]).unwrap();
    assert_eq!((stack.frames(), stack.rows(), stack.columns()), (0, 1, 2));
    assert_eq!((stack.max_abs(), stack.iter().len()), (0.0, 0));
    fn shared<T: Send + Sync>(_: &T) {}
    shared(&stack);
    shared(&error);
}

const NAN: &str = "frame 2 holds NaN at row 1, column 0, inside the skin: leave the frame out or \
                   mend the reconstruction";

/// Images of any size with any mask; NaN and infinities among the values.
fn parts() -> impl Strategy<Value = (Array3<f64>, Array2<bool>)> {
    (0..4usize, 1..6usize, 1..6usize).prop_flat_map(|(frames, rows, columns)| {
        let value = prop_oneof![30 => -1e3..1e3, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)];
        let values = proptest::collection::vec(value, frames * rows * columns);
        let mask = proptest::collection::vec(any::<bool>(), rows * columns);
        (values, mask).prop_map(move |(values, mask)| {
            let values = Array3::from_shape_vec((frames, rows, columns), values).unwrap();
            (values, Array2::from_shape_vec((rows, columns), mask).unwrap())
        })
    })
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn inside_is_kept_and_outside_is_nan((values, mask) in parts()) {
        let bad = values
            .indexed_iter()
            .find(|((_, r, c), v)| mask[[*r, *c]] && !v.is_finite())
            .map(|(place, _)| place);
        let stack = match ImageStack::new(values.clone(), mask.clone()) {
            Ok(stack) => stack,
            Err(DenoiseError::EmptyMask { .. }) => {
                prop_assert!(!mask.iter().any(|m| *m));
                return Ok(());
            }
            Err(DenoiseError::NonFinitePixel { frame, row, column, .. }) => {
                prop_assert_eq!(Some((frame, row, column)), bad);
                return Ok(());
            }
            Err(error) => return Err(TestCaseError::fail(error.to_string())),
        };
        prop_assert_eq!(bad, None);
        let mut largest = 0.0_f64;
        for (frame, image) in stack.iter().enumerate() {
            for ((row, column), &value) in image.indexed_iter() {
                prop_assert_eq!(value.is_nan(), !mask[[row, column]]);
                if mask[[row, column]] {
                    prop_assert_eq!(value, values[[frame, row, column]]);
                    prop_assert_eq!(value, stack.frame(frame).unwrap()[[row, column]]);
                    largest = largest.max(value.abs());
                }
            }
        }
        prop_assert_eq!(stack.max_abs(), largest);
        prop_assert_eq!(stack.iter().len(), stack.frames());
        prop_assert_eq!(stack.values().dim(), values.dim());
        prop_assert_eq!(stack.mask(), mask.view());
        let (values, kept) = stack.into_parts();
        prop_assert_eq!(&kept, &mask);
        // its own parts make a stack again
        prop_assert!(ImageStack::new(values, kept).is_ok());
    }
}
