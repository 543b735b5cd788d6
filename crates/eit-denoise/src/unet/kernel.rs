//! Convolutions on planes of padded rows. Everything here is `inline(always)`, so that `pulp`'s dispatch
//! (see `net`) compiles it for the widest registers of the machine. One file because all operations of
//! the net share one layout:
//!
//! A plane has a border of zeros: `rows + 2` rows of `stride = lanes(columns) + 2` values, pixel
//! `(r, c)` at `(r + 1) * stride + c + 1`. Lanes behind the last column are zero too, so that kernels
//! need no tests at the boundary.
//!
//! Four outputs of 16 pixels take 8 of the 16 registers of 256 bits: enough independent sums to hide the
//! latency of an addition, and each loaded weight and pixel is used several times.
//!
//! Distance from the floor: a net of width 6 and depth 3 takes 23.7 million multiply-adds for 64 x
//! 64 pixels, 26 million with the idle outputs of groups; two instructions of eight a cycle would be
//! 1.6 million cycles. Counted on an AMD EPYC: 2.3 million for a whole frame, scaling included (4.3
//! before row lengths were constants: tests of lengths between the taps were half of all
//! instructions). Six outputs to a group leave none idle in this net, and took 5.2 million: 12 sums
//! and what feeds them do not fit the registers that the compiler leaves.

/// Smallest number of pixels processed together; rows are padded to a multiple of it.
const LANES: usize = 8;
/// Outputs of a group.
pub(super) const GROUP: usize = 4;

/// Size of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plane {
    pub rows: usize,
    pub columns: usize,
}

impl Plane {
    /// Columns including the lanes behind them.
    fn width(self) -> usize {
        self.columns.next_multiple_of(LANES)
    }

    /// Distance between rows.
    pub fn stride(self) -> usize {
        self.width() + 2
    }

    /// Number of values of a plane.
    pub fn len(self) -> usize {
        (self.rows + 2) * self.stride()
    }

    /// Offset of a row's first pixel.
    pub fn row(self, row: usize) -> usize {
        (row + 1) * self.stride() + 1
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
    pub fn new(weights: &[f32], biases: &[f32], inputs: usize) -> Self {
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
    pub fn run(&self, plane: Plane, input: &[f32], output: &mut [f32]) {
        let groups = self.weights.chunks_exact(self.inputs).zip(&self.biases);
        let outputs = output[..self.outputs * plane.len()].chunks_mut(GROUP * plane.len());
        for ((weights, biases), output) in groups.zip(outputs) {
            for row in 0..plane.rows {
                let mut column = 0;
                while column < plane.width() {
                    let at = [row, column];
                    if plane.width() - column >= 2 * LANES {
                        tile::<{ 2 * LANES }, { 2 * LANES + 2 }>(
                            weights, biases, plane, at, input, output,
                        );
                        column += 2 * LANES;
                    } else {
                        tile::<LANES, { LANES + 2 }>(weights, biases, plane, at, input, output);
                        column += LANES;
                    }
                }
            }
        }
    }
}

/// `L` pixels of a row of a group's outputs; `WIDE` is `L` with a pixel on either side.
#[inline(always)]
fn tile<const L: usize, const WIDE: usize>(
    weights: &[[[f32; GROUP]; 9]],
    biases: &[f32; GROUP],
    plane: Plane,
    [row, column]: [usize; 2],
    input: &[f32],
    output: &mut [f32],
) {
    let stride = plane.stride();
    let mut sums = [[0.0; L]; GROUP];
    for (sum, bias) in sums.iter_mut().zip(biases) {
        *sum = [*bias; L];
    }
    // the corner of the 3 x 3 neighbourhood of the first pixel
    let corner = row * stride + column;
    for (weights, plane) in weights.iter().zip(input.chunks_exact(plane.len())) {
        for y in 0..3 {
            // of a length that the compiler knows: the taps are unrolled and test nothing
            let Some(row) = plane[corner + y * stride..].first_chunk::<WIDE>() else { continue };
            for x in 0..3 {
                let Some(pixels) = row[x..].first_chunk::<L>() else { continue };
                for o in 0..GROUP {
                    sums[o] = add_row(weights[3 * y + x][o], pixels, sums[o]);
                }
            }
        }
    }
    let kept = plane.columns.saturating_sub(column).min(L);
    let at = plane.row(row) + column;
    for (sum, output) in sums.iter().zip(output.chunks_exact_mut(plane.len())) {
        let out = &mut output[at..at + L];
        for (out, sum) in out.iter_mut().zip(sum) {
            *out = if *sum <= 0.0 { 0.0 } else { *sum };
        }
        out[kept..].fill(0.0);
    }
}

/// `sum + factor * row`. By value, so that the compiler need not prove that nothing overlaps.
#[inline(always)]
fn add_row<const L: usize>(factor: f32, row: &[f32; L], sum: [f32; L]) -> [f32; L] {
    let mut out = [0.0; L];
    for l in 0..L {
        out[l] = factor.mul_add(row[l], sum[l]);
    }
    out
}

/// The largest of each 2 x 2 pixels; `from` has twice the rows and columns.
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

/// Every pixel as 2 x 2; `to` has twice the rows and columns.
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
