//! Convolutions on planes of padded rows, with `pulp`'s registers of any width. Everything here is
//! `inline(always)`, so that its dispatch (see `net`) compiles it for the machine. One file because all
//! operations of the net share one layout:
//!
//! A plane has a border of zeros, one value between two rows: pixel `(r, c)` at
//! `(r + 1) * stride + c + 1` with `stride = columns + 1`. So the neighbour in a direction is at the same
//! distance for every pixel, and a convolution runs over all rows as one line, whatever their length; what
//! it leaves on the border is set to zero afterwards.
//!
//! Four outputs of 4 registers of pixels take 16 of the 32 registers of 512 bits, of 2 registers 8 of the
//! 16 of 256 bits: enough independent sums to hide the latency of an addition, and each loaded weight and
//! pixel is used several times.
//!
//! Distance from the floor: the shipped net of touches has 25.5 million multiply-adds for 64 x 64 pixels. On one
//! core of a Xeon with 512 bits, whose products of f32 matrices reach 77 billion a second (OpenBLAS; 0.33 ms), an
//! image takes 0.50 ms, scaling included. It took 1.01 ms with rows padded to 8 values and tiles of one row
//! and 16 pixels, whose 4 sums of 512 bits wait for each other. With 256 bits 0.93 instead of 1.09 ms.

use pulp::Simd;

/// Most numbers in a register of any machine.
const MOST_LANES: usize = 16;
/// Outputs of a group.
pub(super) const GROUP: usize = 4;

/// Size of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plane {
    pub rows: usize,
    pub columns: usize,
}

impl Plane {
    /// Distance between rows.
    pub(super) fn stride(self) -> usize {
        self.columns + 1
    }

    /// Number of values of a plane.
    pub(super) fn len(self) -> usize {
        (self.rows + 2) * self.stride() + 1 + MOST_LANES
    }

    /// Offset of a row's first pixel.
    pub(super) fn row(self, row: usize) -> usize {
        (row + 1) * self.stride() + 1
    }

    /// Values from the first pixel to the last, with the border between rows.
    fn inner(self) -> usize {
        self.rows * self.stride() - 1
    }
}

/// A 3 x 3 convolution ready to run.
#[derive(Debug, Clone)]
pub(super) struct Packed {
    /// [group][input][tap], each the weights of the group's outputs, zero beyond the last.
    weights: Vec<[[f32; GROUP]; 9]>,
    /// [group].
    biases: Vec<[f32; GROUP]>,
    inputs: usize,
    outputs: usize,
}

impl Packed {
    /// From weights [output, input, row, column] and biases [output].
    pub(super) fn new(weights: &[f32], biases: &[f32], inputs: usize) -> Self {
        let outputs = biases.len();
        let groups = outputs.div_ceil(GROUP);
        let of = |o: usize, i: usize, tap: usize| match o < outputs {
            true => weights[(o * inputs + i) * 9 + tap],
            false => 0.0,
        };
        let packed = |k: usize| {
            let (group, i) = (k / inputs, k % inputs);
            std::array::from_fn(|tap| std::array::from_fn(|o| of(group * GROUP + o, i, tap)))
        };
        let bias = |o: usize| biases.get(o).copied().unwrap_or(0.0);
        Self {
            weights: (0..groups * inputs).map(packed).collect(),
            biases: (0..groups).map(|g| std::array::from_fn(|o| bias(g * GROUP + o))).collect(),
            inputs,
            outputs,
        }
    }

    /// `output`: the positive part of `weights * input + bias`, for planes of one size; the first inputs
    /// and outputs of longer lists.
    #[inline(always)]
    pub(super) fn run<S: Simd>(&self, simd: S, plane: Plane, input: &[f32], output: &mut [f32]) {
        let (mut at, inner) = (0, plane.inner());
        // less than a register beyond the last pixel; four registers of each output where there are 32
        while at < inner {
            at += match inner - at {
                left if left > 3 * S::F32_LANES && S::F32_LANES != 8 => {
                    self.pixels::<S, 4>(simd, plane, at, input, output)
                }
                left if left > S::F32_LANES => self.pixels::<S, 2>(simd, plane, at, input, output),
                _ => self.pixels::<S, 1>(simd, plane, at, input, output),
            }
        }
        let used = self.outputs * plane.len();
        for plane_of in output[..used].chunks_exact_mut(plane.len()) {
            for row in 1..plane.rows {
                plane_of[plane.row(row) - 1] = 0.0;
            }
            plane_of[plane.row(0) + inner..].fill(0.0);
        }
    }

    /// Computes all outputs for `V` registers of pixels from the inner value `at` on; returns their
    /// number. All groups use the same pixels in turn, so that these stay in the first-level cache.
    #[inline(always)]
    fn pixels<S: Simd, const V: usize>(
        &self,
        simd: S,
        plane: Plane,
        at: usize,
        input: &[f32],
        output: &mut [f32],
    ) -> usize {
        let groups = self.weights.chunks_exact(self.inputs).zip(&self.biases);
        let outputs = output[..self.outputs * plane.len()].chunks_mut(GROUP * plane.len());
        for ((weights, biases), output) in groups.zip(outputs) {
            tile::<S, V>(simd, weights, biases, plane, at, input, output);
        }
        V * S::F32_LANES
    }
}

/// Computes `V` registers of pixels of a group's outputs.
#[inline(always)]
fn tile<S: Simd, const V: usize>(
    simd: S,
    weights: &[[[f32; GROUP]; 9]],
    biases: &[f32; GROUP],
    plane: Plane,
    at: usize,
    input: &[f32],
    output: &mut [f32],
) {
    let width = V * S::F32_LANES;
    let mut sums = biases.map(|bias| [simd.splat_f32s(bias); V]);
    for (weights, values) in weights.iter().zip(input.chunks_exact(plane.len())) {
        for y in 0..3 {
            // the neighbours' first pixel
            let row = &values[at + y * plane.stride()..];
            for x in 0..3 {
                let pixels = S::as_simd_f32s(&row[x..][..width]).0;
                for o in 0..GROUP {
                    let weight = simd.splat_f32s(weights[3 * y + x][o]);
                    for v in 0..V {
                        sums[o][v] = simd.mul_add_f32s(weight, pixels[v], sums[o][v]);
                    }
                }
            }
        }
    }
    let zero = simd.splat_f32s(0.0);
    for (sums, output) in sums.iter().zip(output.chunks_exact_mut(plane.len())) {
        let out = S::as_mut_simd_f32s(&mut output[plane.row(0) + at..][..width]).0;
        for v in 0..V {
            let negative = simd.less_than_or_equal_f32s(sums[v], zero);
            out[v] = simd.select_f32s(negative, zero, sums[v]);
        }
    }
}

/// Writes the largest of each 2 x 2 pixels; `from` has twice the rows and columns.
#[inline(always)]
pub(super) fn halve(from: Plane, input: &[f32], to: Plane, output: &mut [f32]) {
    for (input, output) in input.chunks_exact(from.len()).zip(output.chunks_exact_mut(to.len())) {
        for row in 0..to.rows {
            let top = &input[from.row(2 * row)..][..from.columns];
            let bottom = &input[from.row(2 * row + 1)..][..from.columns];
            let out = &mut output[to.row(row)..][..to.columns];
            let pairs = top.chunks_exact(2).zip(bottom.chunks_exact(2));
            for (out, (top, bottom)) in out.iter_mut().zip(pairs) {
                *out = top[0].max(top[1]).max(bottom[0].max(bottom[1]));
            }
        }
    }
}

/// Repeats every pixel 2 x 2; `to` has twice the rows and columns.
#[inline(always)]
pub(super) fn double(from: Plane, input: &[f32], to: Plane, output: &mut [f32]) {
    for (input, output) in input.chunks_exact(from.len()).zip(output.chunks_exact_mut(to.len())) {
        for row in 0..to.rows {
            let pixels = &input[from.row(row / 2)..][..from.columns];
            let out = &mut output[to.row(row)..][..to.columns];
            for (out, pixel) in out.chunks_exact_mut(2).zip(pixels) {
                out.fill(*pixel);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Scalar, WithSimd};

    struct Once<'a> {
        packed: &'a Packed,
        plane: Plane,
        input: &'a [f32],
        output: &'a mut [f32],
    }

    impl WithSimd for Once<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            self.packed.run(simd, self.plane, self.input, self.output);
        }
    }

    /// Registers of every width on this machine give the bits of sums pixel by pixel; borders stay
    /// zero.
    #[test]
    fn registers_of_any_width_give_the_definition() {
        let (inputs, outputs) = (3, 5);
        let value = |k: usize| (0.37 * (k * k) as f32).sin();
        let weights: Vec<f32> = (0..outputs * inputs * 9).map(value).collect();
        let biases: Vec<f32> = (0..outputs).map(|o| 0.3 * value(o + 7)).collect();
        let packed = Packed::new(&weights, &biases, inputs);
        // less than a register, whole ones, one to four of 4, 8 and 16 values and more, with and without a rest
        for [rows, columns] in
            [[1, 1], [1, 2], [2, 7], [3, 5], [4, 4], [5, 9], [8, 8], [7, 13], [11, 17], [16, 33]]
        {
            let plane = Plane { rows, columns };
            let mut input = vec![0.0; inputs * plane.len()];
            for i in 0..inputs {
                for row in 0..rows {
                    for c in 0..columns {
                        input[i * plane.len() + plane.row(row) + c] = value(i + 5 * row + 3 * c);
                    }
                }
            }
            let mut wanted = vec![0.0; outputs * plane.len()];
            for o in 0..outputs {
                for row in 0..rows {
                    for c in 0..columns {
                        let mut sum = biases[o];
                        for k in 0..inputs * 9 {
                            let (i, y, x) = (k / 9, k % 9 / 3, k % 3);
                            let at = plane.row(row) + c + y * plane.stride() + x;
                            let pixel = input[i * plane.len() + at - plane.stride() - 1];
                            sum = weights[(o * inputs + i) * 9 + 3 * y + x].mul_add(pixel, sum);
                        }
                        wanted[o * plane.len() + plane.row(row) + c] = sum.max(0.0);
                    }
                }
            }
            let check = |run: &dyn Fn(Once<'_>)| {
                let mut output = vec![9.0; wanted.len()];
                // the first border row and column are never written: zero since they were allocated
                output.chunks_exact_mut(plane.len()).for_each(|o| o[..plane.row(0)].fill(0.0));
                run(Once { packed: &packed, plane, input: &input, output: &mut output });
                assert_eq!(output, wanted, "{rows} x {columns}");
            };
            check(&|once| once.with_simd(Scalar::new()));
            check(&|once| pulp::Arch::new().dispatch(once));
            #[cfg(target_arch = "x86_64")]
            if let Some(simd) = pulp::x86::V3::try_new() {
                check(&|once| Simd::vectorize(simd, once));
            }
        }
    }
}
