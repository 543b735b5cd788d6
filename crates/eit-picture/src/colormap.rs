//! Two colour maps: diverging for signed changes, sequential for magnitudes.
//!
//! The lightness is monotone (sequential) or decreases equally to both sides (diverging), and
//! neither map requires distinguishing red from green.

use crate::canvas::Rgb;

/// The colours that represent values.
///
/// ```
/// use eit_picture::ColorMap;
///
/// let [red, green, blue] = ColorMap::CoolWarm.color(0.5);
/// assert!(red.abs_diff(blue) < 3 && green > 200, "light grey in the middle");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorMap {
    /// Blue, light grey at zero, red: Moreland's cool-warm map. The range is made symmetric.
    #[default]
    CoolWarm,
    /// Dark violet to yellow: viridis.
    Viridis,
}

impl ColorMap {
    /// Returns the colour at `position`, from 0 (lower end) to 1 (upper end); other positions are
    /// clamped.
    pub fn color(self, position: f64) -> Rgb {
        let position = position.clamp(0.0, 1.0);
        match self {
            Self::CoolWarm => cool_warm(position),
            Self::Viridis => viridis(position),
        }
    }
}

/// Viridis at 33 equidistant positions, 0xRRGGBB, from matplotlib 3's `_cm_listed.py` (N. Smith, S.
/// van der Walt, E. Firing; CC0). Linear interpolation is within 1.8/255 of the full table.
const VIRIDIS: [u32; 33] = [
    0x440154, 0x470d60, 0x48186a, 0x482374, 0x472d7b, 0x453681, 0x424086, 0x3f4989, 0x3b528b,
    0x375a8d, 0x33638d, 0x2f6a8e, 0x2c728e, 0x297a8e, 0x26818e, 0x23898e, 0x21908c, 0x1f988b,
    0x1f9f88, 0x21a685, 0x28ae80, 0x31b57b, 0x3ebc74, 0x4cc26c, 0x5dc963, 0x6ece58, 0x82d34c,
    0x96d83f, 0xabdc32, 0xc0df24, 0xd5e21a, 0xeae51a, 0xfde725,
];

fn viridis(position: f64) -> Rgb {
    let at = position * (VIRIDIS.len() - 1) as f64;
    let below = (at as usize).min(VIRIDIS.len() - 2);
    let [from, to] = [VIRIDIS[below], VIRIDIS[below + 1]].map(u32::to_be_bytes);
    std::array::from_fn(|c| {
        let (from, to) = (f64::from(from[c + 1]), f64::from(to[c + 1]));
        (from + (at - below as f64) * (to - from)).round() as u8
    })
}

/// Ends of cool-warm in sRGB: blue, red.
const COOL_WARM_ENDS: [[f64; 3]; 2] = [[59.0, 76.0, 192.0], [180.0, 4.0, 38.0]];
/// Minimum magnitude of the neutral colour between saturated ends, in Msh space.
const NEUTRAL_MAGNITUDE: f64 = 88.0;

/// K. Moreland, "Diverging Color Maps for Scientific Visualization", ISVC 2009, LNCS 5876, 92-103,
/// doi:10.1007/978-3-642-10520-3_9: straight lines in Msh, the polar form of CIELAB, from either
/// end to an unsaturated middle. The ends are saturated and far apart in hue, so only that branch
/// of the paper's algorithm is needed.
fn cool_warm(position: f64) -> Rgb {
    let ends = COOL_WARM_ENDS.map(|rgb| msh_from_lab(lab_from_srgb(rgb)));
    let middle = ends[0][0].max(ends[1][0]).max(NEUTRAL_MAGNITUDE);
    let (end, toward_end) = if position < 0.5 {
        (ends[0], 1.0 - 2.0 * position)
    } else {
        (ends[1], 2.0 * position - 1.0)
    };
    let from = [middle, 0.0, adjusted_hue(end, middle)];
    let msh: [f64; 3] = std::array::from_fn(|i| from[i] + toward_end * (end[i] - from[i]));
    srgb_from_lab(lab_from_msh(msh))
}

/// Hue of the unsaturated colour of magnitude `middle` that makes the change towards `end` uniform:
/// it is rotated so that the path in CIELAB is as straight as at the saturated end.
fn adjusted_hue([magnitude, saturation, hue]: [f64; 3], middle: f64) -> f64 {
    if magnitude >= middle {
        return hue;
    }
    let spin =
        saturation * (middle.powi(2) - magnitude.powi(2)).sqrt() / (magnitude * saturation.sin());
    if hue > -std::f64::consts::FRAC_PI_3 { hue + spin } else { hue - spin }
}

fn msh_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let magnitude = (l * l + a * a + b * b).sqrt();
    [magnitude, (l / magnitude).acos(), b.atan2(a)]
}

fn lab_from_msh([magnitude, saturation, hue]: [f64; 3]) -> [f64; 3] {
    let chroma = magnitude * saturation.sin();
    [magnitude * saturation.cos(), chroma * hue.cos(), chroma * hue.sin()]
}

/// White point D65 (2 degree observer), Y = 1.
const D65: [f64; 3] = [0.9505, 1.0, 1.089];

/// CIE 1976 L*a*b* of sRGB values from 0 to 255 (IEC 61966-2-1).
fn lab_from_srgb(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|c| {
        let c = c / 255.0;
        if c > 0.04045 { ((c + 0.055) / 1.055).powf(2.4) } else { c / 12.92 }
    });
    let f = |t: f64| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let x = f((0.4124 * r + 0.3576 * g + 0.1805 * b) / D65[0]);
    let y = f((0.2126 * r + 0.7152 * g + 0.0722 * b) / D65[1]);
    let z = f((0.0193 * r + 0.1192 * g + 0.9505 * b) / D65[2]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Inverse of [`lab_from_srgb`], rounded; colours out of gamut are clamped.
fn srgb_from_lab([l, a, b]: [f64; 3]) -> Rgb {
    let fy = (l + 16.0) / 116.0;
    let f = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { (t - 16.0 / 116.0) / 7.787 };
    let (x, y, z) = (D65[0] * f(fy + a / 500.0), D65[1] * f(fy), D65[2] * f(fy - b / 200.0));
    [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ]
    .map(|c| {
        let c = if c > 0.0031308 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c };
        (255.0 * c).round().clamp(0.0, 255.0) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lightness(map: ColorMap, position: f64) -> f64 {
        lab_from_srgb(map.color(position).map(f64::from))[0]
    }

    #[test]
    fn cool_warm_is_the_published_table() {
        // every fourth row of the paper's 33-row table, CoolWarmFloat33
        let published: [Rgb; 9] = [
            [59, 76, 192],
            [98, 130, 234],
            [141, 176, 254],
            [184, 208, 249],
            [221, 221, 221],
            [245, 196, 173],
            [244, 154, 123],
            [222, 96, 77],
            [180, 4, 38],
        ];
        for (row, expected) in published.iter().enumerate() {
            let color = ColorMap::CoolWarm.color(row as f64 / 8.0);
            // within one unit: the paper's sRGB matrix differs in the last digits
            let close = color.iter().zip(expected).all(|(a, b)| a.abs_diff(*b) <= 1);
            assert!(close, "{row}: {color:?}, published {expected:?}");
        }
    }

    #[test]
    fn cool_warm_is_even_about_its_neutral_middle() {
        let [r, g, b] = ColorMap::CoolWarm.color(0.5);
        assert!(r == g && g == b);
        for i in 0..100 {
            let away = f64::from(i) / 200.0;
            let sides = [-1.0, 1.0].map(|s| lightness(ColorMap::CoolWarm, 0.5 + s * away));
            // rounding to 8-bit channels changes the lightness by up to 0.4; the ends differ by 0.5
            assert!((sides[0] - sides[1]).abs() < 1.5, "{away}: {sides:?}");
            let further = lightness(ColorMap::CoolWarm, 0.5 + away + 0.005);
            assert!(further < sides[1] + 0.2, "{away}");
        }
    }

    #[test]
    fn viridis_brightens_throughout() {
        let steps: Vec<f64> =
            (0..=256).map(|i| lightness(ColorMap::Viridis, f64::from(i) / 256.0)).collect();
        // 8-bit rounding may lose 0.2 in one step; over eight steps the lightness must increase
        assert!(steps.windows(9).all(|w| w[8] > w[0] + 1.0));
        assert!(steps[0] < 15.0 && steps[256] > 90.0);
    }

    #[test]
    fn positions_beyond_the_ends_are_clamped() {
        for map in [ColorMap::CoolWarm, ColorMap::Viridis] {
            assert_eq!(map.color(-3.0), map.color(0.0));
            assert_eq!(map.color(f64::INFINITY), map.color(1.0));
        }
    }
}
