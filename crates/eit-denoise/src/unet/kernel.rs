//! Convolutions on planes of padded rows. Everything here is `inline(always)`, so that it is
//! compiled for the widest registers of the machine inside `pulp`'s dispatch (see `net`). Long
//! because all operations of the net share one layout:
//!
//! A plane has a border of zeros: `rows + 2` rows of `stride = lanes(columns) + 2` values, pixel
//! `(r, c)` at `(r + 1) * stride + c + 1`. Lanes behind the last column are zero too, so that no
//! kernel asks where an image ends.
//!
//! Four outputs of 16 pixels are 8 of the 16 registers of 256 bits: enough sums to hide the latency
//! of an addition, and each weight and each pixel that is loaded serves several.
//!
//! Distance from the floor: a net of width 6 and depth 3 takes 23.7 million multiply-adds for 64 x
//! 64 pixels, 26 million with the idle outputs of groups; two instructions of eight a cycle would be
//! 1.6 million cycles. Counted on an AMD EPYC: 2.3 million for a whole frame, scaling included (4.3
//! before row lengths were constants: tests of lengths between the taps were half of all
//! instructions). Six outputs to a group leave none idle in this net, and took 5.2 million: 12 sums
//! and what feeds them do not fit the registers that the compiler leaves.

/// Pixels that are handled together at least; rows are padded to a multiple of it.
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
    /// Columns with the lanes behind them.
    fn width(self) -> usize {
        self.columns.next_multiple_of(LANES)
    }

    /// From row to row.
    pub fn stride(self) -> usize {
        self.width() + 2
    }

    /// Values of a plane.
    pub fn len(self) -> usize {
        (self.rows + 2) * self.stride()
    }

    /// Where a row's first pixel stands.
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

    /// The adjoint of [`Packed::new`] with these weights, and no bias: run with `POSITIVE` false, it
    /// takes derivatives of outputs to derivatives of inputs.
    #[cfg(feature = "train")]
    pub fn adjoint(weights: &[f32], inputs: usize, outputs: usize) -> Self {
        let turned = |k: usize| {
            let (i, o, tap) = (k / (outputs * 9), k / 9 % outputs, k % 9);
            weights[(o * inputs + i) * 9 + 8 - tap]
        };
        let turned: Vec<f32> = (0..weights.len()).map(turned).collect();
        Self::new(&turned, &vec![0.0; inputs], outputs)
    }

    /// `output = weights * input + bias`, and its positive part with `POSITIVE`, for planes of one
    /// size; the first inputs and outputs of longer lists.
    #[inline(always)]
    pub fn run<const POSITIVE: bool>(&self, plane: Plane, input: &[f32], output: &mut [f32]) {
        let groups = self.weights.chunks_exact(self.inputs).zip(&self.biases);
        let outputs = output[..self.outputs * plane.len()].chunks_mut(GROUP * plane.len());
        for ((weights, biases), output) in groups.zip(outputs) {
            for row in 0..plane.rows {
                let mut column = 0;
                while column < plane.width() {
                    let at = [row, column];
                    if plane.width() - column >= 2 * LANES {
                        tile::<{ 2 * LANES }, { 2 * LANES + 2 }, POSITIVE>(
                            weights, biases, plane, at, input, output,
                        );
                        column += 2 * LANES;
                    } else {
                        tile::<LANES, { LANES + 2 }, POSITIVE>(
                            weights, biases, plane, at, input, output,
                        );
                        column += LANES;
                    }
                }
            }
        }
    }
}

/// `L` pixels of a row of a group's outputs; `WIDE` is `L` with a pixel on either side.
#[inline(always)]
fn tile<const L: usize, const WIDE: usize, const POSITIVE: bool>(
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
            *out = if POSITIVE && *sum <= 0.0 { 0.0 } else { *sum };
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

/// Adds to `gradient` [output, input, tap] the derivative of `sum(derivative * convolution)` by the
/// weights, and to `biases` that by the biases. All planes have zeros in border and lanes.
#[cfg(feature = "train")]
#[inline(always)]
pub(super) fn add_weight_gradient(
    plane: Plane,
    input: &[f32],
    derivative: &[f32],
    gradient: &mut [f32],
    biases: &mut [f32],
) {
    let len = plane.len();
    let inputs = input.len() / len;
    for (derivative, bias) in derivative.chunks_exact(len).zip(biases.iter_mut()) {
        *bias += derivative.iter().sum::<f32>();
    }
    let groups = derivative.chunks(GROUP * len).zip(gradient.chunks_mut(GROUP * inputs * 9));
    for (derivative, gradient) in groups {
        for (i, input) in input.chunks_exact(len).enumerate() {
            let at = |o: usize| (o * inputs + i) * 9;
            // a fixed number of outputs, so that the sums stay in registers
            match derivative.len() / len {
                4 => add_correlation::<4>(plane, input, derivative, gradient, at),
                3 => add_correlation::<3>(plane, input, derivative, gradient, at),
                2 => add_correlation::<2>(plane, input, derivative, gradient, at),
                _ => add_correlation::<1>(plane, input, derivative, gradient, at),
            }
        }
    }
}

/// One input and `O` outputs of [`add_weight_gradient`]; `at` says where an output's taps stand.
#[cfg(feature = "train")]
#[inline(always)]
fn add_correlation<const O: usize>(
    plane: Plane,
    input: &[f32],
    derivative: &[f32],
    gradient: &mut [f32],
    at: impl Fn(usize) -> usize,
) {
    let (len, stride) = (plane.len(), plane.stride());
    for y in 0..3 {
        let mut sums = [[[0.0; LANES]; 3]; O];
        for row in 0..plane.rows {
            let from = &input[(row + y) * stride..][..stride];
            let own = plane.row(row);
            for column in (0..plane.width()).step_by(LANES) {
                let pixels: [[f32; LANES]; 3] = std::array::from_fn(|x| {
                    from[column + x..].first_chunk::<LANES>().copied().unwrap_or_default()
                });
                for (o, sums) in sums.iter_mut().enumerate() {
                    let d = &derivative[o * len + own + column..];
                    let Some(d) = d.first_chunk::<LANES>() else { continue };
                    for x in 0..3 {
                        for l in 0..LANES {
                            sums[x][l] = d[l].mul_add(pixels[x][l], sums[x][l]);
                        }
                    }
                }
            }
        }
        for (o, sums) in sums.iter().enumerate() {
            for (x, sum) in sums.iter().enumerate() {
                gradient[at(o) + 3 * y + x] += sum.iter().sum::<f32>();
            }
        }
    }
}

/// Takes out what the positive part of `value` did not let through.
#[cfg(feature = "train")]
#[inline(always)]
pub(super) fn mask_derivative(value: &[f32], derivative: &mut [f32]) {
    for (derivative, value) in derivative.iter_mut().zip(value) {
        *derivative = if *value > 0.0 { *derivative } else { 0.0 };
    }
}

/// Adds the derivative of [`halve`]: to the first of the largest.
#[cfg(feature = "train")]
#[inline(always)]
pub(super) fn add_halve_derivative(
    from: Plane,
    input: &[f32],
    to: Plane,
    derivative: &[f32],
    into: &mut [f32],
) {
    let planes = input.chunks_exact(from.len()).zip(derivative.chunks_exact(to.len()));
    for ((input, derivative), into) in planes.zip(into.chunks_exact_mut(from.len())) {
        for row in 0..to.rows {
            for column in 0..to.columns {
                let at = from.row(2 * row) + 2 * column;
                let four = [at, at + 1, at + from.stride(), at + from.stride() + 1];
                let mut best = four[0];
                for place in four {
                    best = if input[place] > input[best] { place } else { best };
                }
                into[best] += derivative[to.row(row) + column];
            }
        }
    }
}

/// The derivative of [`double`]: sums of 2 x 2.
#[cfg(feature = "train")]
#[inline(always)]
pub(super) fn double_derivative(from: Plane, to: Plane, derivative: &[f32], into: &mut [f32]) {
    let planes = derivative.chunks_exact(to.len());
    for (derivative, into) in planes.zip(into.chunks_exact_mut(from.len())) {
        for row in 0..from.rows {
            for column in 0..from.columns {
                let at = to.row(2 * row) + 2 * column;
                let four = [at, at + 1, at + to.stride(), at + to.stride() + 1];
                into[from.row(row) + column] = four.iter().map(|p| derivative[*p]).sum();
            }
        }
    }
}
